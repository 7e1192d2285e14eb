"""Coverage along silhouettes whose colours mix over several pixels: hair, fur, soft edges.

A map draws such a silhouette as one sharp contour. The colours on both sides of it predict the map by a
linear model in every window (guided filter); what the model predicts for a pixel, between the depths of both
sides, is the coverage of the nearer one. Sharp silhouettes with an accurate map gain nothing by it, because
textures disturb the prediction. The coverage is therefore used only where it, seen as a map, agrees better
with the edges of the picture than the map does (:mod:`bokehnet.depth_repair.acceptance`), and where that
holds for most of the silhouette around.

In: picture, scene-linear (H, W, 3), and map (H, W). Out: :class:`KnownSurfaces` without colours, which the
unmixing of the ray engines estimates.

Source: He, Sun and Tang, "Guided image filtering", TPAMI 2013, and He and Sun, "Fast guided filter", 2015.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.box_mean import box_mean
from bokehnet.arrays.halving import half_image, half_map, halvings
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.depth_repair.acceptance import accepted_blocks
from bokehnet.depth_repair.config import BLOCK_PX, RepairConfig
from bokehnet.depth_repair.edge_profile import DISTANCES_PX, sample_edges
from bokehnet.depth_repair.filters import local_extremes
from bokehnet.optics.pixels.resampling import bilinear

__all__ = ["fringe_surfaces"]

Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class _Numbers:
    """Numbers of the estimate.

    Attributes:
        radius: Half width of a window, as a fraction of the longer side of the picture.
        color_variance: Variance of colours, encoded 0 to 1, below which they predict nothing.
        min_step: Minimum step of a silhouette, as a fraction of the range of the map.
        max_deviation: Maximum mean squared deviation of a window from its two surfaces, relative to the
            squared step.
        coverage_margin: Coverage that counts as none, and distance from 1 that counts as all.
        min_change: Minimum difference of a coverage from that of the map.
        max_agreement: Maximum agreement of the contour of the map with the edges of the picture: a sharp
            silhouette has more.
        min_agreement: Minimum fraction of the changes around that the picture agrees with.
        agreement_window: Half width of the window in which they are counted, in half widths of a window.
    """

    radius: float = 0.012
    color_variance: float = 1e-4
    min_step: float = 0.15
    max_deviation: float = 0.01
    coverage_margin: float = 0.05
    min_change: float = 0.1
    max_agreement: float = 0.1
    min_agreement: float = 0.5
    agreement_window: int = 8


_NUMBERS = _Numbers()


def fringe_surfaces(
    image: Array, disparity: Array, config: RepairConfig | None = None
) -> KnownSurfaces | None:
    """Return the coverage of pixels along soft silhouettes; None if no silhouette is certain to be soft.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3).
        disparity: Map, (H, W), any unit, rising towards the camera.
        config: Numbers of the acceptance; default: those of the depth repair.

    Returns:
        Surfaces without colours, ``near`` and ``far`` in the unit of the map.

    Examples:
        >>> flat = np.zeros((16, 24), np.float32)
        >>> fringe_surfaces(np.ones((16, 24, 3), np.float32), flat) is None
        True
    """
    config = config or RepairConfig()
    pictures, maps = halvings(np.maximum(image.transpose(2, 0, 1), 0), disparity, config.base_side_px)
    light, values, scale = pictures[-1], maps[-1], 2 ** (len(maps) - 1)
    radius = max(4, round(_NUMBERS.radius * max(values.shape)))
    low, high = local_extremes(values, radius)
    step = high - low
    is_silhouette = step > _NUMBERS.min_step * float(np.ptp(values))
    if not is_silhouette.any():
        return None
    model = _linear_model(light, values, radius)
    rows, columns = np.nonzero(is_silhouette)
    deviation = box_mean(np.minimum(values - low, high - values) ** 2, radius)[rows, columns]
    own = (values - low)[rows, columns] / step[rows, columns]
    coverage = _coverage(model, light[:, rows, columns], (rows, columns), (low, high))
    has_two_surfaces = deviation < _NUMBERS.max_deviation * step[rows, columns] ** 2
    sharp = values.copy()  # the gain of sharper edges is none of coverage
    sharp[rows, columns] = np.where(own > 0.5, high[rows, columns], low[rows, columns])
    is_candidate = has_two_surfaces & (np.abs(coverage - own) > _NUMBERS.min_change)
    rows, columns, coverage = rows[is_candidate], columns[is_candidate], coverage[is_candidate]
    proposal = sharp.copy()
    proposal[rows, columns] = np.where(coverage > 0.5, high[rows, columns], low[rows, columns])
    accepted = _accepted(light, sharp, proposal, (rows, columns), config)
    accepted *= _agreement(light, sharp, _NUMBERS.agreement_window // 2 * radius) < _NUMBERS.max_agreement
    wide = box_mean(accepted, _NUMBERS.agreement_window * radius)
    candidates = np.zeros(values.shape, np.float32)
    candidates[rows, columns] = 1
    wide_candidates = box_mean(candidates, _NUMBERS.agreement_window * radius)
    accepted *= wide > _NUMBERS.min_agreement * wide_candidates
    if not accepted.any():
        return None
    return _at_full_size(np.maximum(image, 0), disparity, accepted > 0, model, (low, high), scale)


def _encoded(light: np.ndarray) -> Array:
    encoded: Array = np.sqrt(np.clip(light, 0, 1, dtype=np.float32))
    return encoded


def _linear_model(light: np.ndarray, values: Array, radius: int) -> Array:
    """Return slopes and constant of the map as a linear function of encoded colours, (4, H / 2, W / 2)."""
    colors, small, radius = _encoded(half_image(light)), half_map(values), -(-radius // 2)
    means, mean = [box_mean(color, radius) for color in colors], box_mean(small, radius)
    covariances = np.empty((*small.shape, 3, 3), np.float32)
    with_map = np.empty((*small.shape, 3, 1), np.float32)
    for i in range(3):
        with_map[..., i, 0] = box_mean(colors[i] * small, radius) - means[i] * mean
        for j in range(i, 3):
            moment = box_mean(colors[i] * colors[j], radius) - means[i] * means[j]
            covariances[..., i, j] = covariances[..., j, i] = moment
    covariances += np.float32(_NUMBERS.color_variance) * np.eye(3, dtype=np.float32)
    slopes = np.asarray(np.linalg.solve(covariances, with_map)[..., 0], np.float32)
    constant = mean - sum(slopes[..., c] * means[c] for c in range(3))
    return np.stack([*(box_mean(slopes[..., c], radius) for c in range(3)), box_mean(constant, radius)])


def _coverage(
    model: Array, light: np.ndarray, places: tuple[np.ndarray, np.ndarray], extremes: tuple[Array, Array]
) -> Array:
    """Return the coverage by the nearer surface of pixels of colours (3, N) at ``places`` of a map, (N,).

    Args:
        model: From :func:`_linear_model`.
        light: Colours of the pixels, scene-linear.
        places: Rows and columns in the map, which has twice the size of the model; fractions allowed.
        extremes: Farthest and nearest values around each pixel of the map.
    """
    at_model = [
        np.clip((place - 0.5) / 2, 0, side - 1) for place, side in zip(places, model.shape[1:], strict=True)
    ]
    slopes = bilinear(model, at_model[0], at_model[1], np.float32)
    nearest = tuple(
        np.clip(np.rint(place).astype(np.intp), 0, side - 1)
        for place, side in zip(places, extremes[0].shape, strict=True)
    )
    low, high = (values[nearest] for values in extremes)
    predicted = (slopes[:3] * _encoded(light)).sum(0) + slopes[3]
    coverage = (predicted - low) / np.maximum(high - low, np.finfo(np.float32).tiny)
    margin = _NUMBERS.coverage_margin
    return np.asarray(np.clip((coverage - margin) / (1 - 2 * margin), 0, 1), np.float32)


def _accepted(
    light: np.ndarray,
    values: Array,
    proposal: Array,
    places: tuple[np.ndarray, np.ndarray],
    config: RepairConfig,
) -> Array:
    """Return 1 at the places, (N,) each, where the picture agrees better with the proposal, (H, W)."""
    blocks = accepted_blocks(light, values, proposal, config)
    rows, columns = places
    accepted = np.zeros(values.shape, np.float32)
    accepted[rows, columns] = blocks[rows // BLOCK_PX, columns // BLOCK_PX]
    return accepted


def _agreement(light: np.ndarray, values: Array, radius: int) -> Array:
    """Return the mean height of the edge profile of a map in the square window around each pixel, (H, W)."""
    edges = sample_edges(light, values)
    heights = np.clip(edges.heights[:, len(DISTANCES_PX) // 2].min(0), -1, 3)
    rows, columns = np.rint(edges.places).astype(np.intp)
    sums, counts = np.zeros((2, *values.shape), np.float32)
    np.add.at(sums, (rows, columns), heights)
    np.add.at(counts, (rows, columns), 1)
    count = box_mean(counts, radius)
    agreement: Array = np.where(count > 0, box_mean(sums, radius) / np.maximum(count, 1e-9), np.inf)
    return agreement


def _at_full_size(
    image: Array,
    disparity: Array,
    mask: npt.NDArray[np.bool_],
    model: Array,
    extremes: tuple[Array, Array],
    scale: int,
) -> KnownSurfaces | None:
    """Return the surfaces of the pixels of a mask at 1 / ``scale`` of the size of the picture."""
    height, width = disparity.shape
    inside = np.repeat(np.repeat(mask, scale, 0), scale, 1)[:height, :width]
    rows, columns = np.nonzero(inside)
    places = tuple((index + 0.5) / scale - 0.5 for index in (rows, columns))
    coverage = _coverage(model, image[rows, columns].T, (places[0], places[1]), extremes)
    low, high = (values[rows // scale, columns // scale] for values in extremes)
    own = np.clip((disparity[rows, columns] - low) / (high - low), 0, 1)
    changed = np.abs(coverage - own) > _NUMBERS.min_change
    if not changed.any():
        return None
    return KnownSurfaces(
        rows=rows[changed],
        columns=columns[changed],
        near=high[changed],
        far=low[changed],
        coverage=coverage[changed],
    )
