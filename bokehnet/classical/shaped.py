"""Spread every pixel over the shape of any lens opening, and the adjoint.

All parts of one pixel's light sum to one, whatever the shape. The cat's-eye cuts each row of a shape to an
interval and divides by the share that is left, so that there, too, a pixel keeps all its light: the loss
of light itself is left out, for the sums are divided by the weights in the end.

Shapes beyond the tables' largest radius are spread on pictures of every second row and column
(:mod:`bokehnet.classical.lattices`), four of them, so that no source moves, and come back by linear
interpolation. That blurs by a variance of 3/4 pixel^2, next to the r^2 / 4 of a disc.
"""

from collections.abc import Iterator

import numpy as np

from bokehnet.classical.cats_eye import View, every_second, make_view, share_table
from bokehnet.classical.kernels import LARGEST_RADIUS
from bokehnet.classical.lanes import LANES
from bokehnet.classical.lattices import add_lattice, gather_lattice, lattice_shape
from bokehnet.classical.parallel import parallel_region
from bokehnet.classical.shape_kernels import CHANNELS, shaped_backward, shaped_forward
from bokehnet.classical.shape_tables import LARGEST_TABLE, shape_table
from bokehnet.optics.aperture import Aperture

__all__ = ["spread_backward", "spread_forward"]


def _groups(values: np.ndarray) -> list[np.ndarray]:
    """Cut the channels into groups of four, the last one filled up with zeros."""
    missing = -values.shape[2] % CHANNELS
    filled = np.pad(values, ((0, 0), (0, 0), (0, missing))) if missing else values
    groups = range(0, filled.shape[2], CHANNELS)
    return [np.ascontiguousarray(filled[:, :, c : c + CHANNELS]) for c in groups]


def _join(groups: list[np.ndarray], channels: int) -> np.ndarray:
    """Put groups of channels together again."""
    joined = groups[0] if len(groups) == 1 else np.concatenate(groups, axis=2)
    return joined[:, :, :channels]


def _lattices(
    values: np.ndarray, defocus: np.ndarray, view: View
) -> Iterator[tuple[int, int, np.ndarray, np.ndarray, np.ndarray, View]]:
    """Sources beyond the tables: where a lattice starts, where it has any, their values, defocus and view.

    The values are quartered, for a pixel of a lattice stands for four.
    """
    for y, x in np.ndindex(2, 2):
        lattice = defocus[y::2, x::2]
        places = np.abs(lattice) > LARGEST_TABLE
        if places.any():
            shape = lattice_shape(defocus.shape[0], defocus.shape[1], y, x)
            coarse_values, coarse_defocus = (
                np.zeros((*shape, CHANNELS), values.dtype),
                np.zeros(shape, values.dtype),
            )
            coarse_values[1:-1, 1:-1][places] = values[y::2, x::2][places] / 4
            coarse_defocus[1:-1, 1:-1][places] = lattice[places] / 2
            yield y, x, places, coarse_values, coarse_defocus, every_second(view, x - 2, y - 2)


def _spread(values: np.ndarray, defocus: np.ndarray, aperture: Aperture, view: View) -> np.ndarray:
    """Spread (H, W, 4)."""
    table = shape_table(aperture, float(np.abs(defocus).max()), values.dtype.name)
    shares, margin = share_table(aperture, table), int(table.reach[-1]) + LANES
    sums = np.empty_like(values)
    with parallel_region:
        shaped_forward(values, defocus, table, shares, view, margin, sums)
    for y, x, _, coarse_values, coarse_defocus, coarse_view in _lattices(values, defocus, view):
        coarse = _spread(coarse_values, coarse_defocus, aperture, coarse_view)
        with parallel_region:
            add_lattice(coarse, y, x, sums)
    return sums


