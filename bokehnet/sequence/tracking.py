"""Tracking of a point of the picture through a shot, by optical flow."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.sequence.optical_flow import optical_flow, warp

__all__ = ["TrackedPoint", "track_point", "track_through"]

Array = npt.NDArray[np.float32]

# Half width of the patch whose median motion moves the point, and of the surroundings in which motion is
# estimated; at least these, and this fraction of the shorter side.
_PATCH_RADIUS_PX, _PATCH_FRACTION = 4, 0.01
_SURROUNDINGS_RADIUS_PX, _SURROUNDINGS_FRACTION = 64, 0.2

# Loss of track: distance between a point and itself after a step forward and back, and root mean squared
# difference of encoded light between the patch and its position one frame later, less their mean difference.
_MAX_RETURN_ERROR_PX, _MAX_PATCH_CHANGE = 1.0, 0.08


@dataclass(frozen=True, kw_only=True, slots=True)
class TrackedPoint:
    """Position of a tracked point in a frame.

    Attributes:
        number: Number of the frame.
        x: Distance from the left border, pixels; 0 is the centre of the first pixel.
        y: Distance from the upper border, pixels.
        is_lost: True if the point was lost in this frame or before; its position is then the last known one.

    Examples:
        >>> TrackedPoint(number=1001, x=812.4, y=440.0).is_lost
        False
    """

    number: int
    x: float
    y: float
    is_lost: bool = False


def track_point(frames: Iterable[tuple[int, Array]], x: float, y: float) -> Iterator[TrackedPoint]:
    """Yield the position of a point in each frame, from its position in the first.

    The point moves by the median optical flow of a patch around it. It counts as lost if it leaves the
    picture, if the flow back does not lead to where it came from, or if its surroundings change.

    Args:
        frames: Numbers and encoded light, (H, W, 3), of successive frames.
        x: Distance from the left border in the first frame, pixels.
        y: Distance from the upper border in the first frame, pixels.

    Source:
        Kalal, Mikolajczyk and Matas, "Forward-backward error: automatic detection of tracking failures", ICPR
        2010.

    Examples:
        >>> rng = np.random.default_rng(0)
        >>> grain = np.repeat(rng.random((64, 80, 1), dtype=np.float32), 3, 2)
        >>> path = list(track_point([(t, grain[:, 2 * t : 2 * t + 64]) for t in range(3)], 32, 32))
        >>> [(round(point.x), round(point.y)) for point in path]  # the camera pans by two pixels a frame
        [(32, 32), (30, 32), (28, 32)]
    """
    before: Array | None = None
    is_lost = False
    for number, picture in frames:
        if before is not None and not is_lost:
            moved = _moved(before, picture, x, y)
            is_lost = moved is None
            x, y = moved or (x, y)
        yield TrackedPoint(number=number, x=x, y=y, is_lost=is_lost)
        before = picture


def track_through(
    read: Callable[[int], Array], numbers: Sequence[int], x: float, y: float, start: int
) -> list[TrackedPoint]:
    """Return the positions of a point in all frames, from its position in one of them, ascending.

    Args:
        read: Function that returns the encoded light of a frame, (H, W, 3), by its number.
        numbers: Numbers of the frames, ascending; ``start`` is one of them.
        x: Distance from the left border in the frame ``start``, pixels.
        y: Distance from the upper border in the frame ``start``, pixels.
        start: Number of the frame in which the position is known.

    Examples:
        >>> grain = np.repeat(np.random.default_rng(0).random((64, 80, 1), dtype=np.float32), 3, 2)
        >>> path = track_through(lambda t: grain[:, 2 * t : 2 * t + 64], range(3), 32, 32, start=1)
        >>> [(point.number, round(point.x)) for point in path]
        [(0, 34), (1, 32), (2, 30)]
    """
    index = list(numbers).index(start)
    after = track_point(((number, read(number)) for number in numbers[index:]), x, y)
    before = track_point(((number, read(number)) for number in reversed(numbers[: index + 1])), x, y)
    return [*reversed(list(before)[1:]), *after]


def _moved(before: Array, after: Array, x: float, y: float) -> tuple[float, float] | None:
    """Return the position one frame later; None if it is lost."""
    height, width = before.shape[:2]
    if before.shape != after.shape:
        return None
    reach = max(_SURROUNDINGS_RADIUS_PX, round(_SURROUNDINGS_FRACTION * min(height, width)))
    rows, columns = (slice(max(0, round(center) - reach), round(center) + reach + 1) for center in (y, x))
    first, second = before[rows, columns], after[rows, columns]
    forward, backward = optical_flow(first, second), optical_flow(second, first)
    radius = max(_PATCH_RADIUS_PX, round(_PATCH_FRACTION * min(height, width)))
    patch = _patch(x - columns.start, y - rows.start, radius, first.shape)
    motion = np.median(forward[patch], (0, 1))
    back = warp(backward, np.broadcast_to(motion, forward.shape).astype(np.float32))[patch]
    if np.hypot(*(motion + np.median(back, (0, 1)))) > _MAX_RETURN_ERROR_PX:
        return None
    change = first[patch] - warp(second, np.broadcast_to(motion, forward.shape).astype(np.float32))[patch]
    if np.sqrt(np.square(change - change.mean((0, 1))).mean()) > _MAX_PATCH_CHANGE:
        return None
    x, y = float(x + motion[0]), float(y + motion[1])
    return (x, y) if 0 <= x <= width - 1 and 0 <= y <= height - 1 else None


def _patch(x: float, y: float, radius: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return rows and columns of the patch around a point, inside a picture."""
    column, row = min(max(round(x), 0), shape[1] - 1), min(max(round(y), 0), shape[0] - 1)
    return (
        slice(max(0, row - radius), row + radius + 1),
        slice(max(0, column - radius), column + radius + 1),
    )
