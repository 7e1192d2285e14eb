"""Builds a release, checks it, and tries out its wheel: ``python -m tools.release --out dist``.

Steps, each of which must pass: version, changelog and citation agree; the sdist is built, and from it a
wheel for each interpreter; twine checks all; the sdist holds every file of the repository but those of its
own house-keeping; each wheel holds the whole package and its machine code; the pages and the reference of
the API are built without a warning; the page that renders in a browser is bundled with its network; depth
networks that are not pinned are listed (``--pinned``: an error); for each interpreter the wheel is
installed into an empty environment, where no torch may be, the command line renders a picture, and what
that took is told; a list of what was installed there is written (CycloneDX), and sums of all files. It
needs npm and the extra ``release``.
"""

import argparse
import hashlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from pathlib import Path
from typing import NoReturn

from bokehnet.inference.depth_models import depth_model_names, find_depth_model

ROOT = Path(__file__).resolve().parents[1]

# What a repository has and a release does not: its own automation and what git is told to leave out.
NOT_RELEASED = (".ci/", ".gitignore")

# What a wheel has beside the files of the repository: made by hatch_build.py.
MACHINE_CODE = {f"bokehnet/precompiled/machine_code/kernels.{kind}" for kind in ("bin", "json")}

# Files of web/ that a server hands out, and the list of what they need.
WEB = (
    "index.html",
    "page.js",
    "worker.js",
    "bokeh.js",
    "preview.js",
    "isolate.js",
    "serve.py",
    "package.json",
    "README.md",
)

# Of ONNX Runtime, what the page loads, of 130 MB of variants: WebAssembly alone, and with WebGPU.
RUNTIME = (
    "ort.wasm.min.mjs",
    "ort-wasm-simd-threaded.mjs",
    "ort-wasm-simd-threaded.wasm",
    "ort.all.min.mjs",
    "ort-wasm-simd-threaded.jsep.mjs",
    "ort-wasm-simd-threaded.jsep.wasm",
)


def fail(message: str) -> NoReturn:
    """End with one line."""
    raise SystemExit(f"release: error: {message}")


