"""Build, check and test a release: ``python -m tools.release --out dist``.

Steps, each of which must pass:

1. Version, changelog and citation agree.
2. The sdist is built, and from it a wheel for each interpreter and one for all; twine checks them.
3. The sdist contains every file of the repository except its automation; each wheel contains the whole
   package and, but for the one for all, its machine code.
4. The pages and the API reference are built without a warning.
5. The browser page is bundled with its network.
6. The plug-ins are packed for their hosts (``tools.host_archives``).
7. Depth networks without pins are listed (``--pinned``: an error).
8. For each interpreter, the wheel is installed into an empty environment without torch and renders a picture;
   the duration is printed.
9. A list of the installed packages (CycloneDX) and the checksums of all files are written.

The command needs npm and the extra ``release``.
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

from bokehnet.inference.depth_models import depth_model_names, find_depth_model
from tools.host_archives import HOSTS, PLATFORMS, build_archives

ROOT = Path(__file__).resolve().parents[1]

# Files of the repository that a release excludes: automation and git configuration.
NOT_RELEASED = (".ci/", ".github/", ".gitignore", ".pre-commit-config.yaml")

# Files of a wheel that are not in the repository: output of hatch_build.py.
MACHINE_CODE = {f"bokehnet/precompiled/machine_code/kernels.{kind}" for kind in ("bin", "json")}

# Files of web/ that a server delivers, and their list of dependencies.
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

# Files of ONNX Runtime that the page loads, of 130 MB of variants: WebAssembly without and with WebGPU.
RUNTIME = (
    "ort.wasm.min.mjs",
    "ort-wasm-simd-threaded.mjs",
    "ort-wasm-simd-threaded.wasm",
    "ort.all.min.mjs",
    "ort-wasm-simd-threaded.jsep.mjs",
    "ort-wasm-simd-threaded.jsep.wasm",
)


def fail(message: str) -> NoReturn:
    """Exit with a one-line error message."""
    raise SystemExit(f"release: error: {message}")


def run(*command: str | Path, folder: Path = ROOT, variables: Mapping[str, str] | None = None) -> str:
    """Run a command and return its stdout; exit with its last lines if it fails."""
    words, environment = [str(word) for word in command], {**os.environ, **(variables or {})}
    process = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if process.returncode:
        last_lines = " | ".join((process.stdout + process.stderr).strip().splitlines()[-3:])
        words = " ".join(map(str, command[1:4]))
        fail(f"{Path(str(command[0])).name} {words}: code {process.returncode}: {last_lines}")
    return process.stdout


def stated_versions() -> dict[str, str]:
    """Return the version in each file that states it."""
    places = {
        "bokehnet/version.py": r'__version__ = "(.+)"',
        "pyproject.toml": r'(?m)^version = "(.+)"',
        "CITATION.cff": r"(?m)^version: (.+)$",
        "packaging/conda/recipe.yaml": r'(?m)^  version: "(.+)"',
        "integrations/blender/blender_manifest.toml": r'(?m)^version = "(.+)"',
        "integrations/comfyui/pyproject.toml": r'(?m)^version = "(.+)"',
        "integrations/comfyui/pyproject.toml (bokehnet)": r'"bokehnet==(.+)"',
    }
    versions = {}
    for name, pattern in places.items():
        match = re.search(pattern, (ROOT / name.partition(" ")[0]).read_text(encoding="utf-8"))
        if match is None:
            fail(f"{name}: expected a version, found none")
        versions[name] = match[1]
    return versions


def check_versions() -> str:
    """Return the version; exit if files disagree or the changelog has no section for it."""
    versions = stated_versions()
    if len(set(versions.values())) != 1:
        listed = ", ".join(f"{name} {version}" for name, version in versions.items())
        fail(f"expected one version, found {listed}")
    (version,) = set(versions.values())
    if f"## {version}" not in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"):
        fail(f"CHANGELOG.md: expected a section for {version}, found none")
    return version


def released_files() -> set[str]:
    """Return the tracked files that belong to a release."""
    tracked = run("git", "ls-files").splitlines()
    return {name for name in tracked if not name.startswith(NOT_RELEASED)}


def check_contents(sdist: Path, wheel: Path) -> None:
    """Exit unless sdist and wheel contain all required files."""
    expected = released_files()
    with tarfile.open(sdist) as file:
        contents = {name.partition("/")[2] for name in file.getnames()}
    if missing := sorted(expected - contents):
        fail(f"{sdist.name}: expected all of the repository, found {len(missing)} missing: {missing[:5]}")
    with zipfile.ZipFile(wheel) as file:
        contents = set(file.namelist())
    package = {name for name in expected if name.startswith("bokehnet/")}
    if missing := sorted(package - contents):
        fail(f"{wheel.name}: expected the whole package, found {len(missing)} missing: {missing[:5]}")
    if missing := [] if wheel.name.endswith("-none-any.whl") else sorted(MACHINE_CODE - contents):
        fail(f"{wheel.name}: expected machine code, found {len(missing)} missing: {missing}")
    if extra := sorted(name for name in contents - package - MACHINE_CODE if ".dist-info/" not in name):
        fail(f"{wheel.name}: expected the package alone, found {extra[:5]}")


def build_sdist(out: Path) -> Path:
    """Build the sdist."""
    run(sys.executable, "-m", "build", "--sdist", "--outdir", out)
    (sdist,) = out.glob("*.tar.gz")
    run(sys.executable, "-m", "twine", "check", "--strict", sdist)
    return sdist


def build_wheel(python: str, sdist: Path, out: Path, kernels: bool = True) -> Path:
    """Build a wheel from the sdist.

    Args:
        python: Interpreter of the wheel, on whose version its machine code depends.
        sdist: Source distribution.
        out: Folder of the wheel.
        kernels: False for a wheel without machine code, for all interpreters and platforms.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(python, "-m", "venv", folder / "venv", folder=folder)
        interpreter = folder / "venv/bin/python"
        words = ["-m", "pip", "wheel", "-q", "--no-deps", "-w", folder / "made", sdist]
        run(interpreter, *words, folder=folder, variables={"BOKEHNET_BUILD_KERNELS": str(int(kernels))})
        (artifact,) = (folder / "made").glob("*.whl")
        wheel = Path(shutil.copy(artifact, out))
    run(sys.executable, "-m", "twine", "check", "--strict", wheel)
    return wheel


