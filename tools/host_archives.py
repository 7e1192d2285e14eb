"""Build the archives of the plug-ins: ``python -m tools.host_archives --out FOLDER [HOST ...]``.

Each archive is installed in two steps, which its page in ``docs/use/hosts`` states and its README repeats.

Blender gets two archives. The first contains no wheels, works on every platform and uses a Python that has
bokehnet. The second contains all wheels for one platform and one Python, so that nothing else is needed. They
include NumPy, since Blender's own may be too old; the bokehnet process imports the included one first.
ComfyUI's archive contains bokehnet's wheels, which its ``requirements.txt`` installs. The OpenFX bundle is
compiled; it needs cmake, a C++ compiler and ``OPENFX_ROOT``, a checkout of the OpenFX repository.
"""

import argparse
import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path

from bokehnet.version import __version__

__all__ = [
    "HOSTS",
    "Archive",
    "build_archives",
    "build_blender",
    "build_comfyui",
    "build_folder",
    "build_openfx",
]

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "integrations"
MANIFEST = "blender_manifest.toml"

# Archives that are copies of folders: folder of integrations, folder in the archive, folder of the README.
FOLDERS = {
    "gimp": ("gimp/bokehnet", "bokehnet", "bokehnet"),
    "krita": ("krita", "", "bokehnet"),
    "darktable": ("darktable", "lua", None),
    "nuke": ("nuke", "bokehnet", "bokehnet"),
}
HOSTS = ("blender", "comfyui", "openfx", *FOLDERS)

# Blender's name of a platform, and the compatible wheel tags.
PLATFORMS = {
    "linux-x64": (
        "manylinux_2_28_x86_64",
        "manylinux_2_27_x86_64",
        "manylinux_2_17_x86_64",
        "manylinux2014_x86_64",
    ),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_12_0_arm64", "macosx_11_0_arm64"),
}

# Python of Blender 4.2 to 5.0.
BLENDER_PYTHON = "3.11"