def _gather(
    values: np.ndarray, defocus: np.ndarray, gradient: np.ndarray, aperture: Aperture, view: View
) -> tuple[np.ndarray, np.ndarray]:
    """Adjoint of :func:`_spread`."""
    table = shape_table(aperture, float(np.abs(defocus).max()), values.dtype.name)
    shares, margin = share_table(aperture, table), int(table.reach[-1]) + LANES
    padded = np.pad(gradient, ((0, 0), (margin, margin), (0, 0))).ravel()
    grad_values, grad_defocus = np.zeros_like(values), np.zeros_like(defocus)
    with parallel_region:
        shaped_backward(values, defocus, padded, table, shares, view, margin, grad_values, grad_defocus)
    for y, x, places, coarse_values, coarse_defocus, coarse_view in _lattices(values, defocus, view):
        coarse = np.empty_like(coarse_values)
        with parallel_region:
            gather_lattice(gradient, y, x, coarse)
        gathered, slopes = _gather(coarse_values, coarse_defocus, coarse, aperture, coarse_view)
        grad_values[y::2, x::2][places] = gathered[1:-1, 1:-1][places] / 4
        grad_defocus[y::2, x::2][places] = slopes[1:-1, 1:-1][places] / 2
    return grad_values, grad_defocus


def _prepare(
    defocus: np.ndarray, aperture: Aperture, dtype: np.dtype, full_shape: tuple[int, int] | None, scale: float
) -> tuple[np.ndarray, View]:
    """The defocus as the kernels take it, and the grid's place in the picture."""
    height, width = defocus.shape
    view = make_view(aperture.cats_eye, full_shape or (height, width), scale)
    return np.ascontiguousarray(np.clip(defocus, -LARGEST_RADIUS, LARGEST_RADIUS), dtype), view


def spread_forward(
    values: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture,
    *,
    full_shape: tuple[int, int] | None = None,
    scale: float = 1.0,
) -> np.ndarray:
    """Spread the values of every pixel over the shape of the opening, and add up.

    Args:
        values: (H, W, C), float32 or float64; a channel of ones gives the weights. A pixel whose values
            are all 0 costs nothing. Four channels at a time: one costs as much as four.
        defocus: Signed blur radius in pixels of this grid, (H, W), finite, + in front of focus. Up to 0.5
            pixels (to both sides) a pixel stays as it is.
        aperture: The opening.
        full_shape: Height and width of the full-size picture, for the cat's-eye; default this one's.
        scale: Full-size pixels per pixel: pixel x of this grid is centred on (x + 1/2) scale - 1/2.

    Returns:
        Sums (H, W, C), of the values' dtype. The parts of one pixel sum to one (with a cat's-eye within
        half a percent) as long as they fall into the picture.
    """
    defocus, view = _prepare(defocus, aperture, values.dtype, full_shape, scale)
    return _join([_spread(group, defocus, aperture, view) for group in _groups(values)], values.shape[2])


def spread_backward(
    values: np.ndarray,
    defocus: np.ndarray,
    grad_sums: np.ndarray,
    aperture: Aperture,
    *,
    full_shape: tuple[int, int] | None = None,
    scale: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Adjoint of :func:`spread_forward`, at the same cost.

    Args:
        values: As given to the forward.
        defocus: The same.
        grad_sums: Gradient for the sums, (H, W, C).
        aperture: As given to the forward.
        full_shape: The same.
        scale: The same.

    Returns:
        Gradients for the values (H, W, C) and the defocus (H, W). The latter is 0 where the magnitude is
        up to 1/2 or above ``LARGEST_RADIUS``.
    """
    clipped, view = _prepare(defocus, aperture, values.dtype, full_shape, scale)
    grad_values, grad_defocus = [], np.zeros_like(clipped)
    for group, gradient in zip(_groups(values), _groups(grad_sums), strict=True):
        gathered, slopes = _gather(group, clipped, gradient, aperture, view)
        grad_values.append(gathered)
        grad_defocus += slopes
    grad_defocus[np.abs(defocus) > LARGEST_RADIUS] = 0
    return _join(grad_values, values.shape[2]), grad_defocus
