"""Build the conda recipe and run its tests without access to a conda channel.

    python -m tools.conda_recipe dist/bokehnet-0.1.0.tar.gz [--python /path/of/python]

The command creates a local channel: Python from the prefix of an interpreter, and the requirements of the
recipe from wheels on PyPI, each together with the wheels it needs. rattler-build then solves the environments
of the recipe, runs its script on the sdist, and installs the package into a new environment, in which the
tests of the recipe run. The command does not test names and builds of conda-forge. It needs
``pip install py-rattler-build py-rattler``, and Linux.
"""

import argparse
import asyncio
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import rattler_build
from rattler.index import index_fs

ROOT = Path(__file__).resolve().parents[1]
RECIPE = "packaging/conda/recipe.yaml"

# Packages of the channel with the wheels in each; each wheel occurs in one package only.
PACKAGES = {
    "pip": ("pip",),
    "hatchling": ("hatchling", "pathspec", "pluggy", "packaging", "trove-classifiers", "editables"),
    "numpy": ("numpy",),
    "numba": ("numba", "llvmlite"),
    "onnxruntime": ("onnxruntime", "flatbuffers", "protobuf", "sympy", "mpmath"),
    "py-openimageio": ("OpenImageIO",),
    "click": ("click",),
    "tqdm": ("tqdm",),
}


def pack(name: str, version: str, files: Path, channel: Path, *depends: str) -> None:
    """Add a folder with the layout of a prefix to the channel as a package."""
    rattler_build.assemble_package(
        name, version, "linux-64", "0", channel / "linux-64", files_dir=files, depends=depends,
        compression_level=1, detect_prefix=False,
    )  # fmt: skip


def pack_python(python: str, folder: Path, channel: Path) -> str:
    """Add an interpreter and its standard library to the channel; return the path of site-packages."""
    code = "import sys, platform; print(sys.base_prefix, platform.python_version())"
    output = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
    prefix, version = output.stdout.split()
    short = f"python{'.'.join(version.split('.')[:2])}"
    (folder / "bin").mkdir(parents=True)
    shutil.copy(Path(prefix) / "bin" / short, folder / "bin" / short)
    for name in ("python", "python3"):
        (folder / "bin" / name).symlink_to(short)
    excluded = shutil.ignore_patterns("test", "__pycache__", "site-packages")
    shutil.copytree(Path(prefix) / "lib" / short, folder / "lib" / short, symlinks=True, ignore=excluded)
    for library in (Path(prefix) / "lib").glob(f"lib{short}*.so*"):
        shutil.copy(library, folder / "lib")
    pack("python", version, folder, channel)
    return f"lib/{short}/site-packages"


def make_channel(python: str, folder: Path, channel: Path) -> None:
    """Create all packages and the index of the channel."""
    for platform in ("linux-64", "noarch"):
        (channel / platform).mkdir(parents=True)
    site_packages = pack_python(python, folder / "python", channel)
    for name, wheels in PACKAGES.items():
        target = folder / name / site_packages
        install = [python, "-m", "pip", "install", "-q", "--no-deps", "--no-compile", "--target", str(target)]
        subprocess.run([*install, "-c", str(ROOT / "constraints.txt"), *wheels], check=True)
        shutil.rmtree(target / "bin", ignore_errors=True)
        (dist_info,) = target.glob(f"{wheels[0].lower()}-*.dist-info")
        version = dist_info.name.removesuffix(".dist-info").split("-")[1]
        pack(name, version, folder / name, channel, "python")
        print(f"channel: {name} {version}", flush=True)
    asyncio.run(index_fs(channel))


def main() -> None:
    """Build and test the package, and print its name and size."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sdist", type=Path, help="sdist from tools.release")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the channel")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_channel(arguments.python, folder / "files", folder / "channel")
        recipe = folder / "source" / RECIPE
        recipe.parent.mkdir(parents=True)
        shutil.copy(ROOT / RECIPE, recipe)
        (folder / "source/dist").mkdir()
        shutil.copy(arguments.sdist, folder / "source/dist")
        channel = f"file://{folder / 'channel'}"
        rattler_build.build_recipes([recipe], channel=[channel], test="native", output_dir=folder / "out")
        (package,) = (folder / "out/noarch").glob("bokehnet-*.conda")
        print(f"{package.name}: {package.stat().st_size / 2**20:.1f} MiB, built and tested")


if __name__ == "__main__":
    main()
