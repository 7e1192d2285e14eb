"""Cost and gain of the unmixing of edge pixels.

Run ``python -m benchmarks.experiments.edges.depth_edges [--large] [--scenes 1]``.

Alternates rays with and without unmixing: wall-clock and processor seconds of photograph 21 and of a
    path-traced scene, with ``--large`` also of 24 megapixels. Then prints, for each path-traced scene, edge
    PSNR and SSIM with each pixel filter and with the estimated one. Pictures are those of ``../shared``;
    missing ones are skipped.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.measurement import scene
from benchmarks.quality.tables.score_table import Engine, print_header, print_scores, score
from bokehnet.classical.layered.boundaries import mixed_pixels
from bokehnet.classical.layered.boundaries.edge_spread import estimate_filter
from bokehnet.classical.layered.boundaries.unmixing import MixedPixels
from bokehnet.classical.rays_renderer import rays
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.optics.pixels.pixel_filter import parse_pixel_filter
from train.scores.evaluation_sets import path_traced_shots, scene_folders

SHARED = Path("../shared")
FILTERS = ("blackman-harris", "box", "gaussian", "mitchell")
PAIRS = 5


def _no_unmixing(*_: object) -> MixedPixels:
    none, colors = np.empty(0, np.float32), np.empty((0, 3), np.float32)
    indices = np.empty(0, np.int64)
    return MixedPixels(indices, indices, colors, colors, none, none, none, np.empty(0, bool))


@contextmanager
def without_unmixing() -> Iterator[None]:
    """Treat every pixel as one surface inside this context."""
    originals = mixed_pixels.unmix, mixed_pixels.split_lights
    mixed_pixels.unmix = mixed_pixels.split_lights = _no_unmixing
    try:
        yield
    finally:
        mixed_pixels.unmix, mixed_pixels.split_lights = originals


def pictures(large: bool) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return pictures and defocus for the timing, by name."""
    inputs = {}
    photograph, scenes = SHARED / "real" / "21.jpg", SHARED / "cycles"
    if photograph.exists():
        disparity = read_disparity(photograph.with_suffix(".png"))
        inputs["photograph 21"] = read_image(photograph), defocus_from_disparity(disparity, 60, 0.35)
    if (scenes / "s2_thin_fence").exists():
        shot = next(iter(path_traced_shots(scenes / "s2_thin_fence")))
        inputs["s2"] = shot.image, shot.defocus
    if large:
        inputs["24 megapixels"] = scene(6000, 4000, 40)
    return inputs


def _timed(run: Callable[[], object]) -> tuple[float, float]:
    wall, used = time.perf_counter(), time.process_time()
    run()
    return time.perf_counter() - wall, time.process_time() - used


def print_times(large: bool) -> None:
    """Print one line per picture: medians of seconds, and of the ratios of pairs."""
    print(f"{'picture':16s}{'without':>18s}{'with':>18s}{'ratio of pairs':>18s}   seconds, processor seconds")
    for name, (image, defocus) in pictures(large).items():
        rows = []
        for number in range(PAIRS + 1):
            with without_unmixing():
                plain = _timed(lambda image=image, defocus=defocus: rays(image, defocus))
            unmixed = _timed(lambda image=image, defocus=defocus: rays(image, defocus))
            if number:  # the first pair loads the kernels
                rows.append((plain, unmixed))
        medians = [
            statistics.median(value)
            for value in (
                *([row[side][unit] for row in rows] for side in range(2) for unit in range(2)),
                *([row[1][unit] / row[0][unit] for row in rows] for unit in range(2)),
            )
        ]
        print(
            f"{name:16s}"
            + "".join(f"{a:10.2f}{b:8.2f}" for a, b in zip(medians[::2], medians[1::2], strict=True))
        )


def engines() -> dict[str, Engine]:
    """Return rays with every filter, with the estimated one, and without unmixing."""

    def with_filter(name: str) -> Engine:
        def render(image: np.ndarray, defocus: np.ndarray, *, aperture: Aperture) -> np.ndarray:
            pixel_filter = estimate_filter(image).pixel_filter if name == "auto" else parse_pixel_filter(name)
            return rays(image, defocus, aperture=aperture, pixel_filter=pixel_filter)

        return render

    def plain(image: np.ndarray, defocus: np.ndarray, *, aperture: Aperture) -> np.ndarray:
        with without_unmixing():
            return rays(image, defocus, aperture=aperture)

    return {"none": plain} | {name: with_filter(name) for name in (*FILTERS, "auto")}


def print_quality(limit: int | None) -> None:
    """Print a table for each path-traced scene."""
    if not (SHARED / "cycles").exists():
        return
    print_header("scene")
    rows = []
    for folder in scene_folders(SHARED / "cycles")[:limit]:
        scores = score(path_traced_shots(folder), engines())
        rows += scores
        print_scores(folder.name, scores)
    print_scores("all", rows)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", action="store_true", help="also 24 megapixels")
    parser.add_argument("--scenes", type=int, help="maximum number of path-traced scenes; default: all")
    arguments = parser.parse_args()
    print_times(arguments.large)
    if arguments.scenes != 0:
        print_quality(arguments.scenes)


if __name__ == "__main__":
    main()
