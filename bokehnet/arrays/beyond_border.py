"""Continuation of a picture beyond its border, for discs of blur that reach across it.

The border pixel is repeated. On path-traced pictures, in the band of 32 pixels along the border, this is
0.8 dB better for the scatter than dividing by the part of the disc inside, and 0.6 dB better than mirroring
(``python -m benchmarks.experiments.edges.borders FOLDER``). Where the border pixel differs from the pixels
next to it, as a line along a whole side or a lamp does, repeating it would multiply its light by the radius
of the blur: there the nearest pixels are mirrored, and the median of the pixels along the normal of the
border follows.
"""

import numpy as np
import numpy.typing as npt

__all__ = ["COMPARED_PX", "LAMP_RATIOS", "LIGHT_FLOOR", "LINE_RATIOS", "beyond_border"]

Array = npt.NDArray[np.float32]

# Pixels along the normal of the border that are compared with the border pixel.
COMPARED_PX = 9

# Ratio of the light of the border pixel to that median, up to which it is repeated and from which on the
# pixels are mirrored: of lamps, and in the median over a side, or its inverse, of lines. Light below the
# floor counts as equal.
LAMP_RATIOS, LINE_RATIOS, LIGHT_FLOOR = (3.0, 4.0), (1.6, 2.0), 0.02


def beyond_border(image: Array, above: int, below: int, left: int, right: int) -> Array:
    """Return a picture with more pixels around it.

    Args:
        image: Scene-linear picture, (H, W, C).
        above: Number of rows to add above.
        below: Number of rows to add below.
        left: Number of columns to add on the left.
        right: Number of columns to add on the right.

    Examples:
        >>> image = np.full((6, 20, 3), 0.25, np.float32)
        >>> image[:, 0] = 1  # a bright line along the border
        >>> [round(float(value), 2) for value in beyond_border(image, 0, 0, 3, 3)[0, :5, 0]]
        [0.25, 0.25, 1.0, 1.0, 0.25]
    """
    height, width, channels = image.shape
    larger = np.empty((above + height + below, left + width + right, channels), image.dtype)
    middle = larger[above : above + height]
    middle[:, left : left + width] = image
    columns = image.swapaxes(0, 1)
    _continue(columns, middle[:, :left][:, ::-1].swapaxes(0, 1))
    _continue(columns[::-1], middle[:, left + width :].swapaxes(0, 1))
    _continue(middle, larger[:above][::-1])
    _continue(middle[::-1], larger[above + height :])
    return larger


def _continue(rows: Array, beyond: Array) -> None:
    """Fill ``beyond`` (n, W, C), from the border outwards, with the continuation of ``rows`` (H, W, C)."""
    if not len(beyond):
        return
    beyond[:] = rows[:1]
    nearest = rows[:COMPARED_PX]
    light = nearest.mean(axis=-1) + np.float32(LIGHT_FLOOR)
    ratio = light[0] / np.median(light, axis=0)
    of_side = float(np.median(ratio))
    weight = np.maximum(_weight(ratio, LAMP_RATIOS), _weight(max(of_side, 1 / of_side), LINE_RATIOS))
    outliers = np.flatnonzero(weight > 0)
    if not len(outliers):
        return
    other = np.broadcast_to(np.median(nearest[:, outliers], axis=0), beyond[:, outliers].shape).copy()
    mirrored = min(len(beyond), len(nearest) // 2 + 1)
    other[:mirrored] = nearest[:mirrored, outliers]
    share = weight[outliers, None].astype(beyond.dtype)
    beyond[:, outliers] = (1 - share) * beyond[:, outliers] + share * other


def _weight(ratio: npt.ArrayLike, ends: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Return 0 up to the first end, 1 from the second on, and linear values between."""
    low, high = ends
    weight: npt.NDArray[np.float64] = np.clip((np.asarray(ratio, np.float64) - low) / (high - low), 0, 1)
    return weight
