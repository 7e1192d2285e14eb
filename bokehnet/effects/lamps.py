"""Lamps of a picture: pixels bright enough for visible diffraction and reflections."""

from dataclasses import dataclass

import numpy as np

__all__ = ["Lamps", "find_lamps"]

# Relative step to which blur radii are rounded, and minimum step in pixels.
_RELATIVE_STEP, _MIN_STEP_PX = 0.02, 0.5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lamps:
    """Pixels above a threshold.

    Attributes:
        row: Row of each, (N,).
        column: Column of each, (N,).
        light: Scene-linear color, (N, 3).
        defocus: Signed blur radius, pixels, (N,).
    """

    row: np.ndarray
    column: np.ndarray
    light: np.ndarray
    defocus: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def reduced(self, factor: int) -> "Lamps":
        """Return the same lamps in a picture that is smaller by an integer factor."""
        return Lamps(
            row=self.row // factor,
            column=self.column // factor,
            light=self.light / factor**2,
            defocus=self.defocus / factor,
        )

    def grouped_by_blur(self) -> list[tuple[float, "Lamps"]]:
        """Return groups of lamps with nearly the same blur radius, and that radius; 0 for lamps in focus."""
        size = np.maximum(np.abs(self.defocus), _MIN_STEP_PX)
        # Constant steps below the radius at which both steps are equal, constant ratios above.
        knee = _MIN_STEP_PX / _RELATIVE_STEP
        code = np.where(
            size < knee,
            size / _MIN_STEP_PX,
            knee / _MIN_STEP_PX + np.log(np.maximum(size / knee, 1)) / _RELATIVE_STEP,
        )
        code = (np.sign(self.defocus) * np.round(code)).astype(int)
        code[np.abs(self.defocus) < _MIN_STEP_PX] = 0
        groups = []
        for group_code in np.unique(code):
            members = code == group_code
            group = Lamps(
                row=self.row[members],
                column=self.column[members],
                light=self.light[members],
                defocus=self.defocus[members],
            )
            groups.append((float(group.defocus.mean()) if group_code else 0.0, group))
        return groups

    def drawn(self, top: int, left: int, height: int, width: int) -> np.ndarray:
        """Return their light in a window of the picture, (height, width, 3), float64."""
        light = np.zeros((height, width, 3))
        np.add.at(light, (self.row - top, self.column - left), self.light)
        return light


def find_lamps(image: np.ndarray, defocus: np.ndarray, threshold: float) -> Lamps:
    """Return the pixels of (H, W, 3) whose brightest channel reaches ``threshold``."""
    row, column = np.nonzero(image.max(-1) >= threshold)
    return Lamps(
        row=row,
        column=column,
        light=image[row, column].astype(np.float64),
        defocus=defocus[row, column].astype(np.float64),
    )