def build_docs(out: Path, version: str) -> Path:
    """Build the pages and the API reference from the docstrings; warnings are errors."""
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder)
        return zipped(Path(folder), out / f"bokehnet-{version}-docs.zip")


def make_web(folder: Path) -> None:
    """Write the files for a web server: the page of ``web/``, its network, a picture and ONNX Runtime."""
    for name in WEB:
        shutil.copy(ROOT / "web" / name, folder)
    for source in sorted((ROOT / "bokehnet/assets").glob("demo*.png")):
        shutil.copy(source, folder)
    (folder / ".nojekyll").touch()  # otherwise GitHub Pages excludes node_modules
    runtime = Path("node_modules/onnxruntime-web/dist")
    (folder / runtime).mkdir(parents=True)
    with tempfile.TemporaryDirectory() as download_folder:
        shutil.copy(folder / "package.json", download_folder)
        run("npm", "install", "--ignore-scripts", "--no-audit", "--no-fund", folder=Path(download_folder))
        for name in RUNTIME:
            shutil.copy(Path(download_folder) / runtime / name, folder / runtime)
    for engine in ("fast", "rays"):
        run(sys.executable, "-m", "bokehnet", "export", "-o", folder / f"{engine}.onnx", "--engine", engine)
    run(sys.executable, "-m", "bokehnet", "export", "-o", folder / "repair.onnx", "--repair")


def bundle_web(out: Path, version: str) -> Path:
    """Pack the browser page."""
    with tempfile.TemporaryDirectory() as folder:
        make_web(Path(folder))
        return zipped(Path(folder), out / f"bokehnet-{version}-web.zip")


