"""Steps of a soft map put where the picture has them, once the map is repaired and explains the given one."""

from dataclasses import dataclass

import numpy as np

from bokehnet.arrays.halving import half_map, half_mask
from bokehnet.depth_repair.stages.deblurring import explain_soft_map, find_softness
from bokehnet.depth_repair.stages.weighted_median import settle_soft_steps

__all__ = ["SoftMap"]

# What is left of a shifted soft map when it is explained, over what is left of the given one, up to which it
# is believed. Maps that were grown or shrunk before they were blurred have 0.24 to 0.7, others 0.68 to 0.92.
_BELIEVED = 0.73


@dataclass(frozen=True, slots=True)
class SoftMap:
    """A map with soft steps, in one or two versions: with things as large as given, and shifted.

    Attributes:
        versions: Where steps are soft, (H, W) bool, and the map, (H, W), of each.
    """

    versions: tuple[tuple[np.ndarray, np.ndarray], ...]

    def half(self) -> "SoftMap":
        """The same at half its size."""
        return SoftMap(tuple((half_mask(steps), half_map(given)) for steps, given in self.versions))

    def settle(self, image: np.ndarray, repaired: np.ndarray, span: float) -> np.ndarray:
        """Put into a repaired map (H, W) what it lacks, and its steps where the colours of (H, W, 3) part.

        It lacks what a version of the map shows: the shifted one if that comes out far better. Things that
        were grown before they were blurred come out so; where blur alone makes thin ones seem larger, the
        given one tells more.
        """
        whole = [_explained(image, *version, repaired) for version in self.versions]
        best = 0
        if len(whole) > 1:
            rests = [
                find_softness(given, values, steps).rest
                for (steps, given), values in zip(self.versions, whole, strict=True)
            ]
            best = int(rests[1] < _BELIEVED * rests[0])
        return settle_soft_steps(image, whole[best], self.versions[best][0], span)


def _explained(image: np.ndarray, steps: np.ndarray, given: np.ndarray, repaired: np.ndarray) -> np.ndarray:
    """A repaired map (H, W) with what it lacks of a given one that is soft at those steps."""
    deviation = find_softness(given, repaired, steps).deviation
    return explain_soft_map(image, given, repaired, deviation) if deviation else repaired
