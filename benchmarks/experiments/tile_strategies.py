"""Post-processes that treat each tile as it needs: ``python -m benchmarks.experiments.tile_strategies [FOLDER]``.

Thesis 000, 6.0.1: on the path-traced scenes in FOLDER, edge PSNR and PSNR in dB and seconds of the processor,
the whole picture alike and by tile, with discs, means over shots; and the share of tiles that take each way.
"""

import argparse
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.theses import SCENES
from bokehnet import baselines
from bokehnet.baselines.gather.half_size import extreme_of_four
from bokehnet.baselines.gather.scatter_as_you_gather import tile_strategies
from bokehnet.baselines.gather.tiles import dilated_tiles
from train.evaluation_sets import path_traced_shots
from train.metrics import depth_step_pixels, encode, psnr

_TILE = 16


def _shares(defocus: np.ndarray) -> tuple[float, float, float]:
    """Of tiles in focus, of one depth and of others; and their mean number of rings."""
    coc = extreme_of_four(defocus, largest=False) / 2
    nearest, largest = dilated_tiles(coc, _TILE)
    ways = tile_strategies(nearest, -dilated_tiles(-coc, _TILE)[0], largest)
    return float((ways == 0).mean()), float((ways < 0).mean()), float(np.abs(ways).mean())


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, nargs="?", default=Path("../shared/cycles"))
    folder = parser.parse_args().folder
    means: dict[tuple[str, bool], list[np.ndarray]] = {}
    for name in SCENES:
        found: dict[tuple[str, bool], list[tuple[float, float, float]]] = {}
        shares = []
        for shot in path_traced_shots(folder / name):
            assert shot.disparity is not None
            shares.append(_shares(shot.defocus))
            wanted, near = encode(shot.truth), depth_step_pixels(shot.disparity, shot.defocus)
            for method in ("jimenez", "tan"):
                for by_tile in (False, True):
                    render = getattr(baselines, method)
                    render(shot.image[:64, :64], shot.defocus[:64, :64], by_tile=by_tile)
                    begun = process_time()
                    bokeh = render(shot.image, shot.defocus, by_tile=by_tile)
                    seconds = process_time() - begun
                    squared = (encode(bokeh) - wanted) ** 2
                    found.setdefault((method, by_tile), []).append(
                        (psnr(squared[near]), psnr(squared), seconds)
                    )
        sharp, alike, rings = np.mean(shares, 0)
        print(
            f"{name}: {sharp:.0%} of tiles in focus, {alike:.0%} of one depth, {rings:.1f} rings in the mean"
        )
        for (method, by_tile), rows in found.items():
            edge, whole, seconds = np.mean(rows, 0)
            means.setdefault((method, by_tile), []).append(np.mean(rows, 0))
            way = "by tile" if by_tile else "alike"
            print(f"  {method:8s}{way:8s}{edge:8.2f}{whole:8.2f} dB{seconds:8.2f} s", flush=True)
    print("mean of the scenes")
    for (method, by_tile), scenes in means.items():
        edge, whole, seconds = np.mean(scenes, 0)
        way = "by tile" if by_tile else "alike"
        print(f"  {method:8s}{way:8s}{edge:8.2f}{whole:8.2f} dB{seconds:8.2f} s")


if __name__ == "__main__":
    main()
