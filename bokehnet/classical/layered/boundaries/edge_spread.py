"""The pixel filter of a picture, estimated from its own sharpest edges.

A straight edge between two even surfaces is drawn as the integral of the pixel filter, the edge-spread
function. Profiles across clear edges, nine pixels long, are compared with those of Gaussian filters of all
widths and positions; the best one tells how wide the filter is there. An edge that slants is drawn wider
along a row, by the cosine of its angle. Shadows and blurred things are wider than the filter, nothing is
sharper: the narrower half of the edges tells it.

All in linear light. Edges of clipped light are left out, as they look sharper than they are.

Source: ISO 12233, "Photography: electronic still picture imaging: resolution", 2017, for edges as a measure
of sharpness. Templates in place of derivatives, and the quantile, are ours.
"""

import math
from functools import cache

import numpy as np
import numpy.typing as npt

from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, FilterChoice, PixelFilter

__all__ = ["edge_widths", "estimate_filter"]

# Half the length of a profile, pixels, and edges that are looked at, at the most.
_HALF, _MOST = 4, 20000

# An edge is clear where its sides differ by this part of their sum and by this part of the brightest light
# (of 1 where that is more), where this part of it at most does not fit, and where its slope is no steeper.
# Pictures that go no higher than 1 may be clipped from here on.
_CONTRAST, _LEAST_STEP, _FIT, _SLOPE, _CLIPPED = 0.15, 0.02, 0.09, 0.7, 0.97

# Rows that are looked at together.
_ROWS = 256

# Widths of the Gaussians that are tried, and places of the edge in its pixel.
_WIDTHS = np.geomspace(0.8, 5.0, 36)
_PLACES = np.linspace(-0.5, 0.5, 17)

# The filter is that of this quantile; so many edges that agree with it, but for this ratio, are believed
# half.
_QUANTILE, _HALF_SURE, _ALIKE = 0.3, 50, 1.15

# Fewest edges that are believed at all.
_FEWEST = 20

# The Gaussian that has the variance of the default filter.
_USUAL = 1.89

Array = npt.NDArray[np.float64]


@cache
def _templates() -> Array:
    """Edges of all widths and places, (widths * places, profile), with mean 0 and length 1."""
    across = np.arange(-_HALF, _HALF + 1.0) - _PLACES[:, None]
    found = np.concatenate([PixelFilter("gaussian", width).cumulative(across) for width in _WIDTHS])
    found -= found.mean(1, keepdims=True)
    templates: Array = found / np.linalg.norm(found, axis=1, keepdims=True)
    return templates


@cache
def _span() -> Array:
    """Directions that span the templates, (k, profile)."""
    _, lengths, directions = np.linalg.svd(_templates(), full_matrices=False)
    span: Array = directions[lengths > 1e-9 * lengths[0]]
    return span


def _clear_places(light: npt.NDArray[np.float32], least: float) -> npt.NDArray[np.int64]:
    """Places in the flat picture where rows cross a clear edge, (N,), in the order of the rows."""
    height, width = light.shape
    found = []
    for top in range(1, height - 1, _ROWS):
        rows = light[top : min(top + _ROWS, height - 1)]
        across = rows[:, _HALF + 1 : width - _HALF + 1] - rows[:, _HALF - 1 : width - _HALF - 1]
        before, after = rows[:, : -2 * _HALF], rows[:, 2 * _HALF :]
        step = np.abs(after - before)
        clear = (step > _CONTRAST * (after + before)) & (step > least)
        clear &= np.abs(across) > 0.3 * step
        y, x = np.nonzero(clear)
        found.append((y + top) * width + x + _HALF)
    return np.concatenate(found)


def _along_rows(light: npt.NDArray[np.float32], least: float, clipped: float) -> Array:
    """Widths of the clear edges that rows cross, (N,), pixels of a Gaussian filter.

    ``least`` is the smallest step, ``clipped`` the light from which on all may be clipped.
    """
    height, width = light.shape
    if height < 3 or width < 2 * _HALF + 3:
        return np.empty(0)
    places = _clear_places(light, least)
    if len(places) > _MOST:
        places = places[np.linspace(0, len(places) - 1, _MOST).astype(int)]
    rows, columns = places // width, places % width
    down = light[rows + 1, columns] - light[rows - 1, columns]
    right = light[rows, columns + 1] - light[rows, columns - 1]
    slope = np.abs(down / np.where(right == 0, 1, right))
    offsets = np.arange(-_HALF, _HALF + 1)
    profiles = light[rows[:, None], columns[:, None] + offsets].astype(np.float64)
    kept = (slope < _SLOPE) & (profiles.max(1) < clipped)
    profiles, slope = profiles[kept], slope[kept]
    profiles *= np.sign(profiles[:, -1] - profiles[:, 0])[:, None]
    profiles -= profiles.mean(1, keepdims=True)
    profiles /= np.linalg.norm(profiles, axis=1, keepdims=True)
    # What lies far from all that templates span is like none of them.
    within = np.einsum("ij,kj->ik", profiles, _span())  # where BLAS would wake its threads for little
    near = 1 - (within**2).sum(1) < 1.001 * _FIT**2
    profiles, slope = profiles[near], slope[near]
    likeness = profiles @ _templates().T
    best = likeness.argmax(1)
    place = _PLACES[best % len(_PLACES)]
    kept = (np.sqrt(np.maximum(1 - likeness.max(1) ** 2, 0)) < _FIT) & (np.abs(place) < 0.5)
    return np.asarray(_WIDTHS[best // len(_PLACES)] / np.hypot(1, slope))[kept]


def edge_widths(image: npt.NDArray[np.floating]) -> Array:
    """Widths of the Gaussian filters that would draw each clear edge, (N,), pixels.

    Args:
        image: Scene-linear, (H, W, 3).
    """
    light = np.asarray(image, np.float32) @ np.full(3, 1 / 3, np.float32)
    brightest = float(np.quantile(light[:: max(1, len(light) // 500)], 0.999))
    clipped = _CLIPPED if image.max() <= 1 + 1e-4 else math.inf
    least = _LEAST_STEP * min(brightest, 1.0)
    return np.concatenate([_along_rows(light, least, clipped), _along_rows(light.T, least, clipped)])


def estimate_filter(image: npt.NDArray[np.floating]) -> FilterChoice:
    """Estimate the pixel filter of a picture as a Gaussian; the default where fewer than 20 edges are clear.

    With n edges that agree with each other the estimate counts n / (n + 50), its confidence, and the default
    the rest.

    Args:
        image: Scene-linear, (H, W, 3).

    Examples:
        >>> edge = 0.1 + 0.8 * PixelFilter("gaussian", 2.4).cumulative(np.arange(40.0) - 20)
        >>> estimate_filter(np.broadcast_to(edge[:, None], (400, 40, 3))).pixel_filter.width
        2.3...
    """
    widths = edge_widths(image)
    if len(widths) < _FEWEST:
        return FilterChoice(
            pixel_filter=DEFAULT_FILTER, reason=f"by default: {len(widths)} clear edges", confidence=0.0
        )
    width = float(np.quantile(widths, _QUANTILE))
    alike = np.count_nonzero(np.abs(np.log(widths / width)) < np.log(_ALIKE))
    sure = alike / (alike + _HALF_SURE)
    return FilterChoice(
        pixel_filter=PixelFilter("gaussian", round(sure * width + (1 - sure) * _USUAL, 2)),
        reason=f"{width:.2f} by {alike} of {len(widths)} clear edges that agree",
        confidence=round(sure, 3),
    )
