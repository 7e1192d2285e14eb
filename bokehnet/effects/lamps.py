"""Lamps of a picture: the pixels that diffraction and reflections are seen of."""

from dataclasses import dataclass

import numpy as np

__all__ = ["Lamps", "find_lamps"]

# Blur radii are rounded to this share of themselves, and to no less than so many pixels.
_STEP, _FINEST = 0.02, 0.5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Lamps:
    """Pixels above a threshold.

    Attributes:
        row: Of each, (N,).
        column: The same.
        light: Scene-linear, (N, 3).
        defocus: Signed blur radius, pixels, (N,).
    """

    row: np.ndarray
    column: np.ndarray
    light: np.ndarray
    defocus: np.ndarray

    def __len__(self) -> int:
        return len(self.row)

    def reduced(self, factor: int) -> "Lamps":
        """The same lamps in a picture that is smaller by a whole factor."""
        return Lamps(
            row=self.row // factor,
            column=self.column // factor,
            light=self.light / factor**2,
            defocus=self.defocus / factor,
        )

    def by_blur(self) -> list[tuple[float, "Lamps"]]:
        """Groups of lamps of nearly one blur radius, and that radius; 0 for those in focus."""
        size = np.maximum(np.abs(self.defocus), _FINEST)
        # Even steps below where a step of the share is as wide as the finest, even ratios above.
        knee = _FINEST / _STEP
        code = np.where(
            size < knee, size / _FINEST, knee / _FINEST + np.log(np.maximum(size / knee, 1)) / _STEP
        )
        code = (np.sign(self.defocus) * np.round(code)).astype(int)
        code[np.abs(self.defocus) < _FINEST] = 0
        found = []
        for one in np.unique(code):
            chosen = code == one
            group = Lamps(
                row=self.row[chosen],
                column=self.column[chosen],
                light=self.light[chosen],
                defocus=self.defocus[chosen],
            )
            found.append((float(group.defocus.mean()) if one else 0.0, group))
        return found

    def drawn(self, top: int, left: int, height: int, width: int) -> np.ndarray:
        """Their light in a cut of the picture, (height, width, 3), float64."""
        light = np.zeros((height, width, 3))
        np.add.at(light, (self.row - top, self.column - left), self.light)
        return light


def find_lamps(image: np.ndarray, defocus: np.ndarray, threshold: float) -> Lamps:
    """Find the pixels of (H, W, 3) whose brightest channel reaches ``threshold``."""
    row, column = np.nonzero(image.max(-1) >= threshold)
    return Lamps(
        row=row,
        column=column,
        light=image[row, column].astype(np.float64),
        defocus=defocus[row, column].astype(np.float64),
    )
