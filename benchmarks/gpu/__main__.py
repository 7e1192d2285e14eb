"""All that a CUDA card must show, in nine minutes: ``python -m benchmarks.gpu --out FOLDER``.

First the tests marked ``gpu``, which compare the card with the CPU; a failure ends the command. Then the time
of scatter, rays and the engine ``hybrid`` at 1920x1080 and at 12 megapixels, copies included, with their
difference to the CPU. Last the profile of a render by ``rays`` at 1920x1080: the functions in which most time
is spent. ``FOLDER/cuda.json`` has the timings, ``FOLDER/profile.txt`` the profile.
:mod:`benchmarks.gpu.cases` has more cases and no bound of time.

Without a card the command prints one line and fails; ``--dry-run`` runs timings and profile on tiny pictures
in numba's simulator of a card.
"""

import argparse
import cProfile
import io
import os
import pstats
import subprocess
import sys
from pathlib import Path

import torch

_TESTS = ("tests/unit/classical", "tests/unit/engines/test_devices.py")

# Time after which no further timing starts, and bound of the tests, seconds: the profile fits into the rest.
_TIMING_SECONDS, _TEST_SECONDS = 440.0, 150.0

# Width and height of the timed pictures: 2 and 12 megapixels.
_SIZES = ((1920, 1080), (4240, 2832))

_SIMULATED_SIZE = (32, 24)

# Functions in the profile.
_PROFILED_FUNCTIONS = 25


def run_tests() -> None:
    """Run the tests of the card; exit if one fails."""
    words = [sys.executable, "-m", "pytest", "-q", "-m", "gpu", "--all", *_TESTS]
    try:
        done = subprocess.run(words, timeout=_TEST_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        print(f"tests stopped after {_TEST_SECONDS:g} s")
        return
    if done.returncode:
        raise SystemExit(f"the card differs from the CPU: pytest ended with exit code {done.returncode}")


def profile(width: int, height: int, device: str) -> str:
    """Return the profile of one warm render by rays: the functions with most time of their own."""
    from benchmarks.gpu.cases import BLURS
    from benchmarks.gpu.measurement import synchronize
    from benchmarks.measurement import scene
    from bokehnet.render.renderer import BokehRenderer

    image, radii = scene(width, height, BLURS["usual"] * width)
    renderer = BokehRenderer("rays", device=device)
    renderer.render_arrays(image, radii)
    profiler = cProfile.Profile()
    with profiler:
        renderer.render_arrays(image, radii)
        synchronize()
    text = io.StringIO()
    pstats.Stats(profiler, stream=text).sort_stats("tottime").print_stats(_PROFILED_FUNCTIONS)
    return text.getvalue()


def measure(out: Path | None, device: str) -> None:
    """Print timings and profile; write both to a folder."""
    from benchmarks.gpu.cases import APERTURES, BLURS, Bench
    from benchmarks.gpu.measurement import Report

    report = Report(out, _TIMING_SECONDS)
    bench = Bench(report, 5 if device == "cuda" else 1, device)
    sizes = _SIZES if device == "cuda" else (_SIMULATED_SIZE,)
    for width, height in sizes:
        blur = (BLURS["usual"] if device == "cuda" else 0.2) * width
        bench.scatter("disc", width, height, blur, APERTURES["disc"])
        bench.rays("disc", width, height, blur, APERTURES["disc"])
        if device == "cuda":
            bench.renderer("hybrid", width, height, blur, "hybrid")
    text = profile(*sizes[0], device)
    print(text)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "profile.txt").write_text(text, encoding="utf-8")
    failed = sum("failure" in row for row in report.content["rows"])
    raise SystemExit(f"{failed} cases failed" if failed else 0)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, help="folder for cuda.json and profile.txt")
    parser.add_argument("--dry-run", action="store_true", help="without a card: tiny pictures, simulated")
    arguments = parser.parse_args()
    if torch.cuda.is_available():
        run_tests()
        measure(arguments.out, "cuda")
    if not arguments.dry_run:
        version = torch.__version__
        raise SystemExit(f"no CUDA device found by torch {version}: nothing measured; see --dry-run")
    if os.environ.get("NUMBA_ENABLE_CUDASIM") != "1":  # numba reads it when it is imported
        words = [sys.executable, "-W", "ignore", "-m", "benchmarks.gpu", *sys.argv[1:]]
        environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}
        raise SystemExit(subprocess.run(words, env=environment, check=False).returncode)
    measure(arguments.out, "cpu")


if __name__ == "__main__":
    main()
