"""Edge profile: agreement of the depth edges of a map with the edges of its picture, in closed form.

Method: depth edges are ridges of the smoothed slope (non-maximum suppression with a subpixel parabola; Canny,
"A computational approach to edge detection", IEEE TPAMI 1986). The gradient of the picture is sampled along
the normal of each; the agreement at a distance is its height there above the higher one of both sides. The
mean over all edges peaks where the edges of the picture lie. The standard error comes from groups of
neighbouring edge pixels.

In: the picture, scene-linear (3, H, W), and the map (H, W), any unit. Out: :class:`EdgeSamples`, from which
the diagnosis and the acceptance take their evidence.
"""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.depth_repair.config import (
    ERROR_GROUPS,
    HALF_DIFFERENCE_PX,
    MAX_PEAK_DISTANCE_PX,
    MIN_EDGE_HEIGHT,
    MIN_GRADIENT,
    PEAK_SIDES_PX,
    SAMPLE_SPACING_PX,
    SMOOTHING_ORDER,
    STANDARD_ERRORS,
)
from bokehnet.optics.encoding import encode
from bokehnet.optics.pixels.resampling import bilinear

__all__ = ["DISTANCES_PX", "EdgeProfile", "EdgeSamples", "sample_edges"]

# Distances from a depth edge at which the agreement is known, pixels; positive towards the near side.
DISTANCES_PX = np.arange(
    -MAX_PEAK_DISTANCE_PX, MAX_PEAK_DISTANCE_PX + SAMPLE_SPACING_PX / 2, SAMPLE_SPACING_PX
)

