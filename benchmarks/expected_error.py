"""Whether what is expected comes: ``python -m benchmarks.expected_error KIND FOLDER``.

The rays render every picture of a set (KIND and FOLDER as of ``python -m train.evaluate --data``), with the
true disparity and with wrong ones that are repaired first, and tell what error they expect. Printed are, for
pixels within reach of depth discontinuities, Spearman's rank correlation with the true error, pixel by
pixel and for means over blocks of 8x8 pixels, the mean over pictures; both means; and a reliability table:
tenths of all these pixels, from the least to the most expected, with what was expected and what came. How
much of a pixel's error is chance tells the rank correlation of somebody who knows the true errors of the
eight pixels around it.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import uniform_filter
from scipy.stats import spearmanr

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.engines.engine import Engine
from train.degradation import DEGRADATIONS, degrade
from train.evaluation_sets import SETS, Shot, list_pictures
from train.train_error import reliability, true_error

# Side of the blocks, pixels, and the least part of one that must lie near edges.
_BLOCK, _PART = 8, 0.5


def block_means(values: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Means of chosen pixels over the blocks in which there are enough of them, (n,)."""
    height, width = (side // _BLOCK for side in values.shape)

    def sums(array: np.ndarray) -> np.ndarray:
        cut = array[: height * _BLOCK, : width * _BLOCK]
        return cut.reshape(height, _BLOCK, width, _BLOCK).sum((1, 3))

    count, total = sums(chosen), sums(values * chosen)
    enough = count >= _PART * _BLOCK**2
    return total[enough] / count[enough]


def mean_around(values: np.ndarray) -> np.ndarray:
    """Mean of the eight neighbours of each pixel, (H, W); the border is repeated."""
    return (9 * uniform_filter(values.astype(np.float64), 3, mode="nearest") - values) / 8


def examined(shot: Shot, disparity: str, repair: DisparityRepair) -> tuple[np.ndarray, tuple[float, ...]]:
    """Expected and true error of the pixels near edges, (2, n), and rank correlations.

    These are by pixel, by block, and of the true errors around each pixel with its own.
    """
    given = degrade(shot.defocus, disparity)
    defocus = repair(shot.image, given, "auto")
    found = Engine("rays").render(shot.image, defocus, aperture=shot.aperture, expected_error=True)
    assert found.expected_error is not None
    pictures = {"rays": found.bokeh, "truth": shot.truth}
    batch = {name: torch.from_numpy(picture.transpose(2, 0, 1))[None] for name, picture in pictures.items()}
    near, true = found.error_map > 0, true_error(batch)[0, 0].numpy()
    blocks = [block_means(x, near) for x in (found.expected_error, true)]
    pixels = np.stack([found.expected_error[near], true[near]])
    pairs = (pixels, blocks, (mean_around(true)[near], true[near]))
    return pixels, tuple(float(spearmanr(*pair).statistic) for pair in pairs)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kind", choices=SETS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=int, help="this many scenes only")
    arguments = parser.parse_args()
    pictures, repair = list_pictures(arguments.kind, arguments.folder, arguments.limit), DisparityRepair()
    for disparity in DEGRADATIONS:
        everything, correlations = [], []
        for picture in pictures:
            pixels, told_apart = examined(picture.read(), disparity, repair)
            everything.append(pixels)
            correlations.append(told_apart)
        told, true = np.concatenate(everything, axis=1)
        by_pixel, by_block, around = np.mean(correlations, axis=0)
        print(
            f"{disparity} disparity, {len(pictures)} pictures: Spearman {by_pixel:.3f} by pixel, "
            f"{by_block:.3f} by block, {around:.3f} by the true errors around it; "
            f"expected {told.mean():.2f}, came {true.mean():.2f} levels"
        )
        table = reliability(told, true)
        for name, values in zip(("expected", "came"), zip(*table, strict=True), strict=True):
            print(f"  {name:9s}" + "".join(f"{value:7.2f}" for value in values), flush=True)


if __name__ == "__main__":
    main()
