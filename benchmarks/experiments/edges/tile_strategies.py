"""Post-processes by tile: ``python -m benchmarks.experiments.edges.tile_strategies [FOLDER]``.

Thesis 000, 6.0.1: prints for the path-traced scenes in FOLDER edge PSNR and PSNR in dB and processor seconds,
    with one strategy for the whole picture and with strategies per tile, with discs, means over shots; and
    the fraction of tiles with each strategy.
"""

import argparse
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.quality.theses import SCENES
from bokehnet import baselines
from bokehnet.baselines.gather.half_size import extreme_of_four
from bokehnet.baselines.gather.scatter_as_you_gather import tile_strategies
from bokehnet.baselines.gather.tiles import dilated_tiles
from train.scores.evaluation_sets import path_traced_shots
from train.scores.metrics import depth_step_pixels, encode, psnr

_TILE = 16


def _strategy_fractions(defocus: np.ndarray) -> tuple[float, float, float]:
    """Return the fractions of tiles in focus and of one depth, and the mean number of rings."""
    coc = extreme_of_four(defocus, largest=False) / 2
    nearest, largest = dilated_tiles(coc, _TILE)
    strategies = tile_strategies(nearest, -dilated_tiles(-coc, _TILE)[0], largest)
    return float((strategies == 0).mean()), float((strategies < 0).mean()), float(np.abs(strategies).mean())


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=Path("../shared/cycles"))
    folder = parser.parse_args().folder
    means: dict[tuple[str, bool], list[np.ndarray]] = {}
    for name in SCENES:
        scores: dict[tuple[str, bool], list[tuple[float, float, float]]] = {}
        fractions = []
        for shot in path_traced_shots(folder / name):
            assert shot.disparity is not None
            fractions.append(_strategy_fractions(shot.defocus))
            truth, near = encode(shot.truth), depth_step_pixels(shot.disparity, shot.defocus)
            for method in ("jimenez", "tan"):
                for by_tile in (False, True):
                    render = getattr(baselines, method)
                    render(shot.image[:64, :64], shot.defocus[:64, :64], by_tile=by_tile)
                    start = process_time()
                    bokeh = render(shot.image, shot.defocus, by_tile=by_tile)
                    seconds = process_time() - start
                    squared = (encode(bokeh) - truth) ** 2
                    scores.setdefault((method, by_tile), []).append(
                        (psnr(squared[near]), psnr(squared), seconds)
                    )
        sharp, one_depth, rings = np.mean(fractions, 0)
        print(
            f"{name}: {sharp:.0%} of tiles in focus, {one_depth:.0%} of one depth, "
            f"{rings:.1f} rings in the mean"
        )
        for (method, by_tile), rows in scores.items():
            edge, whole, seconds = np.mean(rows, 0)
            means.setdefault((method, by_tile), []).append(np.mean(rows, 0))
            label = "by tile" if by_tile else "uniform"
            print(f"  {method:8s}{label:8s}{edge:8.2f}{whole:8.2f} dB{seconds:8.2f} s", flush=True)
    print("mean of the scenes")
    for (method, by_tile), scenes in means.items():
        edge, whole, seconds = np.mean(scenes, 0)
        label = "by tile" if by_tile else "uniform"
        print(f"  {method:8s}{label:8s}{edge:8.2f}{whole:8.2f} dB{seconds:8.2f} s")


if __name__ == "__main__":
    main()
