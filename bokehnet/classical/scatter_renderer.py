"""Scatter renderer: every pixel spreads over the shape of the aperture; the sums are normalised."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar, Unpack, cast

import numpy as np
import numpy.typing as npt
from numba import prange

from bokehnet.arrays.beyond_border import beyond_border
from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.base import (
    ALIGNED,
    ClassicalOptions,
    ClassicalResult,
    Strip,
    check_ideal_except_tilt,
    check_inputs,
)
from bokehnet.classical.error_map import boundary_threshold, geometric_error_map
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.scatter import pyramid_levels
from bokehnet.classical.scatter.disc_scatter import LARGEST_RADIUS
from bokehnet.classical.scatter.operators import scatter_operator
from bokehnet.deprecation import renamed_keywords
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["MAX_CONTINUATION", "render_scatter", "scatter", "scatter_beyond", "scatter_inside"]

# Largest continuation beyond each border as a fraction of the shorter side: discs that reach farther are
# normalised by the light within, so that a huge blur costs at most four times the pixels and keeps its color.
MAX_CONTINUATION = 0.5

Picture = TypeVar("Picture", bound=npt.NDArray[np.floating[Any]])


@njit(cache=True, parallel=True)
def _add_weight(image, values):
    """Fill ``values`` (H, W, 4) with the picture and a channel of ones."""
    height, width, _ = image.shape
    for y in prange(height):
        for x in range(width):
            for c in range(3):
                values[y, x, c] = image[y, x, c]
            values[y, x, 3] = 1.0


@njit(cache=True, parallel=True)
def _normalise(sums, image, bokeh):
    """Fill ``bokeh`` with colors over weight, or with the picture where no light arrives (hole of a ring)."""
    height, width, _ = image.shape
    for y in prange(height):
        for x in range(width):
            weight = sums[y, x, 3]
            for c in range(3):
                bokeh[y, x, c] = sums[y, x, c] / weight if weight > 0.0 else image[y, x, c]


def scatter_inside(
    image: Picture,
    defocus: npt.NDArray[np.floating[Any]],
    aperture: Aperture | None = None,
    viewport: Viewport | None = None,
) -> Picture:
    """Render the operator of :func:`scatter` alone: outside the picture there is no light.

    The sums are divided by the part of the discs inside, so that borders are not darkened. Arguments, result
    and errors as for :func:`scatter`.
    """
    light, defocus = check_inputs(image, defocus)
    if max(defocus.max(), -defocus.min()) > LARGEST_RADIUS:
        defocus = np.clip(defocus, -LARGEST_RADIUS, LARGEST_RADIUS)
    values = np.empty(
        (*defocus.shape, 4), light.dtype
    )  # NumPy allocates large arrays in huge pages, numba not
    with parallel_region:
        _add_weight(light, values)
    sums = pyramid_levels.scatter_forward(
        values, defocus, scatter_operator(aperture), overwrite=True, viewport=viewport
    )
    del values
    bokeh: Any = np.empty_like(light)
    with parallel_region:
        _normalise(sums, light, bokeh)
    return cast(Picture, bokeh)


@renamed_keywords
def scatter(
    image: Picture,
    defocus: npt.NDArray[np.floating[Any]],
    aperture: Aperture | None = None,
    viewport: Viewport | None = None,
) -> Picture:
    """Render bokeh by scattering, without occlusion.

    Args:
        image: All-in-focus picture, scene-linear, (H, W, 3), float32 or float64.
        defocus: Signed blur radius in pixels, (H, W), positive in front of focus.
        aperture: Shape of the aperture; default: a disc.
        viewport: Position of the pixels in the shown picture, for a cat's-eye; default: all of it is shown.

    Returns:
        Picture of the same shape and dtype. Pixels with |defocus| <= 0.5 that no neighbour reaches keep
        their value. The picture continues beyond its border as in every engine, see
        :mod:`bokehnet.arrays.beyond_border`.

    Raises:
        ShapeError: The arrays are not (H, W, 3) and (H, W) of the same size.
        ParameterError: NaN or infinity in either.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022, for the
        normalised scatter; :mod:`bokehnet.classical.scatter.disc_scatter` describes the discs, and
        :mod:`bokehnet.classical.scatter.pyramid_levels` the approximation of large ones.
    """
    light, radii = check_inputs(image, defocus)
    reach = math.ceil(max(float(radii.max()), -float(radii.min())))
    whole = viewport or Viewport.whole(*radii.shape)
    return cast(Picture, scatter_beyond(light, radii, aperture, reach, None, whole))


def scatter_beyond(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None,
    reach: int,
    strip: Strip | None,
    viewport: Viewport,
    scattered: Callable[..., np.ndarray] = scatter_inside,
) -> np.ndarray:
    """Scatter a picture that continues beyond its border, see :mod:`bokehnet.arrays.beyond_border`.

    The blur radius of the border is repeated. Where the arrays end inside the picture, only as many rows are
    added above them, and columns to the left, as align their blocks with those of the whole picture; they
    reach no pixel of the output.

    Args:
        image: Scene-linear picture, (H, W, 3) float32.
        defocus: Signed blur radius, (H, W) pixels.
        aperture: Shape of the aperture; default: a disc.
        reach: Maximum distance of a pixel's light from it, pixels.
        strip: Position of the arrays in their picture; ``None`` if they are all of it.
        viewport: Position of the arrays in the shown picture.
        scattered: Function that scatters, as :func:`scatter_inside`.
    """
    height, width = defocus.shape if strip is None else strip.size
    reach = min(reach, math.ceil(MAX_CONTINUATION * min(height, width)))
    if reach == 0:
        return scattered(image, defocus, aperture, viewport)
    above = below = left = right = reach
    if strip is not None:
        above, below = _continuation(reach, strip.first, strip.last, height)
        left, right = _continuation(reach, strip.left, strip.right, width)
    larger = scattered(
        beyond_border(image, above, below, left, right),
        np.pad(defocus, ((above, below), (left, right)), "edge"),
        aperture,
        replace(viewport, left=viewport.left - left, top=viewport.top - above),
    )
    rows, columns = image.shape[:2]
    return np.ascontiguousarray(larger[above : above + rows, left : left + columns])


def _continuation(reach: int, first: int, last: int, size: int) -> tuple[int, int]:
    """Return the pixels to add before ``first`` and behind ``last``, of ``size`` pixels along an axis."""
    return (reach + first) % ALIGNED if first > 0 else reach, 0 if last < size else reach


def render_scatter(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    scattered: Callable[..., np.ndarray] | None = None,
    **options: Unpack[ClassicalOptions],
) -> ClassicalResult:
    """Render with the scatter, and add the geometric error map; arguments and errors as for :func:`scatter`.

    Beyond its border the picture continues, see :func:`scatter_beyond`.

    The scatter unmixes no pixels and ignores the pixel filter. Of the lens it supports only the tilt of the
    focus plane, as far as the defocus contains it: discs stay round.

    A strip is rendered like any picture: its output is far enough from its ends. The threshold of the error
    map is that of the whole picture. Every pixel counts as one surface; ``known`` is ignored.
    ``scattered`` replaces :func:`scatter_inside`, for example on another device.
    """
    check_ideal_except_tilt(options.get("lens_response"), "scatter")
    strip, viewport, progress = options.get("strip"), options.get("viewport"), options.get("progress")
    size = defocus.shape if strip is None else strip.size
    viewport = viewport or Viewport.whole(*size)
    if strip is not None:
        viewport = replace(viewport, left=viewport.left + strip.left).below(strip.first)
    radius = (
        math.ceil(max(float(defocus.max()), -float(defocus.min()))) if strip is None else strip.max_coc_radius
    )
    bokeh = scatter_beyond(image, defocus, aperture, radius, strip, viewport, scattered or scatter_inside)
    if progress is not None:
        progress(0.9)
    result = ClassicalResult(bokeh=bokeh, error_map=geometric_error_map(defocus, boundary_threshold(size)))
    return result if strip is None else result.part(*strip.output)
