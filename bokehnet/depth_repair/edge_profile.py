"""Edge profile: signed distance from the depth edges of a map to the edges of its picture, in closed form.

Method: depth edges are ridges of the smoothed slope (non-maximum suppression with a subpixel parabola; Canny,
"A computational approach to edge detection", IEEE TPAMI 1986). The gradient of the picture is sampled along
the normal of each; its mean over all edges peaks where the edges of the picture lie. The standard error comes
from groups of neighbouring edge pixels. The repair moves a map, or all of its edges, only if this profile
agrees with the network.

In: the picture, scene-linear (3, H, W), and the map (H, W), any unit. Out: an :class:`EdgeProfile` with an
offset in pixels, positive towards the near side.
"""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.depth_repair.network_tiles import BLOCK_PX
from bokehnet.depth_repair.stages.edge_sharpening import MIN_EDGE_HEIGHT
from bokehnet.optics.encoding import encode

__all__ = [
    "DepthEdges",
    "EdgeProfile",
    "accepted_offset",
    "accepted_shift",
    "edge_profile",
    "find_depth_edges",
]

# Largest distance of a peak from the depth edge, and spacing of the samples, pixels.
_MAX_DISTANCE_PX, _SPACING_PX = 7.5, 0.5

# Distances from a peak between which each of its two sides is measured, pixels.
_SIDES_PX = (1.5, 3.5)

# Half length of the difference that measures the gradient, pixels; a multiple of the spacing.
_HALF_DIFFERENCE_PX = 1.0

# Gradient per pixel, encoded light, that is added to the mean of each edge so that noise weighs little.
_MIN_GRADIENT = 0.005

# Binomial filter of the map before its slope is measured, and the slope per pixel of a filtered step of 1.
_SMOOTHING, _SLOPE_OF_STEP = (1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16), 5 / 16

# Maximum number of edge pixels that are sampled.
_MAX_EDGE_PIXELS = 6000

# Number of groups of edge pixels for the standard error, and number of standard errors subtracted.
_GROUPS, _STANDARD_ERRORS = 16, 2.0

# Minimum certainty for a change of the map. The profiles of random maps reach 0.01.
_MIN_CERTAINTY = 0.1

# Minimum distance of the peak from the depth edges for a shift: a pixel, minus the error on discs. On
# accurate maps the distance reaches 0.75.
_MIN_OFFSET_PX = 0.9

# Minimum ratio of the certainties of a changed map and of the map as it is.
_MIN_GAIN = 1.1


@dataclass(frozen=True, slots=True, eq=False)
class DepthEdges:
    """Ridges of the slope of a map: one edge pixel for about each pixel along a depth edge.

    Attributes:
        places: Rows and columns, between pixels, (2, N); in raster order.
        normals: Unit vectors towards the near side, down and right, (2, N).
        slopes: Slope of the smoothed map, as a fraction of its range per pixel, (N,).
    """

    places: np.ndarray
    normals: np.ndarray
    slopes: np.ndarray

    def moved(self, offset: tuple[int, int]) -> "DepthEdges":
        """Return the edges of the map moved by some pixels down and to the right."""
        return DepthEdges(self.places + np.array(offset)[:, None], self.normals, self.slopes)

    def within(self, blocks: np.ndarray) -> "DepthEdges":
        """Return the edges inside some blocks of 8x8 pixels, (H / 8, W / 8) bool."""
        rows, columns = (self.places / BLOCK_PX).astype(np.intp)
        return self._select(blocks[rows, columns])

    def subsampled(self, count: int) -> "DepthEdges":
        """Return at most ``count`` edge pixels, evenly spaced in raster order."""
        if len(self.slopes) <= count:
            return self
        return self._select(np.linspace(0, len(self.slopes) - 1, count).astype(np.intp))

    def _select(self, index: np.ndarray) -> "DepthEdges":
        return DepthEdges(self.places[:, index], self.normals[:, index], self.slopes[index])


