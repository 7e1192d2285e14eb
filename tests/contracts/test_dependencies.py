"""Files that name what the package needs agree. Authority: pyproject.toml, metadata of what is installed."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, packages_distributions, requires

import pytest

from tests.conftest import ROOT

requirements = pytest.importorskip("packaging.requirements", reason="needs packaging, which pytest brings")
yaml = pytest.importorskip("yaml", reason="needs PyYAML, which the extra docs brings")

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
AT_CONDA = {  # names of conda-forge
    "openimageio": "py-openimageio",
    "lazy-loader": "lazy_loader",
    "huggingface-hub": "huggingface_hub",
}


def canonical(name: str) -> str:
    """A name as PEP 503 compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def own_requires(extras: set[str]) -> Iterator[str]:
    yield from PROJECT["dependencies"]
    for extra in extras:
        yield from PROJECT["optional-dependencies"][extra]


def installed_by(extra: str) -> set[str]:
    """All that an extra brings, as far as it is installed here, by the metadata of what is."""
    result: set[str] = set()
    open_ends, known = [("bokehnet", frozenset({extra}))], set()
    while open_ends:
        name, extras = end = open_ends.pop()
        if end in known:
            continue
        known.add(end)
        try:
            expected = own_requires(set(extras)) if name == "bokehnet" else requires(name) or []
        except PackageNotFoundError:
            continue
        result.add(name)
        for line in map(requirements.Requirement, expected):
            options = [{"extra": each} for each in ("", *extras)]
            if line.marker is None or any(map(line.marker.evaluate, options)):
                open_ends.append((canonical(line.name), frozenset(line.extras)))
    return result - {"bokehnet"}


def test_the_constraints_name_all_that_the_development_environment_holds():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    named = {canonical(line.split("==")[0]) for line in lines if not line.startswith("#")}
    needed = installed_by("dev")
    assert {"numpy", "pytest", "starlette"} <= needed
    assert sorted(needed - named) == []


def test_a_picture_is_rendered_with_the_packages_of_the_base_alone(tmp_path):
    """Authority: the dependencies in pyproject.toml; packages of extras cannot be imported."""
    needed = installed_by("models")
    absent = [
        module
        for module, names in packages_distributions().items()
        if not needed & {canonical(name) for name in names} and not module.startswith("bokehnet")
    ]
    assert {"torch", "scipy", "pytest"} <= set(absent)
    code = "import sys; sys.modules.update(dict.fromkeys(sys.argv[2:])); from bokehnet.cli.app import run; "
    code += "sys.exit(run(['demo', '-o', sys.argv[1]]))"
    picture = tmp_path / "demo.png"
    words = [sys.executable, "-c", code, str(picture), *absent]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert picture.exists()


def test_the_container_installs_locked_versions_with_hashes():
    """Every package that its extras need, in the version of the constraints."""
    text = (ROOT / "containers/requirements.txt").read_text(encoding="utf-8")
    entries = [entry for entry in re.split(r"\n(?=[a-z])", text) if "==" in entry]
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(line.split("==") for line in lines if "==" in line and not line.startswith("#"))
    pinned = {canonical(name): version for name, version in pinned.items()}
    locked = {}
    for entry in entries:
        name, version = re.match(r"([\w.-]+)==(\S+)", entry.lstrip("# ")).groups()
        locked[canonical(name)] = version
        assert "--hash=sha256:" in entry, name
    needed = installed_by("serve") | installed_by("models")
    assert {"fastapi", "numpy"} <= needed
    assert sorted(needed - set(locked)) == []
    assert {name: locked[name] for name in locked if name in pinned and pinned[name] != locked[name]} == {}
    recipe = (ROOT / "containers/Containerfile").read_text(encoding="utf-8")
    assert "--require-hashes -r requirements.txt" in recipe
    assert "--no-deps --no-build-isolation" in recipe


def test_the_conda_recipe_needs_what_the_package_needs():
    recipe = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text(encoding="utf-8"))
    expected = {f"python {PROJECT['requires-python']}"}
    for line in map(requirements.Requirement, PROJECT["dependencies"]):
        expected.add(f"{AT_CONDA.get(canonical(line.name), canonical(line.name))} {line.specifier}")
    assert set(recipe["requirements"]["run"]) == expected
    assert f"python {PROJECT['requires-python']}" in recipe["requirements"]["host"]
    (script,) = PROJECT["scripts"].items()
    assert recipe["build"]["python"]["entry_points"] == [" = ".join(script)]
