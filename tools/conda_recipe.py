"""Builds the conda recipe and runs its tests where no conda channel can be had.

    python -m tools.conda_recipe dist/bokehnet-0.1.0.tar.gz [--python /path/of/python]

The channel is made here: Python itself from the prefix of an interpreter, what the recipe asks for from
PyPI's wheels, each with the wheels that it needs packed in. rattler-build then solves the recipe's
environments, runs its script on the sdist, and installs what it made into an environment of its own, where
the recipe's tests run. Names and builds of conda-forge are not tested by this. It needs
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

# Packages of the channel, and the wheels in each: what a wheel needs stands in one of them alone.
PACKAGES = {
    "pip": ("pip",),
    "hatchling": ("hatchling", "pathspec", "pluggy", "packaging", "trove-classifiers", "editables"),
    "numpy": ("numpy",),
    "numba": ("numba", "llvmlite"),
    "onnxruntime": ("onnxruntime", "flatbuffers", "protobuf", "sympy", "mpmath"),
    "py-openimageio": ("OpenImageIO",),
    "typer": (
        *(
            "typer",
            "click",
            "rich",
            "shellingham",
            "markdown-it-py",
            "mdurl",
            "Pygments",
            "typing_extensions",
        ),
        *("annotated-doc", "pydantic", "pydantic_core", "annotated-types", "typing-inspection"),
    ),
    "tqdm": ("tqdm",),
}


def pack(name: str, version: str, files: Path, channel: Path, *depends: str) -> None:
    """Put a folder, as it stands in a prefix, into the channel."""
    rattler_build.assemble_package(
        name, version, "linux-64", "0", channel / "linux-64", files_dir=files, depends=depends,
        compression_level=1, detect_prefix=False,
    )  # fmt: skip


def pack_python(python: str, folder: Path, channel: Path) -> str:
    """Put an interpreter and its library into the channel; return where its packages go."""
    code = "import sys, platform; print(sys.base_prefix, platform.python_version())"
    asked = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
    prefix, version = asked.stdout.split()
    short = f"python{'.'.join(version.split('.')[:2])}"
    (folder / "bin").mkdir(parents=True)
    shutil.copy(Path(prefix) / "bin" / short, folder / "bin" / short)
    for name in ("python", "python3"):
        (folder / "bin" / name).symlink_to(short)
    left_out = shutil.ignore_patterns("test", "__pycache__", "site-packages")
    shutil.copytree(Path(prefix) / "lib" / short, folder / "lib" / short, symlinks=True, ignore=left_out)
    for library in (Path(prefix) / "lib").glob(f"lib{short}*.so*"):
        shutil.copy(library, folder / "lib")
    pack("python", version, folder, channel)
    return f"lib/{short}/site-packages"


def make_channel(python: str, folder: Path, channel: Path) -> None:
    """Make all packages and the channel's index."""
    for platform in ("linux-64", "noarch"):
        (channel / platform).mkdir(parents=True)
    inside = pack_python(python, folder / "python", channel)
    for name, wheels in PACKAGES.items():
        target = folder / name / inside
        install = [python, "-m", "pip", "install", "-q", "--no-deps", "--no-compile", "--target", str(target)]
        subprocess.run([*install, "-c", str(ROOT / "constraints.txt"), *wheels], check=True)
        shutil.rmtree(target / "bin", ignore_errors=True)
        (told,) = target.glob(f"{wheels[0].lower()}-*.dist-info")
        version = told.name.removesuffix(".dist-info").split("-")[1]
        pack(name, version, folder / name, channel, "python")
        print(f"channel: {name} {version}", flush=True)
    asyncio.run(index_fs(channel))


def main() -> None:
    """Build, test, and tell the package."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sdist", type=Path, help="as tools.release makes it")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the channel")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_channel(given.python, folder / "files", folder / "channel")
        recipe = folder / "source" / RECIPE
        recipe.parent.mkdir(parents=True)
        shutil.copy(ROOT / RECIPE, recipe)
        (folder / "source/dist").mkdir()
        shutil.copy(given.sdist, folder / "source/dist")
        channel = f"file://{folder / 'channel'}"
        rattler_build.build_recipes([recipe], channel=[channel], test="native", output_dir=folder / "out")
        (made,) = (folder / "out/noarch").glob("bokehnet-*.conda")
        print(f"{made.name}: {made.stat().st_size / 2**20:.1f} MiB, built and tested")


if __name__ == "__main__":
    main()
