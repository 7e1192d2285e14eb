"""Mutation check: ``python -m tools.mutation_check [--only NUMBER...]``; prints killed and surviving mutants.

Each mutant is one changed expression in a copy of the checkout, in which its test files run: first those of
the quick tier, then, if none fails, all of them. A mutant is killed if a test fails. Numba compiles the
changed kernels anew, so that the check takes about ten minutes.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Mutant:
    """One change of a file, and the tests below ``tests/unit`` that must notice it."""

    path: str
    before: str
    after: str
    tests: str


MUTANTS = (
    # kernels
    Mutant("optics/grain.py", "-2.0 * math.log(u)", "-1.0 * math.log(u)", "optics/test_grain.py"),
    Mutant(
        "optics/pixels/pixel_layers.py",
        "visible += clear[s] * alpha",
        "visible += alpha",
        "optics/pixels/test_pixel_layers.py",
    ),
    Mutant(
        "classical/error_map.py", "columns[x] += counts", "columns[x] = counts", "classical/test_error_map.py"
    ),
    Mutant(
        "classical/error_map.py",
        "if high - low <= threshold:",
        "if high - low <= 2 * threshold:",
        "classical/test_error_map.py",
    ),
    Mutant(
        "classical/scatter/disc_table.py",
        "weights[index, 0] = end",
        "weights[index, 0] = 1.01 * end",
        "classical/scatter/test_disc_table.py",
    ),
    Mutant(
        "classical/scatter/disc_table.py",
        "x_out, y_out = j + 0.5, math.sqrt(radius * radius - (j + 0.5) ** 2)",
        "x_out, y_out = j + 0.5, math.sqrt(radius * radius - j**2)",
        "classical/scatter/test_disc_table.py",
    ),
    Mutant(
        "classical/layered/boundaries/light_carriers.py",
        "coverage = min(along / square, 1.0)",
        "coverage = min(along / square, 0.9)",
        "classical/layered/boundaries/test_light_carriers.py",
    ),
    Mutant(
        "classical/layered/march/defocus_bins.py",
        "reaches[ring, i] + 1.0 >= gap",
        "reaches[ring, i] - 33.0 >= gap",
        "classical/layered/march/test_defocus_bins.py",
    ),
    Mutant(
        "baselines/rays/n_buffers.py",
        "minimum, maximum = min(minimum, low[level, b, a]), max(maximum, high[level, b, a])",
        "minimum, maximum = min(minimum, low[level, b, a]), high[level, b, a]",
        "baselines/rays",
    ),
    Mutant(
        "baselines/gather/basic_gather.py",
        "side = 1.0 if defocus[y, x] > 0.0 else -1.0",
        "side = 1.0",
        "baselines/test_gathers.py",
    ),
    # everything else
    Mutant(
        "optics/coc.py",
        "Values = blur * (disparity - ",
        "Values = blur * (disparity + ",
        "optics/test_coc.py",
    ),
    Mutant("arrays/fusion.py", "+ error_map * neural", "+ error_map**2 * neural", "arrays/test_fusion.py"),
    Mutant("optics/vignette.py", "m * m * (3 - 2 * m)", "m * m", "optics/test_vignette.py"),
    Mutant(
        "optics/focus_plane.py",
        "(about_y / size[0], -about_x / size[1])",
        "(about_y / size[0], about_x / size[1])",
        "optics/test_focus_plane.py",
    ),
    Mutant("optics/paraxial.py", "before.b / before.a", "before.b", "optics/test_paraxial.py"),
    Mutant("io/color/dither.py", "+ top) * _STEP_Y", ") * _STEP_Y", "io/color/test_dither.py"),
    Mutant(
        "io/containers/png.py",
        "np.where(to_above <= to_corner, above, corner)",
        "np.where(to_above < to_corner, above, corner)",
        "io/containers/test_png.py",
    ),
    Mutant(
        "io/exr/deep.py",
        "density = -np.log1p(-np.where(opaque, 0, alpha))",
        "density = np.where(opaque, 0, alpha)",
        "io/exr/test_deep.py",
    ),
    Mutant("io/exr/header.py", "if name in attributes:", "if False:", "io/exr/test_header.py"),
    Mutant(
        "io/depth/depth_coding.py",
        "1 / ((1 - values) / first + values / last)",
        "(1 - values) / first + values / last",
        "io/depth/test_phone_depth.py",
    ),
)


def run_tests(folder: Path, tests: Iterable[str], tier: str) -> bool:
    """Return whether a test fails in a copy of the checkout.

    Args:
        folder: Copy of the checkout.
        tests: Files or folders below ``tests/unit``.
        tier: "quick" or "all".

    Raises:
        SystemExit: pytest could not run the tests.
    """
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
    paths = [f"tests/unit/{name}" for name in tests]
    command += (
        ["-o", f"testpaths={' '.join(paths)}"] if tier == "quick" else paths
    )  # arguments select all tests
    process = subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=False)
    if process.returncode not in (0, 1, 5):  # 5: no test of that tier
        raise SystemExit(f"{' '.join(paths)}: pytest ended with {process.returncode}")
    return process.returncode == 1


def main() -> None:
    """Print one line for each mutant, and the number killed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", type=int, nargs="+", help="numbers of mutants, from 1")
    numbers = parser.parse_args().only or range(1, len(MUTANTS) + 1)
    killed = {"quick": 0, "all": 0}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for part in ("bokehnet", "train", "benchmarks", "tests"):
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copy(ROOT / "pyproject.toml", folder)
        if run_tests(folder, sorted({MUTANTS[number - 1].tests for number in numbers}), "quick"):
            raise SystemExit("the tests must pass before a change")
        for number in numbers:
            mutant = MUTANTS[number - 1]
            path = folder / "bokehnet" / mutant.path
            source = path.read_text("utf-8")
            path.write_text(source.replace(mutant.before, mutant.after), "utf-8")
            tier = next((tier for tier in killed if run_tests(folder, [mutant.tests], tier)), None)
            path.write_text(source, "utf-8")
            if tier is not None:
                killed[tier] += 1
            outcome = "SURVIVED" if tier is None else f"killed ({tier})"
            print(f"{number:2d} {outcome:14s} {mutant.path}: {mutant.after}", flush=True)
    print(
        f"killed {killed['quick']} of {len(numbers)} by the quick tier, {sum(killed.values())} by all tests"
    )


if __name__ == "__main__":
    main()