# Slope per pixel of a filtered step of 1: its central difference is one more binomial filter.
_SLOPE_OF_STEP = math.comb(SMOOTHING_ORDER + 1, SMOOTHING_ORDER // 2) / 2 ** (SMOOTHING_ORDER + 1)


@dataclass(frozen=True, kw_only=True, slots=True)
class EdgeProfile:
    """Peak of the mean agreement of a picture and the depth edges of a map.

    Attributes:
        offset: Distance of the peak from the depth edges, pixels, at most 9; positive towards the near side,
            if foreground regions of the map are too large. The error on exact maps is below 0.5.
        certainty: Height of the peak minus two standard errors, as a fraction of the mean gradient near
            edges. The profile is meaningless below 0.1.
    """

    offset: float = 0.0
    certainty: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class EdgeSamples:
    """Gradients of a picture across the depth edges of a map: one sample per pixel along a depth edge.

    Attributes:
        places: Rows and columns, between pixels, (2, N); in raster order.
        normals: Unit vectors towards the near side, down and right, (2, N).
        weights: Slope of the smoothed map, as a fraction of its range per pixel, (N,).
        heights: Gradient at each distance of ``DISTANCES_PX`` above the far and above the near side of that
            distance, as a fraction of the mean gradient of the edge, (2, distances, N).
        count: Number of all edge pixels, of which the samples are a part.
    """

    places: np.ndarray
    normals: np.ndarray
    weights: np.ndarray
    heights: np.ndarray
    count: int = 0

    def agreement(self, distances: np.ndarray | float = 0.0) -> tuple[float, float]:
        """Return the mean agreement of all edges displaced along their normals, and its standard error.

        Args:
            distances: Displacement of each edge, pixels, (N,) or one for all; clipped to 9.
        """
        count = len(self.weights)
        if count < ERROR_GROUPS:
            return 0.0, 0.0
        at = np.rint((np.asarray(distances) + MAX_PEAK_DISTANCE_PX) / SAMPLE_SPACING_PX).astype(np.intp)
        at = np.broadcast_to(np.clip(at, 0, len(DISTANCES_PX) - 1), (count,))
        heights = self.heights[:, at, np.arange(count)] * self.weights
        starts = np.linspace(0, count, ERROR_GROUPS, endpoint=False).astype(np.intp)
        weights, sums = np.add.reduceat(self.weights, starts), np.add.reduceat(heights, starts, axis=1)
        means = sums.sum(1) / weights.sum()
        side = int(means.argmin())
        deviations = sums[side] / weights - means[side]
        error = math.sqrt(np.square(weights * deviations).sum()) / weights.sum()
        return float(means[side]), error

    def profile(self) -> EdgeProfile:
        """Return the peak of the mean agreement.

        A peak must rise above both of its sides, because textured foreground in front of a plain background
        raises one of them.
        """
        if len(self.weights) < ERROR_GROUPS:
            return EdgeProfile()
        lower = ((self.heights @ self.weights) / self.weights.sum()).min(0)
        peak = int(lower.argmax())
        height, error = self.agreement(float(DISTANCES_PX[peak]))
        return EdgeProfile(
            offset=float(DISTANCES_PX[peak] + SAMPLE_SPACING_PX * _vertex(lower, peak)),
            certainty=height - STANDARD_ERRORS * error,
        )


def sample_edges(
    image: np.ndarray,
    disparity: np.ndarray,
    max_edges: int | None = None,
    mask: np.ndarray | None = None,
    scale: int = 1,
) -> EdgeSamples:
    """Return the depth edges of a map with the gradients of its picture across them.

    The gradients along each normal are divided by their mean, so that strong edges of the picture have no
    more weight than faint ones. The function ignores edges near the border, within 14 pixels at scale 1, and
    edges lower than 5 % of the range of the map.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (3, H, W).
        disparity: Map, (H, W), any unit, rising towards the camera.
        max_edges: Maximum number of edge pixels, evenly spaced in raster order; default: all.
        mask: Pixels whose edges are sampled, (H, W) bool; default: all.
        scale: Width of the peaks: 1 for edges that lie at one distance, more for edges scattered around it.
    """
    reach, span = MAX_PEAK_DISTANCE_PX + scale * PEAK_SIDES_PX[1], float(np.ptp(disparity))
    margin = math.ceil(reach + HALF_DIFFERENCE_PX)
    if span == 0 or min(disparity.shape) <= 2 * margin:
        return EdgeSamples(
            np.zeros((2, 0)), np.zeros((2, 0)), np.zeros(0), np.zeros((2, len(DISTANCES_PX), 0), np.float32)
        )
    down, right = np.gradient(_smooth(_smooth(disparity / span).T).T)
    slope = np.hypot(down, right)
    steep = slope > MIN_EDGE_HEIGHT * _SLOPE_OF_STEP
    if mask is not None:
        steep &= mask
    steep[:margin] = steep[-margin:] = steep[:, :margin] = steep[:, -margin:] = False
    pixels = np.array(np.nonzero(steep))
    centre = slope[steep]
    normals = np.array([down[steep], right[steep]]) / centre
    ahead, behind = (_sample(slope[None], pixels + way * normals)[0] for way in (1, -1))
    ridge = (centre >= ahead) & (centre > behind)
    count = int(ridge.sum())
    if max_edges is not None and count > max_edges:
        ridge = np.flatnonzero(ridge)[np.linspace(0, count - 1, max_edges).astype(np.intp)]
    pixels, normals, centre, ahead, behind = (x[..., ridge] for x in (pixels, normals, centre, ahead, behind))
    vertex = (ahead - behind) / (2 * (2 * centre - ahead - behind))  # of the parabola through three slopes
    places = pixels + vertex * normals
    heights = _heights(_gradients(image, places, normals, reach), scale)
    return EdgeSamples(places, normals, centre, heights, count)


def _gradients(image: np.ndarray, places: np.ndarray, normals: np.ndarray, reach: float) -> np.ndarray:
    """Return the gradients up to some pixels along each normal divided by their mean, (samples, N)."""
    reach += HALF_DIFFERENCE_PX
    distances = np.arange(-reach, reach + SAMPLE_SPACING_PX / 2, SAMPLE_SPACING_PX)[:, None]
    light = encode(_sample(image, places[:, None] + distances * normals[:, None]))
    lag = round(2 * HALF_DIFFERENCE_PX / SAMPLE_SPACING_PX)
    gradients = np.abs(light[:, lag:] - light[:, :-lag]).mean(0) / (2 * HALF_DIFFERENCE_PX)
    scaled: np.ndarray = gradients / (gradients.mean(0) + MIN_GRADIENT)
    return scaled


def _heights(gradients: np.ndarray, scale: int) -> np.ndarray:
    """Return the heights of gradients (samples, N) above both sides, (2, distances, N)."""
    first, last = (round(scale * distance / SAMPLE_SPACING_PX) for distance in PEAK_SIDES_PX)
    width = 1 + round((scale - 1) / SAMPLE_SPACING_PX)
    sums = np.concatenate([np.zeros_like(gradients[:1]), gradients.cumsum(0)])
    places = len(gradients) - 2 * last

    def mean(low: int, high: int) -> np.ndarray:
        """Return the mean from ``low`` to ``high`` samples beside each place, inclusive."""
        upper, lower = (sums[last + shift : last + shift + places] for shift in (high + 1, low))
        return np.asarray((upper - lower) / (high + 1 - low), np.float32)

    middle = mean(-width, width)
    return np.array([middle - mean(-last, -first), middle - mean(first, last)])


def _vertex(values: np.ndarray, at: int) -> float:
    """Return the distance from a maximum to the peak of the parabola through it and its neighbours."""
    if not 0 < at < len(values) - 1:
        return 0.0
    before, centre, after = values[at - 1 : at + 2]
    return float((after - before) / (2 * (2 * centre - before - after)))


def _smooth(values: np.ndarray) -> np.ndarray:
    """Smooth each column of a map (H, W) with the border repeated."""
    smooth = np.pad(values, ((SMOOTHING_ORDER // 2,) * 2, (0, 0)), "edge")
    for _ in range(SMOOTHING_ORDER):
        smooth = (smooth[1:] + smooth[:-1]) / 2
    return smooth


def _sample(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Interpolate values (C, H, W) at places (2, ...), clipped to the image; returns (C, ...)."""
    height, width = values.shape[1:]
    y, x = (np.clip(place, 0, side - 1.001) for place, side in zip(places, (height, width), strict=True))
    return bilinear(values, y, x, np.float32)
