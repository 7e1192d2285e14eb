"""Edge snapping of soft maps: restore blurred detail, then move soft edges to colour edges.

Method: :mod:`bokehnet.depth_repair.stages.deblurring`, then
:mod:`bokehnet.depth_repair.stages.weighted_median`. If an edge bias was corrected, both the input and its
shifted version are candidates for the deblurring, and the one with the smaller residual is used.

In: the picture, scene-linear (H, W, 3), and the repaired map (H, W), any unit. Out: the map in the same unit.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.arrays.halving import half_map, half_mask
from bokehnet.depth_repair.stages.deblurring import estimate_blur, restore_blurred_detail
from bokehnet.depth_repair.stages.weighted_median import snap_blurred_edges

__all__ = ["SoftMap"]

# Maximum ratio of the residuals of the shifted and the input map at which the shifted one is used. Maps that
# were grown or shrunk before they were blurred have 0.24 to 0.7, others 0.68 to 0.92.
_MAX_RESIDUAL_RATIO = 0.73


@dataclass(frozen=True, slots=True)
class SoftMap:
    """Map with soft edges in one or two versions: the input, and the input with its edge bias corrected.

    Attributes:
        versions: Pairs of the pixels at soft edges, (H, W) bool, and the map, (H, W).
    """

    versions: tuple[tuple[np.ndarray, np.ndarray], ...]

    def half(self) -> "SoftMap":
        """Return the map at half its size."""
        return SoftMap(tuple((half_mask(soft), half_map(original)) for soft, original in self.versions))

    def snap(self, image: np.ndarray, repaired: np.ndarray, span: float) -> np.ndarray:
        """Return a repaired map with restored detail and with its soft edges at colour edges, (H, W).

        The shifted version is used if its residual is far smaller, as for maps that were grown before they
        were blurred. The input is better if only blur makes thin structures seem larger.

        Args:
            image: All-in-focus picture, scene-linear, (H, W, 3).
            repaired: Repaired map, (H, W).
            span: Range of the whole map, in its unit.
        """
        candidates = [_with_detail(image, *version, repaired) for version in self.versions]
        best = 0
        if len(candidates) > 1:
            residuals = [
                estimate_blur(original, values, soft).residual
                for (soft, original), values in zip(self.versions, candidates, strict=True)
            ]
            best = int(residuals[1] < _MAX_RESIDUAL_RATIO * residuals[0])
        return snap_blurred_edges(image, candidates[best], self.versions[best][0], span)


def _with_detail(
    image: np.ndarray, soft: np.ndarray, original: np.ndarray, repaired: np.ndarray
) -> np.ndarray:
    """Return a repaired map (H, W) with the detail of a map that has soft edges in some pixels."""
    sigma = estimate_blur(original, repaired, soft).sigma
    return restore_blurred_detail(image, original, repaired, sigma) if sigma else repaired
