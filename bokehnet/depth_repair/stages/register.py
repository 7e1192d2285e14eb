"""Registration: translation of a map and growth of its foreground regions, in one search.

A map has an offset if it comes from another camera or crop, or if it was enlarged with pixel corners aligned
instead of centres. Foreground regions are too large or too small everywhere in maps of stereo windows and of
some networks.

Method: exhaustive search, for both on a coarse grid and around its best point, for the displacement of all
depth edges at which they agree best with the picture (:mod:`bokehnet.depth_repair.edge_profile`). An edge
with the normal n moves by n . o - g for an offset o and a growth g. Of growth, offset, and both, the simplest
within one standard error of the best is used (Breiman et al., "Classification and Regression Trees", 1984).
It must agree clearly better than the map as it is.

In: the picture, scene-linear (3, H, W), and a sharp map (H, W), any unit. Out: a :class:`Placement`.
"""

import math
from dataclasses import dataclass
from itertools import product

import numpy as np

from bokehnet.depth_repair.config import MAX_SAMPLES, MIN_RELATIVE_AGREEMENT, STANDARD_ERRORS, RepairConfig
from bokehnet.depth_repair.edge_profile import EdgeSamples, sample_edges
from bokehnet.depth_repair.filters import shift_edges, translate_map

__all__ = ["NO_PLACEMENT", "Placement", "find_placement", "verified"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Placement:
    """Displacement that aligns the edges of a map with those of its picture.

    Attributes:
        offset: Translation of the map down and to the right, pixels.
        growth: Pixels by which foreground regions grow after the translation, negative to shrink.
        certainty: Agreement of the displaced edges with the picture minus two standard errors.
    """

    offset: tuple[int, int] = (0, 0)
    growth: int = 0
    certainty: float = 0.0

    def apply(self, disparity: np.ndarray) -> np.ndarray:
        """Return the displaced map, (H, W)."""
        return shift_edges(translate_map(disparity, self.offset), self.growth)


# Placement of a map that stays where it is.
NO_PLACEMENT = Placement()


def find_placement(image: np.ndarray, disparity: np.ndarray, config: RepairConfig) -> Placement:
    """Return the displacement with the best agreement; none unless it is significant.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (3, H, W).
        disparity: Map with sharp edges, (H, W), any unit.
        config: Numbers of the repair.
    """
    edges = sample_edges(image, disparity, MAX_SAMPLES)
    if not len(edges.weights):
        return NO_PLACEMENT
    limit = config.max_shift_px
    reach = range(-limit, limit + 1)
    # From the simplest displacement to the one with all three parameters.
    displacements = (
        _best([(0, 0)], reach, edges),
        _best(list(product(reach, reach)), range(1), edges),
        _best_growth_and_offset(edges, limit),
    )
    candidates = []
    for displacement in displacements:
        moved, agreement, error = verified(image, disparity, displacement, edges.count)
        of_edges = edges.agreement(_displacement(edges, displacement))[0]
        candidates.append((of_edges, min(agreement, of_edges), agreement, error, moved))
    # The edges of a repeated pattern agree with others of it, but much less than with their own.
    most = max(candidate[0] for candidate in candidates)
    lowest = min(most, MIN_RELATIVE_AGREEMENT * most)  # the agreement may be negative
    candidates = [candidate for candidate in candidates if candidate[0] >= lowest]
    _, highest, _, tolerance, _ = max(candidates, key=lambda candidate: candidate[1])
    *_, agreement, error, best = next(c for c in candidates if c[1] >= highest - tolerance)
    margin = STANDARD_ERRORS * error
    gain = agreement - margin - edges.agreement()[0]
    is_better = agreement - margin >= config.min_certainty and gain >= config.min_gain * agreement
    return best if is_better else NO_PLACEMENT


def _displacement(edges: EdgeSamples, placement: Placement) -> np.ndarray:
    """Return the displacement of each edge along its normal, pixels, (N,)."""
    displacement: np.ndarray = np.array(placement.offset) @ edges.normals - placement.growth
    return displacement


def _best(offsets: list[tuple[int, int]], growths: range, edges: EdgeSamples) -> Placement:
    """Return the displacement with the best agreement of some translations and growths."""
    candidates = [Placement(offset=o, growth=g) for o, g in product(offsets, growths)]
    return max(candidates, key=lambda candidate: edges.agreement(_displacement(edges, candidate))[0])


def _best_growth_and_offset(edges: EdgeSamples, limit: int) -> Placement:
    """Return the displacement with the best agreement: of every second one, then of its neighbours."""
    coarse = range(-limit + limit % 2, limit + 1, 2)
    rough = _best(list(product(coarse, coarse)), coarse, edges)
    down, right = (range(pixels - 1, pixels + 2) for pixels in rough.offset)
    growths = range(max(-limit, rough.growth - 1), min(limit, rough.growth + 1) + 1)
    return _best(list(product(down, right)), growths, edges)


def verified(
    image: np.ndarray, disparity: np.ndarray, placement: Placement, edge_count: int
) -> tuple[Placement, float, float]:
    """Return the placement whose displaced map agrees best with the picture, its agreement and the error.

    Edges that the displacement deletes have no agreement: the mean is over ``edge_count`` edge pixels, the
    number of the given map, or over those of the displaced map if they are more.

    A square window moves oblique edges by up to the square root of 2 times its half width, so that smaller
    growths than that of the edges compete. Of those within one standard error of the best, the smallest is
    used (Breiman et al., "Classification and Regression Trees", 1984): shrinking by a pixel too much deletes
    thin structures.
    """
    moved, pixels = translate_map(disparity, placement.offset), abs(placement.growth)
    agreements = {}
    for size in range(int(pixels / math.sqrt(2)), pixels + 1):
        growth = int(math.copysign(size, placement.growth))
        edges = sample_edges(image, shift_edges(moved, growth), MAX_SAMPLES)
        kept = min(1.0, edges.count / max(edge_count, 1))
        agreements[growth] = tuple(kept * value for value in edges.agreement())
    best, tolerance = max(agreements.values())
    growth = min((g for g, (mean, _) in agreements.items() if mean >= best - tolerance), key=abs)
    agreement, error = agreements[growth]
    verified = Placement(
        offset=placement.offset, growth=growth, certainty=agreement - STANDARD_ERRORS * error
    )
    return verified, agreement, error