def zipped(folder: Path, archive: Path) -> Path:
    """Pack all files of a folder into a zip archive; return its path."""
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                file.write(path, path.relative_to(folder))
    return archive


def unpinned_models() -> list[str]:
    """Return the names of published depth networks without pinned hashes, which the package refuses."""
    models = [find_depth_model(name) for name in depth_model_names()]
    return [model.name for model in models if model and not (model.unpublished or model.revision)]


def size_of(folder: Path) -> float:
    """Return the total size of all files in a folder, MiB."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 2**20


def try_out(python: str, wheel: Path, out: Path) -> str:
    """Install the wheel into an empty environment, render a picture, and return sizes and durations."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        run(python, "-m", "venv", folder / "venv", folder=folder)
        interpreter = folder / "venv/bin/python"
        before, start = size_of(folder / "venv"), time.perf_counter()
        run(interpreter, "-m", "pip", "install", "-q", wheel, folder=folder)
        installed, size = time.perf_counter() - start, size_of(folder / "venv") - before
        code = "import importlib.util, sys; print(*sys.version_info[:3], sep='.')"
        code += "; sys.exit(importlib.util.find_spec('torch') is not None)"
        version = run(interpreter, "-c", code, folder=folder).strip()
        start = time.perf_counter()
        run(folder / "venv/bin/bokehnet", "demo", "-o", "demo.png", folder=folder)
        first = time.perf_counter() - start
        if not (folder / "demo.png").stat().st_size:
            fail(f"Python {version}: expected a picture, found an empty file")
        sbom = out / f"sbom-{version}.json"
        run(sys.executable, "-m", "cyclonedx_py", "environment", interpreter, "-o", sbom, folder=folder)
    return (
        f"Python {version}: {size:.0f} MiB, installed in {installed:.0f} s, first picture after {first:.1f} s"
    )


def main() -> None:
    """Build a release in an empty folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="empty folder for the release")
    parser.add_argument("--python", action="append", help="interpreter to build a wheel for; repeatable")
    parser.add_argument(
        "--platform", choices=PLATFORMS, default="linux-x64", help="platform of Blender's wheels"
    )
    parser.add_argument("--web", action="store_true", help="only write the browser page")
    parser.add_argument("--pinned", action="store_true", help="fail if a depth network is not pinned")
    options = parser.parse_args()
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if any(out.iterdir()):
        fail(f"--out: expected an empty folder, found files in {out}; give another one")
    if options.web:
        make_web(out)
        return
    released_files()  # fails at once outside a git repository
    version, unpinned = check_versions(), unpinned_models()
    if unpinned and options.pinned:
        fail(f"depth networks: expected pins, found none of {', '.join(unpinned)}; run tools.pin_models")
    pythons, sdist = options.python or [sys.executable], build_sdist(out)
    print(f"{version}: {sdist.name} {size_of_file(sdist)}", flush=True)
    wheels = [build_wheel(python, sdist, out) for python in pythons]
    universal = build_wheel(sys.executable, sdist, out, kernels=False)
    for wheel in (*wheels, universal):
        check_contents(sdist, wheel)
        print(f"{wheel.name} {size_of_file(wheel)}, complete", flush=True)
    plug_ins = build_archives(out, HOSTS, [*wheels, universal], options.platform)
    for artifact in (build_docs(out, version), bundle_web(out, version), *plug_ins):
        print(f"{artifact.name} {size_of_file(artifact)}", flush=True)
    print(f"depth networks without pinned bytes: {', '.join(unpinned) or 'none'}", flush=True)
    for python, wheel in zip(pythons, wheels, strict=True):
        print(try_out(python, wheel, out), flush=True)
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}" for path in sorted(out.iterdir())]
    (out / "SHA256SUMS").write_text("\n".join(sums) + "\n", encoding="utf-8")


def size_of_file(path: Path) -> str:
    """Return the size of a file as text, MiB."""
    return f"{path.stat().st_size / 2**20:.1f} MiB"


if __name__ == "__main__":
    main()