def run(*command: str | Path, folder: Path = ROOT) -> str:
    """Run a command and return what it prints; end with its last lines where it fails."""
    done = subprocess.run(
        [str(word) for word in command], cwd=folder, capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = " | ".join((done.stdout + done.stderr).strip().splitlines()[-3:])
        words = " ".join(map(str, command[1:4]))
        fail(f"{Path(str(command[0])).name} {words}: code {done.returncode}: {last}")
    return done.stdout


def told_versions() -> dict[str, str]:
    """The version as each file that tells it has it."""
    places = {
        "bokehnet/version.py": r'__version__ = "(.+)"',
        "pyproject.toml": r'(?m)^version = "(.+)"',
        "CITATION.cff": r"(?m)^version: (.+)$",
        "packaging/conda/recipe.yaml": r'(?m)^  version: "(.+)"',
        "integrations/blender/blender_manifest.toml": r'(?m)^version = "(.+)"',
    }
    found = {}
    for name, pattern in places.items():
        match = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"))
        if match is None:
            fail(f"{name}: expected a version, found none")
        found[name] = match[1]
    return found


def check_versions() -> str:
    """Return the one version, or end where files disagree or the changelog has no part for it."""
    found = told_versions()
    if len(set(found.values())) != 1:
        fail(
            f"expected one version, found {', '.join(f'{name} {version}' for name, version in found.items())}"
        )
    (version,) = set(found.values())
    if f"## {version}" not in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"):
        fail(f"CHANGELOG.md: expected a part for {version}, found none")
    return version


def released_files() -> set[str]:
    """What git keeps and a release has."""
    kept = run("git", "ls-files").splitlines()
    return {name for name in kept if not name.startswith(NOT_RELEASED)}


def check_contents(sdist: Path, wheel: Path) -> None:
    """End unless both hold all that they must."""
    wanted = released_files()
    with tarfile.open(sdist) as file:
        there = {name.partition("/")[2] for name in file.getnames()}
    if missing := sorted(wanted - there):
        fail(f"{sdist.name}: expected all of the repository, found {len(missing)} missing: {missing[:5]}")
    with zipfile.ZipFile(wheel) as file:
        there = set(file.namelist())
    package = {name for name in wanted if name.startswith("bokehnet/")}
    if missing := sorted(package - there):
        fail(f"{wheel.name}: expected the whole package, found {len(missing)} missing: {missing[:5]}")
    if missing := sorted(MACHINE_CODE - there):
        fail(f"{wheel.name}: expected machine code, found {len(missing)} missing: {missing}")
    if extra := sorted(name for name in there - package - MACHINE_CODE if ".dist-info/" not in name):
        fail(f"{wheel.name}: expected the package alone, found {extra[:5]}")


def build_sdist(out: Path) -> Path:
    """Make the sdist."""
    run(sys.executable, "-m", "build", "--sdist", "--outdir", out)
    (sdist,) = out.glob("*.tar.gz")
    run(sys.executable, "-m", "twine", "check", "--strict", sdist)
    return sdist


def build_wheel(python: str, sdist: Path, out: Path) -> Path:
    """Build the wheel of an interpreter from the sdist; machine code is for one minor version of Python."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(python, "-m", "venv", folder / "venv", folder=folder)
        own = folder / "venv/bin/python"
        run(own, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder / "made", sdist, folder=folder)
        (made,) = (folder / "made").glob("*.whl")
        wheel = Path(shutil.copy(made, out))
    run(sys.executable, "-m", "twine", "check", "--strict", wheel)
    return wheel


def build_docs(out: Path, version: str) -> Path:
    """Make the pages, with the reference of the API from the docstrings; a warning is an error."""
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder)
        return zipped(Path(folder), out / f"bokehnet-{version}-docs.zip")


def make_web(folder: Path) -> None:
    """Make what a web server needs for ``web/``: the page, its network, a picture, ONNX Runtime."""
    for name in WEB:
        shutil.copy(ROOT / "web" / name, folder)
    for source in sorted((ROOT / "bokehnet/assets").glob("demo*.png")):
        shutil.copy(source, folder)
    (folder / ".nojekyll").touch()  # else GitHub's pages leave node_modules out
    runtime = Path("node_modules/onnxruntime-web/dist")
    (folder / runtime).mkdir(parents=True)
    with tempfile.TemporaryDirectory() as fetched:
        shutil.copy(folder / "package.json", fetched)
        run("npm", "install", "--ignore-scripts", "--no-audit", "--no-fund", folder=Path(fetched))
        for each in RUNTIME:
            shutil.copy(Path(fetched) / runtime / each, folder / runtime)
    run(sys.executable, "-m", "bokehnet", "export", "-o", folder / "fast.onnx")


def bundle_web(out: Path, version: str) -> Path:
    """Pack the page for the browser."""
    with tempfile.TemporaryDirectory() as folder:
        make_web(Path(folder))
        return zipped(Path(folder), out / f"bokehnet-{version}-web.zip")


def zipped(folder: Path, archive: Path) -> Path:
    """Pack all files of a folder."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                file.write(path, path.relative_to(folder))
    return archive


def unpinned_models() -> list[str]:
    """Names of published depth networks whose bytes are not pinned, so that they are refused."""
    models = [find_depth_model(name) for name in depth_model_names()]
    return [model.name for model in models if model and not (model.unpublished or model.revision)]


def size_of(folder: Path) -> float:
    """MiB of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 2**20


def try_out(python: str, wheel: Path, out: Path) -> str:
    """Install the wheel where nothing is, render, and return what that took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(python, "-m", "venv", folder / "venv", folder=folder)
        own = folder / "venv/bin/python"
        before, begun = size_of(folder / "venv"), time.perf_counter()
        run(own, "-m", "pip", "install", "-q", wheel, folder=folder)
        installed, size = time.perf_counter() - begun, size_of(folder / "venv") - before
        code = "import importlib.util, sys; print(*sys.version_info[:3], sep='.')"
        code += "; sys.exit(importlib.util.find_spec('torch') is not None)"
        version = run(own, "-c", code, folder=folder).strip()
        begun = time.perf_counter()
        run(folder / "venv/bin/bokehnet", "demo", "-o", "demo.png", folder=folder)
        first = time.perf_counter() - begun
        if not (folder / "demo.png").stat().st_size:
            fail(f"Python {version}: expected a picture, found an empty file")
        sbom = out / f"sbom-{version}.json"
        run(sys.executable, "-m", "cyclonedx_py", "environment", own, "-o", sbom, folder=folder)
    return (
        f"Python {version}: {size:.0f} MiB, installed in {installed:.0f} s, first picture after {first:.1f} s"
    )


def main() -> None:
    """Make a release in a folder that is empty before."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder, empty before")
    parser.add_argument("--python", action="append", help="interpreter to make a wheel for; repeatable")
    parser.add_argument(
        "--web", action="store_true", help="make the page for the browser there, nothing else"
    )
    parser.add_argument("--pinned", action="store_true", help="depth networks without pins are an error")
    given = parser.parse_args()
    out = given.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        fail(f"--out: expected an empty folder, found files in {out}; give another one")
    if given.web:
        make_web(out)
        return
    version, unpinned = check_versions(), unpinned_models()
    if unpinned and given.pinned:
        fail(f"depth networks: expected pins, found none of {', '.join(unpinned)}; run tools.pin_models")
    pythons, sdist = given.python or [sys.executable], build_sdist(out)
    print(f"{version}: {sdist.name} {size_of_file(sdist)}", flush=True)
    wheels = [build_wheel(python, sdist, out) for python in pythons]
    for wheel in wheels:
        check_contents(sdist, wheel)
        print(f"{wheel.name} {size_of_file(wheel)}, complete", flush=True)
    for made in (build_docs(out, version), bundle_web(out, version)):
        print(f"{made.name} {size_of_file(made)}")
    print(f"depth networks without pinned bytes: {', '.join(unpinned) or 'none'}", flush=True)
    for python, wheel in zip(pythons, wheels, strict=True):
        print(try_out(python, wheel, out), flush=True)
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}" for path in sorted(out.iterdir())]
    (out / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def size_of_file(path: Path) -> str:
    """MiB of a file, for people."""
    return f"{path.stat().st_size / 2**20:.1f} MiB"


if __name__ == "__main__":
    main()