@dataclass(frozen=True, kw_only=True, slots=True)
class EdgeProfile:
    """Peak of the mean gradient of a picture across the depth edges of a map.

    Attributes:
        offset: Distance of the peak from the depth edges, pixels, at most 7.5; positive towards the near
            side, if foreground regions of the map are too large. The error on exact maps is below 0.5.
        certainty: Height of the peak above the higher one of its sides, minus two standard errors, as a
            fraction of the mean gradient near edges. The profile is meaningless below 0.1.
        edge_pixels: Number of edge pixels of the map.
    """

    offset: float = 0.0
    certainty: float = 0.0
    edge_pixels: int = 0

    @property
    def is_certain(self) -> bool:
        """Return whether the peak is significant."""
        return self.certainty >= _MIN_CERTAINTY

    @property
    def is_centred(self) -> bool:
        """Return whether the profile is certain and peaks within 0.9 pixels of the depth edges."""
        return self.is_certain and abs(self.offset) < _MIN_OFFSET_PX

    def exceeds(self, other: "EdgeProfile") -> bool:
        """Return whether the profile is certain, and at least 1.1 times as certain as another one."""
        return self.is_certain and self.certainty >= _MIN_GAIN * other.certainty


def find_depth_edges(disparity: np.ndarray) -> DepthEdges:
    """Return the depth edges of a map.

    The function ignores edges within 12 pixels of the border and edges lower than 5 % of the range of the
    map.

    Args:
        disparity: Map, (H, W), any unit, rising towards the camera.
    """
    margin, span = math.ceil(_MAX_DISTANCE_PX + _SIDES_PX[1] + _HALF_DIFFERENCE_PX), float(np.ptp(disparity))
    if span == 0 or min(disparity.shape) <= 2 * margin:
        return DepthEdges(np.zeros((2, 0)), np.zeros((2, 0)), np.zeros(0))
    down, right = np.gradient(_smooth(_smooth(disparity / span).T).T)
    slope = np.hypot(down, right)
    steep = slope > MIN_EDGE_HEIGHT * _SLOPE_OF_STEP
    steep[:margin] = steep[-margin:] = steep[:, :margin] = steep[:, -margin:] = False
    pixels = np.array(np.nonzero(steep))
    centre = slope[steep]
    normals = np.array([down[steep], right[steep]]) / centre
    ahead, behind = (_sample(slope[None], pixels + way * normals)[0] for way in (1, -1))
    ridge = (centre >= ahead) & (centre > behind)
    pixels, normals, centre, ahead, behind = (x[..., ridge] for x in (pixels, normals, centre, ahead, behind))
    vertex = (ahead - behind) / (2 * (2 * centre - ahead - behind))  # of the parabola through three slopes
    return DepthEdges(pixels + vertex * normals, normals, centre)


def edge_profile(image: np.ndarray, edges: DepthEdges) -> EdgeProfile:
    """Return the peak of the mean gradient of a picture across depth edges.

    The gradients along each normal are divided by their mean, so that strong edges of the picture have no
    more weight than faint ones; edge pixels have their slope as weight. A peak must rise above both of its
    sides, because textured foreground in front of a plain background raises one of them.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (3, H, W).
        edges: Depth edges of its map.
    """
    number = len(edges.slopes)
    if number < _GROUPS:
        return EdgeProfile(edge_pixels=number)
    edges = edges.subsampled(_MAX_EDGE_PIXELS)
    starts = np.linspace(0, len(edges.slopes), _GROUPS, endpoint=False).astype(np.intp)
    weights = np.add.reduceat(edges.slopes, starts)
    sums = np.add.reduceat(_gradients(image, edges) * edges.slopes, starts, axis=1)
    heights = _heights(sums.sum(1) / weights.sum())
    lower = heights.min(0)
    peak = int(lower.argmax())
    side = int(heights[:, peak].argmin())
    deviations = _heights(sums / weights)[side, peak] - lower[peak]
    error = math.sqrt(np.square(weights * deviations).sum()) / weights.sum()
    return EdgeProfile(
        offset=-_MAX_DISTANCE_PX + _SPACING_PX * (peak + _vertex(lower, peak)),
        certainty=float(lower[peak] - _STANDARD_ERRORS * error),
        edge_pixels=number,
    )


