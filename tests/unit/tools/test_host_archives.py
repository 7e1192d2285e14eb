"""The archives of the plug-ins. Authorities: the rules of each host for its archives, and the sources."""

import importlib.util
import subprocess
import sys
import tomllib
import types
import zipfile

import pytest

from bokehnet.version import __version__
from tests.conftest import ROOT
from tools import host_archives

SOURCES = ROOT / "integrations"


def contents(archive):
    with zipfile.ZipFile(archive) as file:
        assert file.testzip() is None
        return {name: file.read(name) for name in file.namelist()}


def sources(folder, pattern="*"):
    """Files of a plug-in by their path."""
    paths = (path for path in (SOURCES / folder).rglob(pattern) if path.is_file())
    return {
        path.relative_to(SOURCES / folder).as_posix(): path
        for path in paths
        if "__pycache__" not in path.parts
    }


@pytest.fixture
def wheel(tmp_path):
    """File with the name of a wheel for all platforms."""
    path = tmp_path / f"bokehnet-{__version__}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("bokehnet/__init__.py", "")
        dist = f"bokehnet-{__version__}.dist-info"
        file.writestr(f"{dist}/METADATA", f"Metadata-Version: 2.1\nName: bokehnet\nVersion: {__version__}\n")
        file.writestr(f"{dist}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
        file.writestr(f"{dist}/RECORD", "")
    return path


@pytest.mark.parametrize(
    ("host", "source", "prefix"),
    [
        ("gimp", "gimp/bokehnet", "bokehnet/"),
        ("krita", "krita", ""),
        ("darktable", "darktable", "lua/"),
        ("nuke", "nuke", "bokehnet/"),
    ],
)
def test_an_archive_contains_each_file_of_its_plug_in(host, source, prefix, tmp_path):
    archive = host_archives.build_folder(host, tmp_path)
    assert archive.name == f"bokehnet-{host}-{__version__}.zip"
    packed = contents(archive)
    for name, path in sources(source).items():
        assert packed.pop(prefix + name) == path.read_bytes()
    extra = {name.rpartition("/")[2] for name in packed}
    assert extra == (set() if host == "darktable" else {"README.md", "LICENSE"})


def test_two_builds_are_equal_byte_for_byte(tmp_path):
    first, second = (host_archives.build_folder("krita", tmp_path / name) for name in "ab")
    assert first.read_bytes() == second.read_bytes()


def test_the_plug_in_of_gimp_stays_executable(tmp_path):
    """GIMP loads only executable files of folders with the same name."""
    with zipfile.ZipFile(host_archives.build_folder("gimp", tmp_path)) as file:
        assert file.getinfo("bokehnet/bokehnet.py").external_attr >> 16 & 0o111
        assert not file.getinfo("bokehnet/README.md").external_attr >> 16 & 0o111


def test_krita_can_import_its_archive(tmp_path):
    """Krita's importer needs a .desktop file that names a folder of the archive with an ``__init__.py``."""
    packed = contents(host_archives.build_folder("krita", tmp_path))
    (desktop,) = (data.decode() for name, data in packed.items() if name.endswith(".desktop"))
    values = dict(line.split("=", 1) for line in desktop.splitlines() if "=" in line)
    assert values["ServiceTypes"] == "Krita/PythonPlugin"
    assert f"{values['X-KDE-Library']}/__init__.py" in packed


def test_the_extension_of_blender_has_a_manifest_for_all_platforms(tmp_path):
    packed = contents(host_archives.build_blender(tmp_path, []))
    manifest = tomllib.loads(packed["blender_manifest.toml"].decode())
    assert manifest["version"] == __version__
    assert not {"wheels", "platforms"} & set(manifest)
    assert {"__init__.py", "README.md", "LICENSE"} <= set(packed)


def test_the_extension_of_blender_names_each_wheel(tmp_path, wheel):
    """Blender requires that the manifest lists each wheel, relative to itself."""
    archive = host_archives.build_blender(tmp_path / "out", [wheel], "linux-x64")
    assert archive.name == f"bokehnet-blender-{__version__}-linux-x64.zip"
    packed = contents(archive)
    manifest = tomllib.loads(packed["blender_manifest.toml"].decode())
    assert manifest["platforms"] == ["linux-x64"]
    assert [name.removeprefix("./") for name in manifest["wheels"]] == [
        name for name in packed if name.endswith(".whl")
    ]
    assert packed[f"wheels/{wheel.name}"] == wheel.read_bytes()


def test_the_archive_of_comfyui_has_the_metadata_of_its_registry(tmp_path):
    packed = contents(host_archives.build_comfyui(tmp_path, []))
    project = tomllib.loads(packed["bokehnet/pyproject.toml"].decode())
    assert project["project"]["version"] == __version__
    assert project["project"]["dependencies"] == [f"bokehnet=={__version__}"]
    assert {"PublisherId", "DisplayName"} <= set(project["tool"]["comfy"])
    assert packed["bokehnet/requirements.txt"].decode() == f"bokehnet=={__version__}\n"
    assert set(sources("comfyui")) <= {name.removeprefix("bokehnet/") for name in packed}


@pytest.mark.slow
def test_the_requirements_of_comfyui_install_the_enclosed_wheel(tmp_path, wheel):
    """From any current folder, without an index."""
    packed = host_archives.build_comfyui(tmp_path, [wheel])
    with zipfile.ZipFile(packed) as file:
        file.extractall(tmp_path / "custom_nodes")
    words = ["--no-index", "--no-deps", "--target", tmp_path / "site", "-r"]
    words = [*words, tmp_path / "custom_nodes/bokehnet/requirements.txt"]
    command = [sys.executable, "-m", "pip", "install", "-q", *map(str, words)]
    done = subprocess.run(command, cwd="/", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site/bokehnet/__init__.py").is_file()


def test_readmes_have_both_steps_and_no_links_into_the_site():
    for host in host_archives.HOSTS:
        text = host_archives._readme(host)
        assert "## Install" in text
        assert "](../" not in text
        assert "![" not in text
        if host != "nuke":
            assert "## Troubleshoot" in text


def test_openfx_without_its_headers_is_skipped_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("OPENFX_ROOT", str(tmp_path))
    assert host_archives.build_archives(tmp_path, ["openfx"], [], "linux-x64") == []
    assert capsys.readouterr().out.count("\n") == 1


def test_an_unknown_host_is_refused_with_the_list(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(sys, "argv", ["host_archives", "photoshop", "--out", str(tmp_path)])
    with pytest.raises(SystemExit):
        host_archives.main()
    assert "expected hosts out of blender, comfyui" in capsys.readouterr().err


@pytest.fixture
def blender_process(monkeypatch):
    """The module of the extension that starts the process; it needs no Blender."""
    package, camera = types.ModuleType("plug_in"), types.ModuleType("plug_in.camera")
    package.__path__, camera.HostError = [], RuntimeError
    monkeypatch.setitem(sys.modules, "plug_in", package)
    monkeypatch.setitem(sys.modules, "plug_in.camera", camera)
    spec = importlib.util.spec_from_file_location("plug_in.process", SOURCES / "blender/process.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_blender_without_wheels_uses_the_python_beside_the_command(blender_process, tmp_path, monkeypatch):
    (tmp_path / "venv").mkdir()
    for name in ("bokehnet", "python"):
        (tmp_path / "venv" / name).write_text("#!/bin/sh\n")
        (tmp_path / "venv" / name).chmod(0o755)
    (tmp_path / "bokehnet").symlink_to(tmp_path / "venv/bokehnet")  # as pipx links it
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(blender_process.importlib.util, "find_spec", lambda name: None)
    assert blender_process._interpreter() == str(tmp_path / "venv/python")
    monkeypatch.setenv("PATH", str(tmp_path / "empty"))
    assert blender_process._interpreter() == sys.executable
