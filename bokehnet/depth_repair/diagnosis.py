"""Diagnosis of a map from its picture and itself alone: noise, softness, offset, growth, agreement.

Method: the noise is the median absolute deviation of the finest diagonal Haar details (Donoho and Johnstone,
"Ideal spatial adaptation by wavelet shrinkage", Biometrika 1994); softness is the fraction of edge pixels
between both sides of their edge; the agreement is that of the edge profile
(:mod:`bokehnet.depth_repair.edge_profile`), and offset and growth are those with the best agreement
(:mod:`bokehnet.depth_repair.stages.register`).

In: the picture, scene-linear (3, H, W), and the map (H, W), any unit. Out: a :class:`Diagnosis`.
"""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from bokehnet.depth_repair.config import (
    DETAIL_BLOCK_PX,
    MAX_DETAILS,
    MAX_SAMPLES,
    MIN_EDGE_HEIGHT,
    MIN_NOISE_SIDE_PX,
    MIN_SHARED_NOISE,
    PROFILE_SCALES,
    SHARED_NOISE_FACTOR,
    RepairConfig,
)
from bokehnet.depth_repair.edge_profile import sample_edges
from bokehnet.depth_repair.stages.register import NO_PLACEMENT, Placement, find_placement, verified
from bokehnet.depth_repair.stages.thin_growth import thin_fraction

__all__ = ["Diagnosis", "diagnose", "noise_level"]

# Median and lower quartile of the absolute value of standard normal deviates.
_NORMAL_MEDIAN, _NORMAL_QUARTILE = (NormalDist().inv_cdf((1 + rank) / 2) for rank in (1 / 2, 1 / 4))


@dataclass(frozen=True, kw_only=True, slots=True)
class Diagnosis:
    """Errors of a map that can be measured.

    Attributes:
        noise: Standard deviation of the noise, as a fraction of the range of the map.
        wrong_pixels: Fraction of wrong single pixels that were corrected, 0 to 1.
        softness: Fraction of soft edges, 0 to 1.
        placement: Offset and growth, pixels of the size at which they were measured, and their certainty.
        peak: Distance of the edges of the picture from those of the map, pixels; positive towards the near
            side.
        candidates: Placements to try: that of the map or, if the edges of the picture lie elsewhere in a part
            of the map only, none and a growth.
        thin_fraction: Fraction of thin structures of the placed map, from
            :func:`bokehnet.depth_repair.stages.thin_growth.thin_fraction`.
        certainty: Best agreement of the map with its picture at a common distance and scale. Below
            ``min_certainty`` of the configuration the map does not follow the picture, or the picture shows
            no edges.
    """

    noise: float = 0.0
    wrong_pixels: float = 0.0
    softness: float = 0.0
    placement: Placement = NO_PLACEMENT
    candidates: tuple[Placement, ...] = (NO_PLACEMENT,)
    peak: float = 0.0
    thin_fraction: float = 1.0
    certainty: float = 0.0


def noise_level(disparity: np.ndarray) -> float:
    """Return the standard deviation of the noise of a map, as a fraction of its range.

    Noise of single pixels is measured by the finest details, noise that neighbours share, as that of stereo
    matching, by details of block means. Of these the lower quartile counts: detail is not everywhere.

    Args:
        disparity: Map, (H, W), any unit.

    Returns:
        Noise level; 0 if the map is constant or a side is shorter than 32 pixels.

    Examples:
        >>> slope = np.tile(np.linspace(0, 1, 256), (256, 1))
        >>> noise_level(slope) < 1e-6
        True
        >>> round(noise_level(slope + 0.02 * np.random.default_rng(0).standard_normal(slope.shape)), 3)
        0.018
    """
    span = float(np.ptp(disparity))
    if span == 0 or min(disparity.shape) < MIN_NOISE_SIDE_PX:
        return 0.0
    of_pixels = float(np.median(_details(disparity))) / (2 * _NORMAL_MEDIAN * span)
    size = DETAIL_BLOCK_PX
    rows, columns = (side // size for side in disparity.shape)
    blocks = disparity[: rows * size, : columns * size].reshape(rows, size, columns, size)
    quartile = float(np.quantile(_details(blocks.mean((1, 3))), 0.25))
    shared = SHARED_NOISE_FACTOR * quartile / (2 * _NORMAL_QUARTILE * span)
    return max(of_pixels, shared) if shared > MIN_SHARED_NOISE else of_pixels


def _details(values: np.ndarray) -> np.ndarray:
    """Return the absolute diagonal Haar details of an array, at most about ``MAX_DETAILS`` of them."""
    height, width = (side // 2 for side in values.shape)
    stride = 2 * math.ceil(math.sqrt(height * width / MAX_DETAILS))
    top_left, top_right, bottom_left, bottom_right = (
        values[y : 2 * height : stride, x : 2 * width : stride] for y in (0, 1) for x in (0, 1)
    )
    return np.abs(top_left - top_right - bottom_left + bottom_right)


def diagnose(image: np.ndarray, disparity: np.ndarray, softness: float, config: RepairConfig) -> Diagnosis:
    """Return the diagnosis of a map without noise.

    Args:
        image: All-in-focus picture at the size of the comparison, scene-linear, not negative, (3, H, W).
        disparity: Map of that size with sharp edges and without noise, (H, W), any unit.
        softness: Fraction of soft edges of the input.
        config: Numbers of the repair.
    """
    samples = [sample_edges(image, disparity, MAX_SAMPLES, scale=scale) for scale in PROFILE_SCALES]
    profiles = [edges.profile() for edges in samples]
    placement = find_placement(image, disparity, config) if "register" in config.stages else NO_PLACEMENT
    candidates, growth = [placement], -round(profiles[0].offset)
    if "register" in config.stages and placement == NO_PLACEMENT and 0 < abs(growth) <= config.max_shift_px:
        local, _, _ = verified(image, disparity, Placement(growth=growth), samples[0].count)
        candidates += [local] if local.growth else []
    return Diagnosis(
        softness=softness,
        placement=placement,
        candidates=tuple(candidates),
        peak=profiles[0].offset,
        thin_fraction=thin_fraction(placement.apply(disparity), MIN_EDGE_HEIGHT * float(np.ptp(disparity))),
        certainty=max(placement.certainty, *(profile.certainty for profile in profiles)),
    )
