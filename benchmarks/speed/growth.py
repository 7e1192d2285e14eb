"""Growth of time with picture size and with blur radius: ``python -m benchmarks.speed.growth``.

Photograph 21 and its map, warm, arrays in memory: the scatter, the rays with all that they need but the
repair of the map, GEGL's ``gegl:lens-blur``, and a literal scatter that adds every pixel to its disc.
Programs run in turns in one process; each row is the median of processor seconds of all threads.

megapixels: the photograph resampled, with a blur in proportion. radius: the photograph at its own size.
SHARED holds ``real/21.jpg`` with its disparity ``21.png``. ``--figures FOLDER`` writes the tables of the
documentation; ``python -m benchmarks.plots`` plots them.
"""

import argparse
import math
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np

from benchmarks.classical import FOCUS, warm_up
from benchmarks.figures import write_figures
from benchmarks.measurement import in_own_process
from benchmarks.methods.rivals import double_loop, open_lens_blur
from bokehnet.arrays.resample import resample
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.coc import defocus_from_disparity

_COMMAND = "python -m benchmarks.speed.growth"

_TITLES = {"scatter": "scatter", "rays": "rays", "gegl": "GEGL lens-blur", "literal": "literal scatter"}

# Additions of a color to a pixel, above which the literal scatter is left out: about 25 processor seconds.
_MAX_LITERAL_ADDITIONS = 2.5e9

# Blur, pixels per unit of disparity, at the photograph's own size of 1.458 megapixels.
_BLUR, _OWN_MEGAPIXELS = 60.0, 1.458


def _photograph(shared: Path, megapixels: float, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Return photograph 21 at a size, (H, W, 3), and its defocus in pixels, (H, W)."""
    image, disparity = read_image(shared / "real/21.jpg"), read_disparity(shared / "real/21.png")
    scale = math.sqrt(megapixels * 1e6 / disparity.size)
    height, width = (round(scale * side) for side in disparity.shape)
    if (height, width) != disparity.shape:
        image, disparity = resample(image, height, width), resample(disparity, height, width)
    return image, defocus_from_disparity(np.clip(disparity, 0, 1), blur, FOCUS)


def measure(shared: Path, megapixels: float, blur: float, threads: int, rounds: int) -> dict[str, float]:
    """Return the largest radius in pixels and the median processor seconds of each program, by key."""
    numba.set_num_threads(threads)
    image, defocus = _photograph(shared, megapixels, blur)
    runs: dict[str, Callable[[], object]] = {
        "scatter": lambda: scatter(image, defocus),
        "rays": lambda: rays(image, defocus),
    }
    for engine in (scatter, rays):
        warm_up(engine)
    lens_blur = open_lens_blur(threads)
    if lens_blur is not None:
        runs["gegl"] = lens_blur(image, defocus)
    if math.pi * float(np.square(defocus).sum()) < _MAX_LITERAL_ADDITIONS:
        double_loop(image[:16, :16].copy(), defocus[:16, :16].copy())
        runs["literal"] = lambda: double_loop(image, defocus)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(rounds):
        for name, run in runs.items():
            start = time.process_time()
            run()
            seconds[name].append(time.process_time() - start)
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    return {"radius": float(np.abs(defocus).max()), **medians}


def _with_ratios(row: dict[str, float]) -> dict[str, float]:
    """Return a row with the multiples of GEGL's and the literal scatter's time."""
    ratios = {
        f"{name}_by_{rival}": row[name] / row[rival]
        for name, rival in (("scatter", "gegl"), ("rays", "gegl"), ("rays", "literal"))
        if rival in row
    }
    return row | ratios


def _columns() -> dict[str, tuple[str, str]]:
    """Return title and format of each column of the figures."""
    return {
        "radius": ("largest radius, px", ".0f"),
        **{name: (f"{title}, s", ".2f") for name, title in _TITLES.items()},
        "scatter_by_gegl": ("scatter / GEGL", ".2f"),
        "rays_by_gegl": ("rays / GEGL", ".1f"),
        "rays_by_literal": ("rays / literal", ".2f"),
    }


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--megapixels", type=float, nargs="*", default=[0.4, 1.458, 6, 24])
    parser.add_argument("--radii", type=float, nargs="*", default=[5, 10, 20, 40, 80, 160])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument(
        "--figures", type=Path, help="folder for growth_megapixels.json and growth_radius.json"
    )
    arguments = parser.parse_args()
    threads = min(2, numba.config.NUMBA_NUM_THREADS)
    blur_by_radius = 1 / max(FOCUS, 1 - FOCUS)
    cases = {
        "megapixels": {
            size: (size, _BLUR * math.sqrt(size / _OWN_MEGAPIXELS)) for size in arguments.megapixels
        },
        "radius": {radius: (_OWN_MEGAPIXELS, radius * blur_by_radius) for radius in arguments.radii},
    }
    for section, positions in cases.items():
        rows: dict[float, dict[str, float]] = {}
        print(f"== {section}: processor seconds of {threads} threads, medians of {arguments.rounds} rounds")
        for at, (megapixels, blur) in positions.items():
            row = in_own_process(measure, arguments.shared, megapixels, blur, threads, arguments.rounds)
            rows[at] = _with_ratios(row)
            numbers = (f"{key} {value:.3g}" for key, value in rows[at].items())
            print(f"{at:7g}  " + "  ".join(numbers), flush=True)
        if arguments.figures and rows:
            conditions = (
                f"photograph 21, warm, {threads} threads, processor seconds, medians of {arguments.rounds} "
                "rounds in turns"
            )
            names = {
                at: f"{at:.3g} megapixels" if section == "megapixels" else f"{at:g} px, 1.46 megapixels"
                for at in rows
            }
            write_figures(
                *(arguments.figures / f"growth_{section}.json", _COMMAND, conditions, _columns()),
                {names[at]: row for at, row in rows.items()},
            )


if __name__ == "__main__":
    main()
