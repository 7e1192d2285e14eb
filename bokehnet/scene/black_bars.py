"""Black bars of letterboxed and pillarboxed pictures: detection, and rendering without them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.io.window import Window

__all__ = ["BlackBars", "find_black_bars"]

Array = npt.NDArray[np.float32]

# Largest light of a bar, which compressed video lifts by a level or two of 255.
_MAX_BLACK = 0.0015

# Largest light next to the picture, in as many lines of a bar, where lossy compression rings.
_MAX_RINGING, _RINGING_PX = 0.012, 16

# Minimum width of each of two opposite bars, fraction of the side; maximum difference of their widths, pixels
# and fraction of the side.
_MIN_BAR, _MAX_DIFFERENCE_PX, _MAX_DIFFERENCE = 0.02, 2, 0.01

# The line next to a bar is picture: at least this fraction of it is brighter than the bar.
_MIN_BRIGHT = 0.5


@dataclass(frozen=True, kw_only=True, slots=True)
class BlackBars:
    """Widths of the bars in pixels.

    Examples:
        >>> picture = np.zeros((6, 8, 3), np.float32)
        >>> BlackBars(top=2, bottom=2).inside(picture).shape
        (2, 8, 3)
    """

    top: int = 0
    bottom: int = 0
    left: int = 0
    right: int = 0

    def inside(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return the part of an array (H, W, ...) between the bars."""
        height, width = values.shape[:2]
        part = values[self.top : height - self.bottom, self.left : width - self.right]
        return np.ascontiguousarray(part)

    def around(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an array (h, w, ...) with bars of 0 around it."""
        padding = [(self.top, self.bottom), (self.left, self.right), *[(0, 0)] * (values.ndim - 2)]
        return np.pad(values, padding)

    def window_inside(self, window: Window) -> Window:
        """Return the window of the pixels between the bars."""
        return replace(
            window,
            x=window.x + self.left,
            y=window.y + self.top,
            width=window.width - self.left - self.right,
            height=window.height - self.top - self.bottom,
        )


def find_black_bars(image: Array) -> BlackBars | None:
    """Return the black bars of a picture; None unless they are certain.

    Bars are black to within two levels, lie on opposite sides, are equally wide, and end at a straight line
    beyond which most of the picture is brighter. In the 16 lines next to the picture they may ring.

    Args:
        image: Scene-linear picture, (H, W, 3).

    Examples:
        >>> picture = np.full((100, 80, 3), 0.2, np.float32)
        >>> find_black_bars(picture) is None
        True
        >>> picture[:12] = picture[-12:] = 0
        >>> find_black_bars(picture)
        BlackBars(top=12, bottom=12, left=0, right=0)
    """
    if image[0].max() > _MAX_BLACK and image[:, 0].max() > _MAX_BLACK:
        return None
    light = image.max(axis=2)
    rows = _pair(light)
    columns = _pair(light[rows[0] : len(light) - rows[1]].T)
    if not any(rows) and not any(columns):
        return None
    return BlackBars(top=rows[0], bottom=rows[1], left=columns[0], right=columns[1])


def _pair(light: Array) -> tuple[int, int]:
    """Return the heights of the bars above and below, 0 and 0 unless they are certain."""
    size = len(light)
    first, last = _bar(light), _bar(light[::-1])
    is_wide = min(first, last) >= max(1, _MIN_BAR * size)
    is_equal = abs(first - last) <= max(_MAX_DIFFERENCE_PX, _MAX_DIFFERENCE * size)
    return (first, last) if is_wide and is_equal else (0, 0)


def _bar(light: Array) -> int:
    """Return the height of the bar above; 0 unless it ends at a straight line."""
    brightest = light.max(axis=1)
    lit = np.flatnonzero(brightest > _MAX_BLACK)
    if not len(lit):
        return 0
    first = int(lit[0])
    if np.mean(light[first] > _MAX_BLACK) >= _MIN_BRIGHT:
        return first
    beyond = np.flatnonzero(brightest[first : first + _RINGING_PX + 1] > _MAX_RINGING)
    end = first + int(beyond[0]) if len(beyond) else first
    return end if np.mean(light[end] > _MAX_RINGING) >= _MIN_BRIGHT else 0