def accepted_shift(profile: EdgeProfile, shift: int) -> int:
    """Return the part of a shift that the profile supports: pixels by which foreground regions grow.

    Args:
        profile: Edge profile of the edges that the shift would move.
        shift: Proposed shift, pixels, negative to shrink foreground regions.

    Returns:
        0 if the profile is uncertain, peaks less than 0.9 pixels from the edges, or has the other sign;
        otherwise the proposal, clipped to the distance of the peak.
    """
    if not profile.is_certain or profile.is_centred or profile.offset * shift >= 0:
        return 0
    return int(math.copysign(min(abs(shift), round(abs(profile.offset))), shift))


def accepted_offset(image: np.ndarray, edges: DepthEdges, offset: tuple[int, int]) -> tuple[int, int]:
    """Return the part of a translation that the profile supports, pixels down and to the right.

    In a translated map, the edges of the picture lie on the near side of some depth edges and on the far side
    of the opposite ones. The correct translation merges these two peaks into one.

    Args:
        image: All-in-focus picture, scene-linear, not negative, (3, H, W).
        edges: Depth edges of the input map.
        offset: Proposed translation, pixels.

    Returns:
        The proposal or one of its components, whichever has the most certain profile; (0, 0) if none is
        certain, or none is clearly more certain than the input.
    """
    if offset == (0, 0):
        return offset
    down, right = offset
    parts = dict.fromkeys([(0, 0), offset, (down, 0), (0, right)])
    profiles = {part: edge_profile(image, edges.moved(part)) for part in parts}
    best = max(profiles, key=lambda part: profiles[part].certainty)
    return best if profiles[best].exceeds(profiles[0, 0]) else (0, 0)


def _gradients(image: np.ndarray, edges: DepthEdges) -> np.ndarray:
    """Return the gradients along each normal divided by their mean, (samples, N)."""
    reach = _MAX_DISTANCE_PX + _SIDES_PX[1] + _HALF_DIFFERENCE_PX
    distances = np.arange(-reach, reach + _SPACING_PX / 2, _SPACING_PX)[:, None]
    light = encode(_sample(image, edges.places[:, None] + distances * edges.normals[:, None]))
    lag = round(2 * _HALF_DIFFERENCE_PX / _SPACING_PX)
    gradients = np.abs(light[:, lag:] - light[:, :-lag]).mean(0) / (2 * _HALF_DIFFERENCE_PX)
    scaled: np.ndarray = gradients / (gradients.mean(0) + _MIN_GRADIENT)
    return scaled


def _heights(profiles: np.ndarray) -> np.ndarray:
    """Return the heights of a profile (samples, ...) above both of its sides, (2, places, ...)."""
    first, last = (round(distance / _SPACING_PX) for distance in _SIDES_PX)
    places = len(profiles) - 2 * last

    def mean(shifts: range) -> np.ndarray:
        return np.mean([profiles[last + shift : last + shift + places] for shift in shifts], axis=0)

    middle = mean(range(-1, 2))
    return np.array([middle - mean(range(-last, 1 - first)), middle - mean(range(first, last + 1))])


def _vertex(values: np.ndarray, at: int) -> float:
    """Return the distance from a maximum to the peak of the parabola through it and its neighbours."""
    if not 0 < at < len(values) - 1:
        return 0.0
    before, centre, after = values[at - 1 : at + 2]
    return float((after - before) / (2 * (2 * centre - before - after)))


def _smooth(values: np.ndarray) -> np.ndarray:
    """Smooth each column of a map (H, W) with the border repeated."""
    padded = np.pad(values, ((len(_SMOOTHING) // 2,) * 2, (0, 0)), "edge")
    smooth = np.zeros_like(values)
    for row, weight in enumerate(_SMOOTHING):
        smooth += weight * padded[row : row + len(values)]
    return smooth


def _sample(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Interpolate values (C, H, W) at places (2, ...), clipped to the image; returns (C, ...)."""
    height, width = values.shape[1:]
    y, x = (np.clip(place, 0, side - 1.001) for place, side in zip(places, (height, width), strict=True))
    row, column = y.astype(np.intp), x.astype(np.intp)
    b, a = (y - row).astype(np.float32), (x - column).astype(np.float32)
    flat, at = values.reshape(len(values), -1), row * width + column
    upper = flat[:, at] * (1 - a) + flat[:, at + 1] * a
    lower = flat[:, at + width] * (1 - a) + flat[:, at + width + 1] * a
    return upper * (1 - b) + lower * b
