"""Regions of a picture that hold clipped pixels, and gains on their light."""

from dataclasses import dataclass

import numpy as np

from bokehnet.light.bright_picture import Array, BrightPicture, Floats
from bokehnet.light.components import Components, connected_components

__all__ = ["LightRegions", "light_regions"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LightRegions:
    """Regions above half the clip level that hold clipped pixels.

    Light is relative to the clip level, sums are over the pixels of a region.

    Attributes:
        pixels: Pixels of the regions.
        level: Clip level.
        bright: Light of the darkest pixel of a region.
    """

    pixels: Components
    level: float
    bright: float

    def sums(self, image: Array) -> Floats:
        """Return the sums of an image (H, W, 3) over regions, relative to the clip level, (regions, 3)."""
        values = image[self.pixels.rows, self.pixels.columns].astype(np.float64) / self.level
        return np.stack([self.pixels.sums(values[:, channel]) for channel in range(3)], -1)

    def with_sums(self, image: Array, recovered: Array, sums: Floats) -> Array:
        """Return a picture in which the light of the regions has other sums, at least those of ``image``.

        The excess has the distribution of the excess of ``recovered``; in regions without any, that of the
        square of the light above ``bright``.

        Args:
            image: Scene-linear picture, (H, W, 3).
            recovered: The same with recovered light.
            sums: Sums of the light of each region, (regions, 3).
        """
        at, labels = (self.pixels.rows, self.pixels.columns), self.pixels.labels
        stored = image[at].astype(np.float64)
        excess = recovered[at].astype(np.float64) - stored
        bright = self.bright * self.level
        shape = np.clip((stored - bright) / (self.level - bright), 0, 1) ** 2
        flux = np.maximum(sums - self.sums(image), 0) * self.level
        result = image.copy()
        for channel in range(3):
            weights = excess[:, channel]
            for other in (shape[:, channel], shape.max(-1)):
                weights = np.where(self.pixels.sums(weights)[labels] > 0, weights, other)
            scale = flux[:, channel] / np.maximum(self.pixels.sums(weights), 1e-6)
            result[(*at, channel)] += (scale[labels] * weights).astype(np.float32)
        return result


def light_regions(picture: BrightPicture) -> LightRegions:
    """Return the regions of a picture, which may be none."""
    bright = picture.config.bright
    pixels = connected_components(picture.highest >= bright * picture.level)
    clipped = pixels.sums(picture.highest[pixels.rows, pixels.columns] >= picture.level) > 0
    inside = clipped[pixels.labels]
    pixels = Components(
        rows=pixels.rows[inside],
        columns=pixels.columns[inside],
        labels=(np.cumsum(clipped) - 1)[pixels.labels[inside]],
        count=int(clipped.sum()),
    )
    return LightRegions(pixels=pixels, level=picture.level, bright=bright)
