"""Temporal filter of the maps of a shot: a line is fitted to each value over time, along its pixel's motion.

The noise of a map differs in each frame, and edges jump between pixels; real structure remains or changes
linearly along the motion of the picture. The weight of a frame falls by a constant factor with its distance
in time, so that a fit over all frames takes two passes, one forward and one backward. The statistics of a
pixel move unchanged to the nearest pixel, with the remaining subpixel offset: interpolated, they would spread
over edges from frame to frame. Values are differences from the frame's own, so that a shot of equal frames
keeps its map bit by bit. The slope of a line is shrunk according to its standard error: at jumping edges it
would otherwise differ in each frame.

Source:
    Brailean et al., "Noise reduction filters for dynamic image sequences: a review", Proceedings of the IEEE
    1995, for recursive filters along motion; Cleveland, "Robust locally weighted regression and smoothing
    scatterplots", JASA 1979, for lines instead of means, which lag at both ends of a shot; James and Stein,
    "Estimation with quadratic loss", Berkeley Symposium 1961, for the shrinkage of the slope. The combination
    of a forward and a backward filter is original to this package.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.row_blocks import make_in_row_blocks
from bokehnet.sequence.optical_flow import box_mean, optical_flow, warp

__all__ = ["TemporalStatistics", "accumulate", "filtered_map"]

Array = npt.NDArray[np.float32]
Half = npt.NDArray[np.float16]

# Factor of the weight from frame to frame; the weight halves after 23 frames.
_DECAY = 0.97

# Root mean squared difference of encoded light at which the weight falls to 1/e.
_COLOR_SIGMA = 0.06

# Largest offset of statistics from their pixel; farther ones belong to another point.
_MAX_OFFSET_PX = 1.0

# Slopes below this squared multiple of their standard error are set to zero.
_SLOPE_SIGNIFICANCE = 9.0

# Ridge regularisation of the slope, squared frames: with few frames the fit is the mean.
_SLOPE_RIDGE = 100.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class TemporalStatistics:
    """Weighted statistics of a frame's map and of the frames on one side of it.

    Attributes:
        moments: Over frames at distances t from this one, with weights w and values that differ by d from
            those of this frame: the sum of w, the means of t, t^2, d, t d and d^2, and the offset of the
            tracked point from the pixel, right and down, pixels, (H, W, 8).
        values: Map of the frame, (H, W).
        picture: Encoded light of the frame, (H, W, 3).
    """

    moments: Half
    values: Array
    picture: Array


def accumulate(values: Array, picture: Array, before: TemporalStatistics | None = None) -> TemporalStatistics:
    """Add a frame's map to the statistics of the frames on one side of it.

    Args:
        values: Map of the frame, (H, W), any unit.
        picture: Encoded light of the frame, (H, W, 3).
        before: Statistics up to the neighbouring frame; None for the first frame, and if the size has
            changed.

    Examples:
        >>> picture = np.full((32, 32, 3), 0.5, np.float32)
        >>> first = accumulate(np.zeros((32, 32), np.float32), picture)
        >>> second = accumulate(np.ones((32, 32), np.float32), picture, first)
        >>> second.moments[0, 0].round(2).tolist()  # total weight 1.97; the other frame is lower by 1
        [1.97, 0.49, 0.49, -0.49, -0.49, 0.49, 0.0, 0.0]
    """
    if before is None:
        moments = np.zeros((*values.shape, 8), np.float16)
        moments[..., 0] = 1
        return TemporalStatistics(moments=moments, values=values, picture=picture)
    flow = optical_flow(picture, before.picture)
    change = make_in_row_blocks(
        lambda rows: np.square(picture[rows] - warp(before.picture, flow[rows], rows.start)).mean(2),
        values.shape,
        np.float32,
    )
    similarity = np.exp(-box_mean(change, 1) / _COLOR_SIGMA**2) * _inside(flow)
    weight = np.asarray(_DECAY * similarity, np.float32)
    moments = make_in_row_blocks(
        lambda rows: _added(rows, values, before, flow, weight), (*values.shape, 8), np.float16
    )
    return TemporalStatistics(moments=moments, values=values, picture=picture)


def filtered_map(past: TemporalStatistics, future: TemporalStatistics) -> Array:
    """Return a frame's map, (H, W), from a line fitted to both sides, each of which includes the frame.

    Examples:
        >>> picture, level = np.full((32, 32, 3), 0.5, np.float32), np.ones((32, 32), np.float32)
        >>> rising = [accumulate(t * level, picture) for t in range(3)]
        >>> past, future = (accumulate(level, picture, rising[t]) for t in (0, 2))
        >>> float(filtered_map(past, future)[0, 0])
        1.0
    """

    def make(rows: slice) -> Array:
        w, t, tt, d, td, dd = _sums(future.moments[rows]) + _sums(past.moments[rows]) * _TIME_REVERSAL
        w -= 1  # both sides include the frame itself
        mean_time, spread = t / w, tt - t * t / w + _SLOPE_RIDGE
        slope = (td - mean_time * d) / spread
        explained = slope * slope * spread
        residual = np.maximum(dd - d * d / w - explained, 0) / w
        shrinkage = np.maximum(1 - _SLOPE_SIGNIFICANCE * residual / np.maximum(explained, _TINY), 0)
        return np.asarray(future.values[rows] + d / w - shrinkage * slope * mean_time, np.float32)

    return make_in_row_blocks(make, future.values.shape, np.float32)


# Signs of the sums under reversal of time.
_TIME_REVERSAL = np.array([1, -1, 1, 1, -1, 1], np.float32)[:, None, None]

_TINY = np.float32(1e-30)


def _sums(moments: npt.NDArray[np.floating]) -> Array:
    """Return the sums of w, w t, w t^2, w d, w t d and w d^2, (6, H, W)."""
    sums = np.moveaxis(moments[..., :6].astype(np.float32), 2, 0)
    sums[1:] *= sums[0]
    return sums


def _added(rows: slice, values: Array, before: TemporalStatistics, flow: Array, weight: Array) -> Half:
    """Return the moments of some rows of a frame, including all frames before it."""
    height, width = values.shape
    x, y = np.arange(width) + flow[rows, :, 0], np.arange(rows.start, rows.stop)[:, None] + flow[rows, :, 1]

    def nearest(y: Array, x: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
        line, column = np.rint(y).astype(np.intp), np.rint(x).astype(np.intp)
        return np.clip(line, 0, height - 1), np.clip(column, 0, width - 1)

    offset = before.moments[nearest(y, x)][..., 6:].astype(np.float32)
    at = nearest(y - offset[..., 1], x - offset[..., 0])
    moved = before.moments[at].astype(np.float32)
    w, wt, wtt, wd, wtd, wdd = _sums(moved)
    shift = np.asarray(before.values[at] - values[rows], np.float32)
    wdd += shift * (2 * wd + shift * w)
    wd, wtd = wd + shift * w, wtd + shift * wt
    moments = np.stack([w, wt + w, wtt + 2 * wt + w, wd, wtd + wd, wdd, *np.moveaxis(moved[..., 6:], 2, 0)])
    moments[6] += at[1] - x
    moments[7] += at[0] - y
    moments *= weight[rows] * (np.abs(moments[6:]).max(0) <= _MAX_OFFSET_PX)  # one frame farther away
    moments[0] += 1
    moments[1:6] /= moments[0]
    return np.moveaxis(moments, 0, 2).astype(np.float16)


def _inside(flow: Array) -> npt.NDArray[np.bool_]:
    """Return the mask of pixels whose motion ends inside the picture."""
    height, width = flow.shape[:2]
    x, y = np.arange(width) + flow[..., 0], np.arange(height)[:, None] + flow[..., 1]
    inside: npt.NDArray[np.bool_] = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
    return inside
