"""Seconds to the first picture with an empty kernel cache: ``python -m benchmarks.speed.first_picture``.

Commands run one after the other, each in its own process, with one numba cache that is initially empty: each
compiles what earlier commands have not. ``--compile`` compiles all kernels with numba, as on machines without
precompiled kernels. The last line is the size of the installed packages. ``--figures`` writes the table
of the documentation: processor seconds, which other load changes little.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from importlib.metadata import distribution
from pathlib import Path

import bokehnet
from benchmarks.figures import write_figures
from bokehnet.precompiled.library import OFF

_ASSETS = Path(bokehnet.__file__).parent / "assets"
_PHOTO = ("render", str(_ASSETS / "demo.png"), "--disparity", str(_ASSETS / "demo_disparity.png"))
_BASE = (*_PHOTO, "--blur", "38", "--focus", "0.46", "-o", "out.png")

COMMANDS: dict[str, tuple[str, ...]] = {
    "demo": ("demo", "-o", "demo.png"),
    "render": _BASE,
    "engine hybrid": (*_BASE, "--engine", "hybrid"),
    "six blades": (*_BASE, "--blades", "6"),
    "preset anamorphic": (*_BASE, "--preset", "anamorphic"),
    "preset petzval-swirl": (*_BASE, "--preset", "petzval-swirl"),
    "colour fringes": (*_BASE, "--axial-fringe", "0.4"),
    "lens double_gauss": (*_BASE, "--lens", "double_gauss"),
    "film grain": (*_BASE, "--grain", "1600"),
}
_PACKAGES = ("bokehnet", "numba", "llvmlite", "numpy", "onnxruntime", "OpenImageIO")


def measure(words: tuple[str, ...], environment: dict[str, str], folder: Path) -> tuple[float, float]:
    """Return wall-clock seconds and user CPU seconds of one command line."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, time.perf_counter()
    command = [sys.executable, "-m", "bokehnet", *words]
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    return time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before


def megabytes(package: str) -> float | None:
    """Return the size of an installed package, MB."""
    if package == "bokehnet":
        files = [
            path for path in Path(bokehnet.__file__).parent.rglob("*") if "__pycache__" not in path.parts
        ]
    else:
        files = [Path(str(path.locate())) for path in distribution(package).files or ()]
    return sum(path.stat().st_size for path in files if path.is_file()) / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--compile", action="store_true", help="compile all kernels with numba")
    parser.add_argument("--figures", type=Path, metavar="FILE", help="write the figures to this JSON file")
    parser.add_argument("names", nargs="*", help=f"some of {', '.join(COMMANDS)}; default: all")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [str(Path(bokehnet.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": ":".join(paths)}
        environment[OFF] = str(int(arguments.compile))
        print("| command | first run, s | CPU, s | compiled | second run, s | CPU, s |")
        print("|---|---|---|---|---|---|")
        compiled, rows = 0, {}
        for command in arguments.names or COMMANDS:
            first = measure(COMMANDS[command], environment, folder)
            total = len(list(folder.rglob("*.nbc")))
            second = measure(COMMANDS[command], environment, folder)
            new, compiled = total - compiled, total
            rows[command] = {"cpu": first[1], "compiled": new}
            seconds = [f"{value:.1f}" for value in (*first, *second)]
            print(f"| {command} | {' | '.join([*seconds[:2], str(new), *seconds[2:]])} |", flush=True)
    if arguments.figures:
        columns = {"cpu": ("user CPU, s", ".1f"), "compiled": ("kernels compiled", ".0f")}
        line = "python -m benchmarks.speed.first_picture --figures docs/figures/first_picture.json"
        conditions = "first run of each command, machine code, empty numba cache; a machine with other load"
        write_figures(arguments.figures, line, conditions, columns, rows)
    sizes = {package: megabytes(package) for package in _PACKAGES}
    print("\nMB: " + ", ".join(f"{package} {size:.1f}" for package, size in sizes.items()))


if __name__ == "__main__":
    main()
