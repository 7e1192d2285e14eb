"""Rims of a soft map that stand out beyond their own surface, taken back.

Networks that tell depth, and filters that enlarge their maps, overshoot at steps: the near side rises once
more before it falls, and the far side falls once more. Making such a step sharp would spread its rims, as
they hold the extremes there; a head would get a ring of another blur than its middle. So what stands out,
by a small part of the step, beyond all that is flat close by is brought back to it. What rises by more is a
thing of its own, a slope is flat up to its end, and a wire has nothing flat beside it at its own height.
"""

import numpy as np

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.depth_repair.stages.edge_sharpening import STEP, extremes, with_halo

__all__ = ["without_overshoots"]

# Half widths of the windows that must be flat, and in which flat ones are sought, pixels, in maps with sides
# of about that many pixels or less. Larger ones were enlarged, rims and all: fewer of their pixels are seen.
_FLAT, _BESIDE, _SIDE = 2, 8, 1024

# Least and largest overshoot, in shares of the step, and what counts as flat. Gibbs' phenomenon has 0.09.
_LEAST, _MOST = 0.015, 0.12


def without_overshoots(disparity: np.ndarray) -> np.ndarray:
    """Return the map (H, W), float32, without the rims that stand out along its steps.

    Args:
        disparity: With soft steps, (H, W), any unit and offset.
    """
    every = max(disparity.shape) // _SIDE
    if every > 1:
        return _with_changes(disparity, every)
    least = STEP * float(np.ptp(disparity))

    def make(rows: slice) -> np.ndarray:
        window, inner = with_halo(rows, 3 * _BESIDE)
        values = np.asarray(disparity[window], np.float32)
        low, high = extremes(values, _BESIDE)
        step, middle = high - low, (low + high) / 2
        lowest, highest = extremes(values, _FLAT)
        wide = extremes(high, _BESIDE)[1] - extremes(low, _BESIDE)[0]
        bumpy = highest - lowest > _LEAST * wide
        near = extremes(np.where(bumpy, -np.inf, values), _BESIDE)[1]
        far = extremes(np.where(bumpy, np.inf, values), _BESIDE)[0]

        def overshoots(height: np.ndarray) -> np.ndarray:
            return (step > least) & (height > _LEAST * step) & (height < _MOST * step)

        values = np.where(overshoots(values - near) & (near > middle), near, values)
        values = np.where(overshoots(far - values) & (far < middle), far, values)
        return np.asarray(values[inner], np.float32)

    return make_in_row_blocks(make, disparity.shape, np.float32)


def _with_changes(disparity: np.ndarray, every: int) -> np.ndarray:
    """A map (H, W) with what changes in one of so many of its rows and columns, spread over all of them."""
    fewer = disparity[every // 2 :: every, every // 2 :: every]
    changes = without_overshoots(fewer) - fewer
    columns = np.minimum(np.arange(disparity.shape[1]) // every, changes.shape[1] - 1)

    def make(rows: slice) -> np.ndarray:
        there = np.minimum(np.arange(*rows.indices(len(disparity))) // every, len(changes) - 1)
        return np.asarray(disparity[rows] + changes[there][:, columns], np.float32)

    return make_in_row_blocks(make, disparity.shape, np.float32)
