"""Maps of a shot made steady: a line is fitted to each value over time, along the motion of its pixel.

Noise of a map is another one in each frame, and edges jump from pixel to pixel; what is real stays, or
changes evenly, where the picture's motion leads. The weight of a frame falls by a constant factor with its
distance in time, so that a fit over all frames takes two passes, one forward and one backward.

Source:
    Brailean et al., "Noise reduction filters for dynamic image sequences: a review", Proceedings of the IEEE
    1995, for recursive filters along motion; Cleveland, "Robust locally weighted regression and smoothing
    scatterplots", JASA 1979, for lines in place of means, which lag behind at both ends of a shot. That one
    filter from behind joins one from before is ours.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.inference.optical_flow import box_mean, follow, optical_flow

__all__ = ["Gathered", "gather", "joined"]

Array = npt.NDArray[np.float32]

# What a frame counts for the next one; half after 23 frames.
_DECAY = 0.97

# Mean squared difference of encoded light, by its root, at which a pixel counts as another one: 1/e is kept.
_OTHER = 0.06

# Squared frames by which a line is held level: where few frames are known, their mean counts.
_LEVEL = 100.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Gathered:
    """What the frames on one side of a frame, and itself, tell of its map.

    Attributes:
        sums: Over frames at distances t from this one, with weights w and values v: of w, w t, w t^2, w v and
            w t v, (H, W, 5).
        picture: Encoded light of the frame, (H, W, 3).
    """

    sums: Array
    picture: Array


def gather(values: Array, picture: Array, before: Gathered | None = None) -> Gathered:
    """Add a frame's map to what those on one side of it told.

    Args:
        values: Its map, (H, W), any unit.
        picture: Its encoded light, (H, W, 3).
        before: What was gathered up to its neighbour; None for the first frame.

    Examples:
        >>> picture = np.full((32, 32, 3), 0.5, np.float32)
        >>> first = gather(np.zeros((32, 32), np.float32), picture)
        >>> second = gather(np.ones((32, 32), np.float32), picture, first)
        >>> second.sums[0, 0].round(2).tolist()
        [1.97, 0.97, 0.97, 1.0, 0.0]
    """
    own = np.zeros((*values.shape, 5), np.float32)
    own[..., 0], own[..., 3] = 1, values
    if before is None:
        return Gathered(sums=own, picture=picture)
    flow = optical_flow(picture, before.picture)
    change = np.square(picture - follow(before.picture, flow)).mean(2)
    alike = np.exp(-box_mean(np.asarray(change, np.float32), 1) / _OTHER**2)
    kept = np.asarray(_DECAY * alike, np.float32) * _inside(flow)
    w, wt, wtt, wv, wtv = np.moveaxis(follow(before.sums, flow) * kept[..., None], 2, 0)
    own += np.stack([w, wt + w, wtt + 2 * wt + w, wv, wtv + wv], 2)  # one frame farther away
    return Gathered(sums=own, picture=picture)


def joined(past: Gathered, future: Gathered, values: Array) -> Array:
    """Return a frame's map, (H, W), by a line through both sides, each of which holds the frame itself.

    Examples:
        >>> picture, level = np.full((32, 32, 3), 0.5, np.float32), np.ones((32, 32), np.float32)
        >>> rising = [gather(t * level, picture) for t in range(3)]
        >>> past, future = (gather(level, picture, rising[t]) for t in (0, 2))
        >>> float(joined(past, future, level)[0, 0])
        1.0
    """
    w, wt, wtt, wv, wtv = np.moveaxis(future.sums + past.sums * np.array([1, -1, 1, 1, -1], np.float32), 2, 0)
    w, wv = w - 1, wv - values
    wtt = wtt + _LEVEL
    return np.asarray((wtt * wv - wt * wtv) / (w * wtt - wt * wt), np.float32)


def _inside(flow: Array) -> npt.NDArray[np.bool_]:
    """Which pixels have moved to within the picture."""
    height, width = flow.shape[:2]
    rows, columns = np.mgrid[:height, :width]
    x, y = columns + flow[..., 0], rows + flow[..., 1]
    inside: npt.NDArray[np.bool_] = (x >= -0.5) & (y >= -0.5) & (x <= width - 0.5) & (y <= height - 0.5)
    return inside
