"""Maps of a shot made steady: a line is fitted to each value over time, along the motion of its pixel.

Noise of a map is another one in each frame, and edges jump from pixel to pixel; what is real stays, or
changes evenly, where the picture's motion leads. The weight of a frame falls by a constant factor with its
distance in time, so that a fit over all frames takes two passes, one forward and one backward. What a pixel
knows goes on whole to the pixel to which it moves, with what is left of its way: taken from between pixels,
it would spread over edges from frame to frame. Values count as differences from the frame's own, so that a
shot of equal frames keeps its map to the last bit. The slope of a line counts as far as it stands above its
own error: at edges that jump it would else be another one in each frame.

Source:
    Brailean et al., "Noise reduction filters for dynamic image sequences: a review", Proceedings of the IEEE
    1995, for recursive filters along motion; Cleveland, "Robust locally weighted regression and smoothing
    scatterplots", JASA 1979, for lines in place of means, which lag behind at both ends of a shot; James and
    Stein, "Estimation with quadratic loss", Berkeley Symposium 1961, for the share of a slope. That one
    filter from behind joins one from before is ours.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.sequence.optical_flow import box_mean, follow, optical_flow

__all__ = ["Gathered", "gather", "joined"]

Array = npt.NDArray[np.float32]
Half = npt.NDArray[np.float16]

# What a frame counts for the next one; half after 23 frames.
_DECAY = 0.97

# Mean squared difference of encoded light, by its root, at which a pixel counts as another one: 1/e is kept.
_OTHER = 0.06

# Pixels beside a pixel from which on what is told of a place is not its own.
_ASIDE = 1.0

# Errors, squared, up to which a slope is none.
_ERRORS = 9.0

# Squared frames by which a line is held level: where few frames are known, their mean counts.
_LEVEL = 100.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Gathered:
    """What the frames on one side of a frame, and itself, tell of its map.

    Attributes:
        told: Over frames at distances t from this one, with weights w and values that differ by d from this
            one's: the sum of w, the means of t, t^2, d, t d and d^2, and by how many pixels the place that
            they tell of is right of and below the pixel, (H, W, 8).
        values: The frame's own map, (H, W).
        picture: Its encoded light, (H, W, 3).
    """

    told: Half
    values: Array
    picture: Array


def gather(values: Array, picture: Array, before: Gathered | None = None) -> Gathered:
    """Add a frame's map to what those on one side of it told.

    Args:
        values: Its map, (H, W), any unit.
        picture: Its encoded light, (H, W, 3).
        before: What was gathered up to its neighbour; None for the first frame, and where the neighbour is
            of another size.

    Examples:
        >>> picture = np.full((32, 32, 3), 0.5, np.float32)
        >>> first = gather(np.zeros((32, 32), np.float32), picture)
        >>> second = gather(np.ones((32, 32), np.float32), picture, first)
        >>> second.told[0, 0].round(2).tolist()  # of 1.97 frames' weight, the other one is lower by 1
        [1.97, 0.49, 0.49, -0.49, -0.49, 0.49, 0.0, 0.0]
    """
    if before is None:
        alone = np.zeros((*values.shape, 8), np.float16)
        alone[..., 0] = 1
        return Gathered(told=alone, values=values, picture=picture)
    flow = optical_flow(picture, before.picture)
    change = make_in_row_blocks(
        lambda rows: np.square(picture[rows] - follow(before.picture, flow[rows], rows.start)).mean(2),
        values.shape,
        np.float32,
    )
    alike = np.exp(-box_mean(change, 1) / _OTHER**2) * _inside(flow)
    kept = np.asarray(_DECAY * alike, np.float32)
    told = make_in_row_blocks(
        lambda rows: _added(rows, values, before, flow, kept), (*values.shape, 8), np.float16
    )
    return Gathered(told=told, values=values, picture=picture)


def joined(past: Gathered, future: Gathered) -> Array:
    """Return a frame's map, (H, W), by a line through both sides, each of which holds the frame itself.

    Examples:
        >>> picture, level = np.full((32, 32, 3), 0.5, np.float32), np.ones((32, 32), np.float32)
        >>> rising = [gather(t * level, picture) for t in range(3)]
        >>> past, future = (gather(level, picture, rising[t]) for t in (0, 2))
        >>> float(joined(past, future)[0, 0])
        1.0
    """

    def make(rows: slice) -> Array:
        w, t, tt, d, td, dd = _sums(future.told[rows]) + _sums(past.told[rows]) * _BACKWARDS
        w -= 1  # the frame itself stands on both sides
        middle, spread = t / w, tt - t * t / w + _LEVEL
        slope = (td - middle * d) / spread
        explained = slope * slope * spread
        rest = np.maximum(dd - d * d / w - explained, 0) / w
        share = np.maximum(1 - _ERRORS * rest / np.maximum(explained, _TINY), 0)
        return np.asarray(future.values[rows] + d / w - share * slope * middle, np.float32)

    return make_in_row_blocks(make, future.values.shape, np.float32)


# Signs of sums over frames whose distances count the other way.
_BACKWARDS = np.array([1, -1, 1, 1, -1, 1], np.float32)[:, None, None]

_TINY = np.float32(1e-30)


def _sums(told: npt.NDArray[np.floating]) -> Array:
    """Sums of w, w t, w t^2, w d, w t d and w d^2, (6, H, W)."""
    sums = np.moveaxis(told[..., :6].astype(np.float32), 2, 0)
    sums[1:] *= sums[0]
    return sums


def _added(rows: slice, values: Array, before: Gathered, flow: Array, kept: Array) -> Half:
    """What some rows of a frame know with all before it."""
    height, width = values.shape
    x, y = np.arange(width) + flow[rows, :, 0], np.arange(rows.start, rows.stop)[:, None] + flow[rows, :, 1]

    def nearest(y: Array, x: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        line, column = np.rint(y).astype(np.intp), np.rint(x).astype(np.intp)
        return np.clip(line, 0, height - 1), np.clip(column, 0, width - 1)

    aside = before.told[nearest(y, x)][..., 6:].astype(np.float32)
    at = nearest(y - aside[..., 1], x - aside[..., 0])
    told = before.told[at].astype(np.float32)
    w, wt, wtt, wd, wtd, wdd = _sums(told)
    other = np.asarray(before.values[at] - values[rows], np.float32)
    wdd += other * (2 * wd + other * w)
    wd, wtd = wd + other * w, wtd + other * wt
    found = np.stack([w, wt + w, wtt + 2 * wt + w, wd, wtd + wd, wdd, *np.moveaxis(told[..., 6:], 2, 0)])
    found[6] += at[1] - x
    found[7] += at[0] - y
    found *= kept[rows] * (np.abs(found[6:]).max(0) <= _ASIDE)  # one frame farther away
    found[0] += 1
    found[1:6] /= found[0]
    return np.moveaxis(found, 0, 2).astype(np.float16)


def _inside(flow: Array) -> npt.NDArray[np.bool_]:
    """Which pixels have moved to within the picture."""
    height, width = flow.shape[:2]
    x, y = np.arange(width) + flow[..., 0], np.arange(height)[:, None] + flow[..., 1]
    inside: npt.NDArray[np.bool_] = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
    return inside
