"""Where stored pixels lie in the picture that is shown: data window and display window."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Window"]


@dataclass(frozen=True, kw_only=True)
class Window:
    """The rectangle of stored pixels, and the size of the picture that is shown.

    Attributes:
        x: Column of the first stored pixel, counted from the left of the shown picture; negative with
            overscan.
        y: Row of the first stored pixel, counted from the top of the shown picture; negative with overscan.
        width: Stored columns (data window).
        height: Stored rows (data window).
        display_width: Shown columns (display window). A camera's sensor is as wide as these.
        display_height: Shown rows (display window).

    Source: "OpenEXR File Layout" and "Technical Introduction to OpenEXR", openexr.com, Pixel Space.
    """

    x: int
    y: int
    width: int
    height: int
    display_width: int
    display_height: int

    @classmethod
    def whole(cls, width: int, height: int) -> "Window":
        """All that is stored is shown."""
        return cls(x=0, y=0, width=width, height=height, display_width=width, display_height=height)

    def shows_as_much_as(self, other: "Window") -> bool:
        """Whether both display windows are of one size, so that their pixels correspond."""
        return (self.display_width, self.display_height) == (other.display_width, other.display_height)

    def move_onto(self, values: NDArray[Any], other: "Window") -> NDArray[Any]:
        """Take the pixels that ``other`` stores out of ``values`` (H, W, ...) of this window.

        Beyond what is stored here the nearest stored pixel is repeated.
        """
        assert values.shape[:2] == (self.height, self.width)
        assert self.shows_as_much_as(other)
        if self == other:
            return values
        rows = np.clip(np.arange(other.height) + other.y - self.y, 0, self.height - 1)
        columns = np.clip(np.arange(other.width) + other.x - self.x, 0, self.width - 1)
        return np.ascontiguousarray(values[rows][:, columns])

    def shown(self, values: NDArray[Any]) -> NDArray[Any]:
        """Cut ``values`` (H, W, ...) to the display window; what is not stored there is 0."""
        assert values.shape[:2] == (self.height, self.width)
        size = (self.display_height, self.display_width)
        if size == (self.height, self.width) and self.x == self.y == 0:
            return values
        result = np.zeros((*size, *values.shape[2:]), values.dtype)
        top, left = max(self.y, 0), max(self.x, 0)
        bottom, right = min(self.y + self.height, size[0]), min(self.x + self.width, size[1])
        if top >= bottom or left >= right:  # none of what is stored is shown
            return result
        part = values[top - self.y : bottom - self.y, left - self.x : right - self.x]
        result[top : top + part.shape[0], left : left + part.shape[1]] = part
        return result
