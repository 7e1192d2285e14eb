"""Position of stored pixels in the displayed picture: data window and display window."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.viewport import Viewport

__all__ = ["Window", "plausible_aspect"]

# Aspect ratios of pixels beyond this or its inverse are faults, and within the tolerance of 1 rounding.
_MIN_PIXEL_ASPECT, _SQUARE_TOLERANCE = 0.25, 0.01


@dataclass(frozen=True, kw_only=True)
class Window:
    """Rectangle of the stored pixels, and size of the displayed picture.

    Attributes:
        x: Column of the first stored pixel, from the left of the display window; negative with overscan.
        y: Row of the first stored pixel, from the top of the display window; negative with overscan.
        width: Width of the data window, pixels.
        height: Height of the data window, pixels.
        display_width: Width of the display window, pixels; corresponds to the width of a camera's sensor.
        display_height: Height of the display window, pixels.
        pixel_aspect: Width over height of a pixel as displayed.

    Source: "OpenEXR File Layout" and "Technical Introduction to OpenEXR", openexr.com, Pixel Space.
    """

    x: int
    y: int
    width: int
    height: int
    display_width: int
    display_height: int
    pixel_aspect: float = 1.0

    @classmethod
    def whole(cls, width: int, height: int) -> "Window":
        """Return a window whose data window equals its display window."""
        return cls(x=0, y=0, width=width, height=height, display_width=width, display_height=height)

    @property
    def viewport(self) -> Viewport:
        """Position of the stored pixels in the displayed picture."""
        return Viewport(left=self.x, top=self.y, width=self.display_width, height=self.display_height)

    def has_same_display_size(self, other: "Window") -> bool:
        """Return whether both display windows have the same size, so that their pixels correspond."""
        return (self.display_width, self.display_height) == (other.display_width, other.display_height)

    def fit_to(self, values: NDArray[Any], other: "Window") -> NDArray[Any]:
        """Crop or extend ``values`` (H, W, ...) from this data window to that of ``other``.

        Pixels outside this data window repeat the nearest stored pixel.
        """
        assert values.shape[:2] == (self.height, self.width)
        assert self.has_same_display_size(other)
        if self == other:
            return values
        rows = np.clip(np.arange(other.height) + other.y - self.y, 0, self.height - 1)
        columns = np.clip(np.arange(other.width) + other.x - self.x, 0, self.width - 1)
        return np.ascontiguousarray(values[rows][:, columns])

    def crop_to_display(self, values: NDArray[Any]) -> NDArray[Any]:
        """Crop ``values`` (H, W, ...) to the display window; pixels outside the data window are 0."""
        assert values.shape[:2] == (self.height, self.width)
        size = (self.display_height, self.display_width)
        if size == (self.height, self.width) and self.x == self.y == 0:
            return values
        result = np.zeros((*size, *values.shape[2:]), values.dtype)
        top, left = max(self.y, 0), max(self.x, 0)
        bottom, right = min(self.y + self.height, size[0]), min(self.x + self.width, size[1])
        if top >= bottom or left >= right:  # the windows do not intersect
            return result
        part = values[top - self.y : bottom - self.y, left - self.x : right - self.x]
        result[top : top + part.shape[0], left : left + part.shape[1]] = part
        return result


def plausible_aspect(aspect: float) -> float:
    """Return width over height of a pixel from a file; 1 if it is implausible or nearly square.

    Examples:
        >>> [plausible_aspect(value) for value in (2.0, 1.005, 1000.0)]
        [2.0, 1.0, 1.0]
    """
    is_fault = not _MIN_PIXEL_ASPECT <= aspect <= 1 / _MIN_PIXEL_ASPECT
    return 1.0 if is_fault or abs(aspect - 1) < _SQUARE_TOLERANCE else aspect
