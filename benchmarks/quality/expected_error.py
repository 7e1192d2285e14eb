"""Reliability of the expected error: ``python -m benchmarks.quality.expected_error KIND FOLDER``.

The rays render every picture of a set (KIND and FOLDER as in ``python -m train.evaluate --data``), with the
true disparity and with degraded, then repaired disparity, and predict their error. For pixels within reach of
depth discontinuities, the command prints Spearman's rank correlation with the true error, per pixel and for
means over blocks of 8x8 pixels, as mean over pictures; both means; and a reliability table: tenths of all
these pixels by rising expected error, with mean expected and mean true error. The rank correlation of the
true errors of the eight neighbours with that of the pixel bounds the predictable part of a pixel's error.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import uniform_filter
from scipy.stats import spearmanr

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from train.data.degradation import DEGRADATIONS, degrade
from train.scores.evaluation_sets import SETS, Shot, list_pictures
from train.train_error import reliability, true_error

# Side of the blocks, pixels, and the minimum fraction of a block near edges.
_BLOCK_PX, _MIN_FRACTION = 8, 0.5


def block_means(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Return the means of masked pixels over blocks with enough of them, (n,)."""
    height, width = (side // _BLOCK_PX for side in values.shape)

    def sums(array: np.ndarray) -> np.ndarray:
        cut = array[: height * _BLOCK_PX, : width * _BLOCK_PX]
        return cut.reshape(height, _BLOCK_PX, width, _BLOCK_PX).sum((1, 3))

    count, total = sums(mask), sums(values * mask)
    valid = count >= _MIN_FRACTION * _BLOCK_PX**2
    return total[valid] / count[valid]


def mean_around(values: np.ndarray) -> np.ndarray:
    """Return the mean of the eight neighbours of each pixel, (H, W), border repeated."""
    return (9 * uniform_filter(values.astype(np.float64), 3, mode="nearest") - values) / 8


def error_pairs(shot: Shot, disparity: str, repair: DisparityRepair) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return expected and true error of the pixels near edges, (2, n), and rank correlations.

    The correlations are per pixel, per block, and of the neighbours' true errors with the pixel's own.
    """
    degraded = degrade(shot.defocus, disparity)
    defocus = repair(shot.image, degraded, "auto")
    result = Engine("rays").render(
        shot.image, defocus, options=RenderOptions(aperture=shot.aperture, expected_error=True)
    )
    assert result.expected_error is not None
    pictures = {"rays": result.bokeh, "truth": shot.truth}
    batch = {name: torch.from_numpy(picture.transpose(2, 0, 1))[None] for name, picture in pictures.items()}
    near, true = result.error_map > 0, true_error(batch)[0, 0].numpy()
    blocks = [block_means(x, near) for x in (result.expected_error, true)]
    pixels = np.stack([result.expected_error[near], true[near]])
    pairs = (pixels, blocks, (mean_around(true)[near], true[near]))
    return pixels, tuple(float(spearmanr(*pair).statistic) for pair in pairs)


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kind", choices=SETS)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--limit", type=int, help="maximum number of scenes")
    arguments = parser.parse_args()
    pictures, repair = list_pictures(arguments.kind, arguments.folder, arguments.limit), DisparityRepair()
    for disparity in DEGRADATIONS:
        all_pixels, correlations = [], []
        for picture in pictures:
            pixels, correlation = error_pairs(picture.read(), disparity, repair)
            all_pixels.append(pixels)
            correlations.append(correlation)
        expected, true = np.concatenate(all_pixels, axis=1)
        by_pixel, by_block, around = np.mean(correlations, axis=0)
        print(
            f"{disparity} disparity, {len(pictures)} pictures: Spearman {by_pixel:.3f} by pixel, "
            f"{by_block:.3f} by block, {around:.3f} by the true errors around it; "
            f"expected {expected.mean():.2f}, came {true.mean():.2f} levels"
        )
        table = reliability(expected, true)
        for name, values in zip(("expected", "came"), zip(*table, strict=True), strict=True):
            print(f"  {name:9s}" + "".join(f"{value:7.2f}" for value in values), flush=True)


if __name__ == "__main__":
    main()
