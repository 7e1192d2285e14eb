"""Estimation of the pixel filter of a picture from its sharpest edges.

A straight edge between two even surfaces is drawn as the integral of the pixel filter, the edge-spread
function. Profiles across clear edges, nine pixels long, are compared with those of Gaussian filters of all
widths and positions; the best match gives the local filter width. A slanted edge is wider along a row, by
the cosine of its angle. Shadows and blurred objects are wider than the filter, nothing is sharper: the
narrower half of the edges determines the filter. Texture has no such edges: its profiles that match one by
chance differ in width, so that an estimate needs edges that agree.

At the depth edges of an exact map a wide filter mixes both sides into the two pixels beside the edge, a box
only into one of them at most. The median of that leak identifies a picture of unfiltered pixels.

All values are linear light. Edges of clipped light are excluded because they look too sharp.

Source: ISO 12233, "Photography: electronic still picture imaging: resolution", 2017, for edges as a measure
of sharpness. Templates instead of derivatives, and the quantile, are ours.
"""

import math
from functools import cache

import numpy as np
import numpy.typing as npt

from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, FilterChoice, PixelFilter

__all__ = ["edge_leaks", "edge_widths", "estimate_filter"]

# Half the length of a profile, pixels, and the maximum number of edges.
_HALF_PROFILE_PX, _MAX_EDGES = 4, 20000

# An edge is clear if its sides differ by at least this fraction of their sum and by this fraction of the
# brightest light (of 1 if that is more), if at most this fraction of it does not fit, and if its slope is not
# steeper. Pictures with values up to 1 may be clipped from the last value on.
_CONTRAST, _MIN_STEP, _MAX_RESIDUAL, _MAX_SLOPE, _CLIPPING_LIMIT = 0.15, 0.02, 0.09, 0.7, 0.97

# Rows per block.
_BLOCK_ROWS = 256

# Widths of the Gaussian templates, and positions of the edge in its pixel.
_WIDTHS = np.geomspace(0.8, 5.0, 36)
_POSITIONS = np.linspace(-0.5, 0.5, 17)

# Quantile of the widths that gives the filter; agreeing edges for a confidence of one half; ratio of
# widths up to which two edges agree.
_QUANTILE, _HALF_CONFIDENCE_EDGES, _AGREEMENT_RATIO = 0.3, 50, 1.15

# Minimum number of edges for an estimate, and minimum fraction of them that agree: 0.50 to 0.65 of the edges
# of path-traced pictures agree, 0.35 to 0.41 in blurred noise, 0.15 to 0.25 in photographs. Wider filters
# than the maximum, pixels of a Gaussian, are no filters of renderers, but soft texture.
_MIN_EDGES, _MIN_AGREEMENT, _MAX_WIDTH_PX = 20, 0.45, 4.2

# Depth edges: minimum step of a map as a fraction of its range; maximum step beside it as a fraction of it.
_MIN_DEPTH_STEP, _MAX_STEP_BESIDE = 0.05, 0.2

# Minimum number of depth edges, and maximum median leak, of a picture of unfiltered pixels: the leak is 0.22
# to 0.26 in path-traced pictures with a Blackman-Harris filter, 0 to 0.1 in composites of unfiltered layers.
# A box leaks at most one half into the nearest pixel; where more than this fraction of the edges leaks more,
# the map is not exact: 0 to 0.03 in those composites, 0.22 on a map at a quarter of the size.
_MIN_DEPTH_EDGES, _MAX_BOX_LEAK, _MAX_INEXACT_FRACTION = 50, 0.12, 0.06

# The Gaussian that has the variance of the default filter.
_DEFAULT_GAUSSIAN_WIDTH_PX = 1.89

Array = npt.NDArray[np.float64]


@cache
def _templates() -> Array:
    """Return edges of all widths and positions, (widths * positions, profile), with mean 0 and norm 1."""
    across = np.arange(-_HALF_PROFILE_PX, _HALF_PROFILE_PX + 1.0) - _POSITIONS[:, None]
    edges = np.concatenate([PixelFilter("gaussian", width).cumulative(across) for width in _WIDTHS])
    edges -= edges.mean(1, keepdims=True)
    templates: Array = edges / np.linalg.norm(edges, axis=1, keepdims=True)
    return templates


@cache
def _span() -> Array:
    """Return an orthonormal basis of the templates, (k, profile)."""
    _, lengths, directions = np.linalg.svd(_templates(), full_matrices=False)
    span: Array = directions[lengths > 1e-9 * lengths[0]]
    return span


