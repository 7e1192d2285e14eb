"""Acceptance of a repair: one rule for every place and for every stage.

The map moves only where the edges of the picture agree better with the new edges than with the old ones. The
evidence is the edge profile (:mod:`bokehnet.depth_repair.edge_profile`), which no stage that proposes
changes uses at a single place.

Method: the agreement of edges near changed pixels is averaged, in the old and in the new map, in windows of
40x40 pixels and shrunk towards the mean of the whole map (additive smoothing with a pseudo-count). Edges that
only one of the maps has count as edges without agreement in the other one. A change is accepted where the
mean rises by a minimum gain.

In: the picture, scene-linear (3, H, W), and both maps, (H, W), in one unit. Out: the blocks of 8x8 pixels in
which the change is accepted.
"""

import numpy as np

from bokehnet.arrays.square_windows import dilated
from bokehnet.depth_repair.config import BLOCK_PX, MAX_AGREEMENT, MIN_EDGE_HEIGHT, NEAR_PX, RepairConfig
from bokehnet.depth_repair.edge_profile import DISTANCES_PX, sample_edges

__all__ = ["accepted_blocks", "block_pixels", "changed_pixels"]


def changed_pixels(old: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return the pixels that change by more than half the height of the lowest depth edge, (H, W) bool."""
    return np.abs(new - old) > 0.5 * MIN_EDGE_HEIGHT * float(np.ptp(old))


def accepted_blocks(image: np.ndarray, old: np.ndarray, new: np.ndarray, config: RepairConfig) -> np.ndarray:
    """Return the blocks in which the picture agrees better with the new map, (H / 8, W / 8) bool, rounded up.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (3, H, W).
        old: Map before the repair, (H, W), any unit.
        new: Map after the repair, (H, W).
        config: Numbers of the repair.
    """
    shape = tuple(-(-side // BLOCK_PX) for side in old.shape)
    changed = changed_pixels(old, new)
    if not changed.any():
        return np.zeros(shape, bool)
    near = dilated(changed, NEAR_PX)
    (old_counts, old_sums), (new_counts, new_sums) = (
        _block_sums(image, values, near) for values in (old, new)
    )
    prior, radius = config.agreement_prior, config.agreement_window_blocks
    edges = np.maximum(_window_sums(old_counts, radius), _window_sums(new_counts, radius))
    edges_of_map = max(old_counts.sum(), new_counts.sum()) + prior
    sums = new_sums - old_sums
    gains = (_window_sums(sums, radius) + prior * sums.sum() / edges_of_map) / (edges + prior)
    accepted: np.ndarray = gains > config.min_gain
    return accepted


def block_pixels(blocks: np.ndarray, shape: tuple[int, ...], scale: int = 1) -> np.ndarray:
    """Return the pixels of accepted blocks, (H, W) bool.

    Args:
        blocks: Blocks at the size of the comparison, from :func:`accepted_blocks`.
        shape: Shape (H, W) of a map.
        scale: Ratio of the size of that map and the size of the comparison.
    """
    rows, columns = (np.arange(side) // (scale * BLOCK_PX) for side in shape)
    return blocks[rows[:, None], columns]


def _block_sums(image: np.ndarray, disparity: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number of edge pixels in a mask and the sum of their agreement, both (H / 8, W / 8)."""
    edges = sample_edges(image, disparity, mask=mask)
    agreement = edges.heights[:, len(DISTANCES_PX) // 2].min(0).clip(-MAX_AGREEMENT, MAX_AGREEMENT)
    rows, columns = (edges.places / BLOCK_PX).astype(np.intp)
    counts, sums = np.zeros((2, *(-(-side // BLOCK_PX) for side in disparity.shape)))
    np.add.at(counts, (rows, columns), 1)
    np.add.at(sums, (rows, columns), agreement)
    return counts, sums


def _window_sums(values: np.ndarray, radius: int) -> np.ndarray:
    """Return the sums of values over the square window around each block."""
    size = 2 * radius + 1
    sums = np.pad(np.pad(values, radius), ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    rows = sums[size:] - sums[:-size]
    windows: np.ndarray = rows[:, size:] - rows[:, :-size]
    return windows