class Archive:
    """Zip archive whose bytes depend only on its files; keeps permissions, such as those of GIMP's plug-in.

    Args:
        path: File to write.
    """

    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._file = zipfile.ZipFile(path, "w")

    def __enter__(self) -> "Archive":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def text(self, name: str, text: str) -> None:
        """Add a text file."""
        self._write(name, text.encode(), 0o644)

    def copy(self, source: Path, name: str) -> None:
        """Add a file."""
        self._write(name, source.read_bytes(), 0o755 if source.stat().st_mode & stat.S_IXUSR else 0o644)

    def folder(self, source: Path, name: str) -> None:
        """Add all files of a folder except Python's caches."""
        for path in sorted(source.rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                self.copy(path, "/".join(filter(None, (name, path.relative_to(source).as_posix()))))

    def _write(self, name: str, data: bytes, mode: int) -> None:
        entry = zipfile.ZipInfo(name)  # dated 1980
        entry.external_attr = (stat.S_IFREG | mode) << 16
        entry.compress_type = zipfile.ZIP_STORED if name.endswith(".whl") else zipfile.ZIP_DEFLATED
        self._file.writestr(entry, data)


def _readme(host: str) -> str:
    """Return the README of an archive: the page of its host up to its tests, without pictures and links."""
    text = (ROOT / "docs/use/hosts" / f"{host}.md").read_text(encoding="utf-8").partition("\n## Tested")[0]
    text = re.sub(r"(?m)^!\[.*\]\(.*\)\n\n?", "", text)
    return re.sub(r"\[([^\]]+)\]\((?!http)[^)]+\)", r"\1", text)


def build_folder(host: str, out: Path) -> Path:
    """Pack a plug-in that is a folder of files.

    Args:
        host: A key of ``FOLDERS``.
        out: Folder of the archive.
    """
    source, name, readme = FOLDERS[host]
    with Archive(out / f"bokehnet-{host}-{__version__}.zip") as archive:
        archive.folder(SOURCES / source, name)
        if readme is not None:
            archive.text(f"{readme}/README.md", _readme(host))
            archive.copy(ROOT / "LICENSE", f"{readme}/LICENSE")
    return archive.path


def _manifest(wheels: Iterable[Path], platform: str | None) -> str:
    """Return the manifest of an extension: that of the source, for one platform, with its wheels."""
    text = (SOURCES / "blender" / MANIFEST).read_text(encoding="utf-8")
    if platform is None:
        return text
    entries = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
    added = f'platforms = ["{platform}"]\nwheels = [\n{entries}]\n'
    return re.sub(r"(?m)^(?=\[permissions\])", added + "\n", text, count=1)


def build_blender(out: Path, wheels: list[Path], platform: str | None = None) -> Path:
    """Pack the extension for installation from disk.

    Args:
        out: Folder of the archive.
        wheels: Wheels to include; without any, the extension uses a Python that has bokehnet.
        platform: A key of ``PLATFORMS``; None for all platforms, without wheels.
    """
    suffix = f"-{platform}" if platform else ""
    with Archive(out / f"bokehnet-blender-{__version__}{suffix}.zip") as archive:
        archive.text(MANIFEST, _manifest(wheels, platform))
        archive.text("README.md", _readme("blender"))
        archive.copy(ROOT / "LICENSE", "LICENSE")
        for source in sorted((SOURCES / "blender").glob("*.py")):
            archive.copy(source, source.name)
        for wheel in wheels:
            archive.copy(wheel, f"wheels/{wheel.name}")
    return archive.path


def build_comfyui(out: Path, wheels: list[Path]) -> Path:
    """Pack the nodes for the folder ``custom_nodes``, with the metadata of ComfyUI's registry.

    Args:
        out: Folder of the archive.
        wheels: Wheels of bokehnet, for the installation without a package index; pip chooses among them.
    """
    search = "--find-links wheels\n" if wheels else ""
    with Archive(out / f"bokehnet-comfyui-{__version__}.zip") as archive:
        archive.folder(SOURCES / "comfyui", "bokehnet")
        archive.text("bokehnet/requirements.txt", f"{search}bokehnet=={__version__}\n")
        archive.text("bokehnet/README.md", _readme("comfyui"))
        archive.copy(ROOT / "LICENSE", "bokehnet/LICENSE")
        for wheel in wheels:
            archive.copy(wheel, f"bokehnet/wheels/{wheel.name}")
    return archive.path


def build_openfx(out: Path) -> Path | str:
    """Compile and pack the OpenFX bundle; return the reason instead where it cannot be compiled."""
    openfx = Path(os.environ.get("OPENFX_ROOT", ROOT.parent / "openfx"))
    if not (openfx / "include/ofxImageEffect.h").is_file():
        return "openfx: skipped, OPENFX_ROOT names no checkout of the OpenFX repository"
    if not (shutil.which("cmake") and (shutil.which("c++") or shutil.which("cl"))):
        return "openfx: skipped, needs cmake and a C++ compiler"
    with tempfile.TemporaryDirectory() as name:
        build = Path(name)
        _run("cmake", "-S", SOURCES / "openfx", "-B", build, f"-DOPENFX_ROOT={openfx}")
        _run("cmake", "--build", build)
        bundle = build / "bokehnet.ofx.bundle"
        (platform,) = (path.name for path in (bundle / "Contents").iterdir())
        with Archive(out / f"bokehnet-openfx-{__version__}-{platform.lower()}.zip") as archive:
            archive.folder(bundle, bundle.name)
            archive.text(f"{bundle.name}/Contents/Resources/README.md", _readme("openfx"))
            archive.copy(ROOT / "LICENSE", f"{bundle.name}/Contents/Resources/LICENSE")
    return archive.path


def _run(*command: str | Path) -> None:
    """Run a command; exit with its last lines if it fails."""
    process = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    if process.returncode:
        last_lines = " | ".join((process.stdout + process.stderr).strip().splitlines()[-3:])
        words = " ".join(map(str, command[:4]))
        raise SystemExit(f"host_archives: error: {words}: code {process.returncode}: {last_lines}")


def _own_wheels(folder: Path) -> list[Path]:
    """Build bokehnet's wheels: one for all platforms, and one with machine code where it can be compiled."""
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder]
    _run(*pip, ROOT)
    os.environ["BOKEHNET_BUILD_KERNELS"] = "0"
    _run(*pip, ROOT)
    return sorted(folder.glob("bokehnet-*.whl"))