def _clear_places(light: npt.NDArray[np.float32], min_step: float) -> npt.NDArray[np.int64]:
    """Return the indices in the flat picture at which rows cross a clear edge, (N,), ascending."""
    height, width = light.shape
    places = []
    for top in range(1, height - 1, _BLOCK_ROWS):
        rows = light[top : min(top + _BLOCK_ROWS, height - 1)]
        across = (
            rows[:, _HALF_PROFILE_PX + 1 : width - _HALF_PROFILE_PX + 1]
            - rows[:, _HALF_PROFILE_PX - 1 : width - _HALF_PROFILE_PX - 1]
        )
        before, after = rows[:, : -2 * _HALF_PROFILE_PX], rows[:, 2 * _HALF_PROFILE_PX :]
        step = np.abs(after - before)
        clear = (step > _CONTRAST * (after + before)) & (step > min_step)
        clear &= np.abs(across) > 0.3 * step
        y, x = np.nonzero(clear)
        places.append((y + top) * width + x + _HALF_PROFILE_PX)
    return np.concatenate(places)


def _along_rows(light: npt.NDArray[np.float32], least: float, clipped: float) -> Array:
    """Return the widths of the clear edges that rows cross, (N,), pixels of a Gaussian filter.

    ``least`` is the smallest step; light from ``clipped`` on may be clipped.
    """
    height, width = light.shape
    if height < 3 or width < 2 * _HALF_PROFILE_PX + 3:
        return np.empty(0)
    places = _clear_places(light, least)
    if len(places) > _MAX_EDGES:
        places = places[np.linspace(0, len(places) - 1, _MAX_EDGES).astype(int)]
    rows, columns = places // width, places % width
    down = light[rows + 1, columns] - light[rows - 1, columns]
    right = light[rows, columns + 1] - light[rows, columns - 1]
    slope = np.abs(down / np.where(right == 0, 1, right))
    offsets = np.arange(-_HALF_PROFILE_PX, _HALF_PROFILE_PX + 1)
    profiles = light[rows[:, None], columns[:, None] + offsets].astype(np.float64)
    kept = (slope < _MAX_SLOPE) & (profiles.max(1) < clipped)
    profiles, slope = profiles[kept], slope[kept]
    profiles *= np.sign(profiles[:, -1] - profiles[:, 0])[:, None]
    profiles -= profiles.mean(1, keepdims=True)
    profiles /= np.linalg.norm(profiles, axis=1, keepdims=True)
    # A profile far from the span of the templates matches none of them.
    within = np.einsum("ij,kj->ik", profiles, _span())  # BLAS would start its threads for little work
    near = 1 - (within**2).sum(1) < 1.001 * _MAX_RESIDUAL**2
    profiles, slope = profiles[near], slope[near]
    correlation = profiles @ _templates().T
    best = correlation.argmax(1)
    position = _POSITIONS[best % len(_POSITIONS)]
    kept = (np.sqrt(np.maximum(1 - correlation.max(1) ** 2, 0)) < _MAX_RESIDUAL) & (np.abs(position) < 0.5)
    return np.asarray(_WIDTHS[best // len(_POSITIONS)] / np.hypot(1, slope))[kept]


def edge_widths(image: npt.NDArray[np.floating]) -> Array:
    """Return the widths of the Gaussian filters that would draw each clear edge, (N,), pixels.

    Args:
        image: Scene-linear picture, (H, W, 3).
    """
    light = np.asarray(image, np.float32) @ np.full(3, 1 / 3, np.float32)
    brightest = float(np.quantile(light[:: max(1, len(light) // 500)], 0.999))
    clipped = _CLIPPING_LIMIT if image.max() <= 1 + 1e-4 else math.inf
    least = _MIN_STEP * min(brightest, 1.0)
    return np.concatenate([_along_rows(light, least, clipped), _along_rows(light.T, least, clipped)])


def edge_leaks(image: npt.NDArray[np.floating], disparity: npt.NDArray[np.floating]) -> Array:
    """Return the fraction of the far side in the nearest pixel of each side of the clear depth edges, (N,).

    Between the pixel before the nearest one and the nearest pixel of the other side, it is the fraction of
    the change that the nearest pixel already shows: 0 without a filter.

    Args:
        image: Scene-linear picture, (H, W, 3).
        disparity: Map of the picture, (H, W), any unit.
    """
    light = np.asarray(image, np.float32)
    clipped = _CLIPPING_LIMIT if light.max() <= 1 + 1e-4 else math.inf
    values = np.asarray(disparity, np.float32)
    leaks = [
        _leaks_along_rows(light, values, clipped),
        _leaks_along_rows(light.swapaxes(0, 1), values.T, clipped),
    ]
    return np.concatenate(leaks)


def _leaks_along_rows(
    light: npt.NDArray[np.float32], values: npt.NDArray[np.float32], clipped: float
) -> Array:
    """Return the leaks at the depth edges that rows cross, (N,)."""
    if values.shape[1] < 5:
        return np.empty(0)
    steps = np.abs(np.diff(values, axis=1))
    rows, columns = np.nonzero(steps[:, 1:-1] > _MIN_DEPTH_STEP * np.ptp(values))
    columns = columns + 1
    step = steps[rows, columns]
    leaks = []
    for inner, outer, beyond, offset in ((0, -1, 1, -1), (1, 2, 0, 1)):
        own, nearest, other = (light[rows, columns + offset] for offset in (outer, inner, beyond))
        change = other - own
        size = (change**2).sum(axis=1)
        brightness = np.linalg.norm(own, axis=1) + np.linalg.norm(other, axis=1)
        clear = size > np.maximum(_CONTRAST * brightness, _MIN_STEP) ** 2
        clear &= np.maximum(own.max(axis=1), other.max(axis=1)) < clipped
        clear &= steps[rows, columns + offset] < _MAX_STEP_BESIDE * step
        leaks.append(((nearest - own) * change).sum(axis=1)[clear] / size[clear])
    return np.concatenate(leaks).astype(np.float64)


def estimate_filter(
    image: npt.NDArray[np.floating], disparity: npt.NDArray[np.floating] | None = None
) -> FilterChoice:
    """Estimate the pixel filter of a picture: a box, a Gaussian, or the default if neither is certain.

    It is a box if the pixels beside depth edges are unmixed. With n agreeing edges, at least 45 % of all, the
    estimate of a Gaussian has the weight n / (n + 50), its confidence, and the default the rest. The default
    is no box: at true depth edges of path-traced pictures a box loses up to 2.8 dB.

    Args:
        image: Scene-linear picture, (H, W, 3).
        disparity: Map of the picture, (H, W), any unit; None for no map of the picture's size.

    Examples:
        >>> edge = 0.1 + 0.8 * PixelFilter("gaussian", 2.4).cumulative(np.arange(40.0) - 20)
        >>> estimate_filter(np.broadcast_to(edge[:, None], (400, 40, 3))).pixel_filter.width
        2.3...
    """
    leaks = np.empty(0) if disparity is None else edge_leaks(image, disparity)
    leak = float(np.median(leaks)) if len(leaks) >= _MIN_DEPTH_EDGES else 1.0
    if leak < _MAX_BOX_LEAK and np.count_nonzero(leaks > 0.5) <= _MAX_INEXACT_FRACTION * len(leaks):
        return FilterChoice(
            pixel_filter=PixelFilter("box", 1.0),
            reason=f"{len(leaks)} pixels at depth edges are unmixed",
            confidence=round(1 - max(leak, 0.0) / _MAX_BOX_LEAK, 3),
        )
    widths = edge_widths(image)
    if len(widths) < _MIN_EDGES:
        return FilterChoice(
            pixel_filter=DEFAULT_FILTER, reason=f"by default: {len(widths)} clear edges", confidence=0.0
        )
    width = float(np.quantile(widths, _QUANTILE))
    agreeing = np.count_nonzero(np.abs(np.log(widths / width)) < np.log(_AGREEMENT_RATIO))
    if agreeing < _MIN_AGREEMENT * len(widths) or width > _MAX_WIDTH_PX:
        return FilterChoice(
            pixel_filter=DEFAULT_FILTER,
            reason=f"by default: only {agreeing} of {len(widths)} clear edges agree",
            confidence=0.0,
        )
    confidence = agreeing / (agreeing + _HALF_CONFIDENCE_EDGES)
    return FilterChoice(
        pixel_filter=PixelFilter(
            "gaussian", round(confidence * width + (1 - confidence) * _DEFAULT_GAUSSIAN_WIDTH_PX, 2)
        ),
        reason=f"{width:.2f} by {agreeing} of {len(widths)} clear edges that agree",
        confidence=round(confidence, 3),
    )