def download_wheels(own: list[Path], folder: Path, platform: str, find_links: str | None) -> list[Path]:
    """Return all wheels of a Blender extension: one of bokehnet's, and its dependencies.

    Args:
        own: Wheels of bokehnet; pip chooses the one for the platform.
        folder: Folder of the wheels.
        platform: A key of ``PLATFORMS``.
        find_links: Folder of wheels to use before a package index.
    """
    for wheel in own:
        shutil.copy(wheel, folder)
    tags = [word for tag in PLATFORMS[platform] for word in ("--platform", tag)]
    search = ["--find-links", folder, *(["--find-links", find_links] if find_links else [])]
    words = ["--only-binary", ":all:", "--python-version", BLENDER_PYTHON, *tags, *search]
    with tempfile.TemporaryDirectory() as name:
        target = Path(name)
        _run(
            *(sys.executable, "-m", "pip", "download", "-q", *words, "-d", target, f"bokehnet=={__version__}")
        )
        for wheel in folder.glob("*.whl"):
            wheel.unlink()
        return [Path(shutil.move(wheel, folder)) for wheel in sorted(target.glob("*.whl"))]


def build_archives(
    out: Path, hosts: Iterable[str], wheels: list[Path], platform: str, find_links: str | None = None
) -> list[Path]:
    """Build the archives of hosts; print one line for each that is skipped.

    Args:
        out: Folder of the archives.
        hosts: Names out of ``HOSTS``.
        wheels: Wheels of bokehnet to include; without any, no archive contains wheels.
        platform: Platform of Blender's wheels, a key of ``PLATFORMS``.
        find_links: Folder of wheels to use before a package index.
    """
    archives = []
    for host in hosts:
        if host == "blender":
            archives.append(build_blender(out, []))
            if wheels:
                with tempfile.TemporaryDirectory() as folder:
                    needed = download_wheels(wheels, Path(folder), platform, find_links)
                    archives.append(build_blender(out, needed, platform))
        elif host == "comfyui":
            archives.append(build_comfyui(out, wheels))
        elif host == "openfx":
            built = build_openfx(out)
            if isinstance(built, str):
                print(built, flush=True)
            else:
                archives.append(built)
        else:
            archives.append(build_folder(host, out))
    return archives


def main() -> None:
    """Build the archives of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("hosts", nargs="*", metavar="HOST", help=f"default: all of {', '.join(HOSTS)}")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the archives")
    parser.add_argument("--platform", choices=PLATFORMS, default="linux-x64", help="of Blender's wheels")
    parser.add_argument("--no-wheels", action="store_true", help="include no wheels")
    parser.add_argument("--find-links", help="folder of wheels to use before a package index")
    options = parser.parse_args()
    if unknown := sorted(set(options.hosts) - set(HOSTS)):
        parser.error(f"expected hosts out of {', '.join(HOSTS)}, found {', '.join(unknown)}")
    hosts = options.hosts or HOSTS
    with tempfile.TemporaryDirectory() as folder:
        needed = not options.no_wheels and {"blender", "comfyui"} & set(hosts)
        wheels = _own_wheels(Path(folder)) if needed else []
        for archive in build_archives(options.out, hosts, wheels, options.platform, options.find_links):
            print(f"{archive.name} {archive.stat().st_size / 2**20:.2f} MiB")


if __name__ == "__main__":
    main()
