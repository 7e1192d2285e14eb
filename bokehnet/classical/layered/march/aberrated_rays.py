"""Rays of an aberrated lens, eight at once: origins and directions from its aberration map.

The coefficients of :class:`bokehnet.optics.aberrations.aberration_map.AberrationMap` change smoothly with the
wavelength; a parabola over a variable that grows with the dispersion of glass fits them, so that each ray can
have a wavelength of its own. The field position is that of the pixel, which leaves ten coefficients for each
polynomial.
"""

import math
from typing import NamedTuple

import numpy as np

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.simd.float8 import broadcast8, divide8, less8, select8
from bokehnet.errors import ParameterError
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.aberration_map import TERMS
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH

__all__ = [
    "ORDERS",
    "VISIBLE_DEVIATION_PX",
    "LensTable",
    "collapse",
    "keep_within",
    "lens_table",
    "send_channels",
    "send_rays",
]

# Coefficients of the parabola over the wavelength.
ORDERS = 3

# Wavelengths at which the parabola is fitted.
_NODES = 13

# Sampling of the largest transverse aberration: field positions from centre to corner, rings and spokes of
# the pupil.
_FIELDS, _RINGS, _SPOKES = 33, 8, 24

# Pixels; where rays deviate by less, rays and scatter are blended.
VISIBLE_DEVIATION_PX = 0.5

# Monomials in (a.a, a.h) that remain for a known field position.
_PAIRS = tuple(sorted({(i, j) for i, j, _ in TERMS}))
assert _PAIRS == ((0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2), (2, 0), (2, 1), (3, 0))

_MAX_TILT = 0.8


class LensTable(NamedTuple):
    """Lens response for one picture, in the form that kernels read.

    Attributes:
        coefficients: Coefficients of f and g of the transverse aberration in pixels, and of the pupil
            aberration if there is any, by powers of h.h and of the wavelength variable: (4, 1 or ORDERS, 2 or
            4, 10), float32.
        waves: Wavelength variable of each ray of the pattern, (rays,) float32.
        starts: Origin of each ray in its pixel, from its centre, (2, rays) float32.
        jitter_scale: Fraction of the pixel over which the origins spread, by the distance from the centre of
            the picture, (n,): 1 where rays of one color deviate by the same amount, so that a shift by a
            fraction of a pixel is visible as such; 0 where they deviate differently, or hardly.
        colors: Red, green and blue of each ray, (3, rays) float32; (3, 0) without dispersion.
        chromatic_aberration: Axial and lateral color of each ray, pixels, (2, rays) float32; or (2, 0).
        channel_waves: Wavelength variable of red, green and blue for rays that are sent per channel, (3,
            rays) float32; (3, 0) without dispersion.
        channel_aberration: Axial and lateral color of these rays, (3, 2, rays) float32; or (3, 2, 0).
        maps: Factors of both at each rendered pixel, (H, W, 2) float32; or (0, 0, 2).
        vignetting_apertures: Shift and radius, (R, 2); radius below 0 where the inside is dark.
        tilt: Tilt of the focus plane, and axes of the aperture, (4, 2) float32.
        column: Column of the centre of the picture, pixels.
        row: Row of the centre, pixels.
        scale: Reciprocal of the half-diagonal in pixels.
        max_aberration: Upper bound of the transverse aberration of transmitted rays, pixels, by the distance
            from the centre, (n,), up to the corner.
        max_stretch: Upper bound of the deviation from a perfect lens, as a fraction of the blur radius, (n,).
    """

    coefficients: np.ndarray
    waves: np.ndarray
    starts: np.ndarray
    jitter_scale: np.ndarray
    colors: np.ndarray
    chromatic_aberration: np.ndarray
    channel_waves: np.ndarray
    channel_aberration: np.ndarray
    maps: np.ndarray
    vignetting_apertures: np.ndarray
    tilt: np.ndarray
    column: float
    row: float
    scale: float
    max_aberration: np.ndarray
    max_stretch: np.ndarray

    @property
    def footprint(self) -> tuple[float, float]:
        """Upper bounds of |A| and of the transverse aberration in pixels, anywhere in the picture."""
        return float(1 + self.max_stretch.max()), float(self.max_aberration.max())

    def reach(self, radius: float) -> int:
        """Return the maximum distance of a pixel's rays from it, pixels, for a largest blur radius."""
        stretch, aberration = self.footprint
        return math.ceil(stretch * radius + aberration)

    def visible_deviation(self, shape: tuple[int, int], radius: float, above: int) -> np.ndarray:
        """Return the deviation of the rays from those of a perfect lens: 1 from half a pixel on.

        Args:
            shape: Height and width of the picture, or of a strip of it.
            radius: Largest blur radius, pixels.
            above: Rows of the picture above the strip.

        Returns:
            Map of the deviation, (H, W) float32 in [0, 1].
        """
        deviation = np.minimum((self.max_aberration + radius * self.max_stretch) / VISIBLE_DEVIATION_PX, 1.0)
        field = np.linalg.norm(_fields(shape, above, self.column, self.row, self.scale), axis=-1)
        return np.interp(field, np.linspace(0, 1, len(deviation)), deviation).astype(np.float32)


def _fields(shape: tuple[int, ...], above: int, column: float, row: float, scale: float) -> np.ndarray:
    """Return the field position of each pixel, (H, W, 2) float32."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    return np.stack([scale * (x - column), scale * (y + above - row)], -1)


def _variable(wavelength: np.ndarray) -> np.ndarray:
    """Return a variable that grows with dispersion (Cauchy); -1 to 1 over the visible spectrum."""
    ends = MIN_WAVELENGTH**-2, MAX_WAVELENGTH**-2
    return (2 * wavelength**-2.0 - ends[0] - ends[1]) / (ends[0] - ends[1])


def lens_table(
    lens_response: LensResponse,
    viewport: Viewport,
    chances: np.ndarray,
    *,
    above: int = 0,
    shape: tuple[int, ...] = (0, 0),
) -> LensTable:
    """Prepare a lens response for pictures of one size.

    Args:
        lens_response: Response of the lens.
        viewport: Position of the full-size picture in the shown one.
        chances: Evenly distributed numbers from 0 to 1, three per ray of the pattern, (rays, 3): wavelength,
            and origin in the pixel.
        above: Rows of the picture above the rendered ones.
        shape: Height and width of the rendered rows.

    Raises:
        ParameterError: The tilt of the focus plane is so large that some rays never meet the scene.
    """
    aberration_map = lens_response.aberration_map
    if math.hypot(*aberration_map.tilt) > _MAX_TILT:
        raise ParameterError(
            "tilt",
            f"a defocus that changes by up to {_MAX_TILT} pixels per pixel",
            aberration_map.tilt,
            "tilt less or blur less",
            shown=f"{math.hypot(*aberration_map.tilt):.2g}",
        )
    column, row, scale = viewport.frame
    half_diagonal = 1 / scale
    wavelengths, colors = lens_response.wavelengths_at(chances[:, 0])
    nodes = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, _NODES)
    values, pupil_aberration = aberration_map.at(nodes)
    values = half_diagonal * values
    if pupil_aberration.any():
        values = np.concatenate([values, pupil_aberration], axis=1)
    if aberration_map.is_dispersive:
        powers = _variable(nodes)[:, None] ** np.arange(ORDERS)
        fitted = np.linalg.lstsq(powers, values.reshape(_NODES, -1), rcond=None)[0]
        coefficients = fitted.reshape(ORDERS, *values.shape[1:])
    else:
        coefficients = values[:1]
    by_field = np.zeros((4, *coefficients.shape[:2], len(_PAIRS)), np.float32)
    for term, (i, j, k) in enumerate(TERMS):
        by_field[k, ..., _PAIRS.index((i, j))] = coefficients[..., term]
    by_channel = np.zeros((0, 3))
    if lens_response.is_dispersive:
        by_channel = lens_response.wavelength_sampling.by_channel(chances[:, 0])
    chromatic_aberration, maps = np.zeros((0, 2)), np.zeros((0, 0, 2))
    channel_aberration = np.zeros((0, 3, 2))
    if lens_response.chromatic_aberration is not None and not lens_response.chromatic_aberration.is_none:
        chromatic_aberration = half_diagonal * lens_response.chromatic_aberration.strengths(wavelengths)
        channel_aberration = half_diagonal * lens_response.chromatic_aberration.strengths(by_channel)
        maps = lens_response.chromatic_aberration.maps(_fields(shape[:2], above, column, row, scale))
    if not lens_response.is_dispersive:
        colors = np.zeros((0, 3))
    largest, stretch, spread = _bounds(lens_response, half_diagonal)
    return LensTable(
        coefficients=by_field,
        waves=_variable(wavelengths).astype(np.float32),
        starts=np.ascontiguousarray(chances[:, 1:].T - 0.5, np.float32),
        jitter_scale=np.minimum(largest / VISIBLE_DEVIATION_PX, 1.0) * np.clip(1.0 - spread, 0.0, 1.0),
        colors=np.ascontiguousarray(colors.T, np.float32),
        chromatic_aberration=np.ascontiguousarray(chromatic_aberration.T, np.float32),
        channel_waves=np.ascontiguousarray(_variable(by_channel).T, np.float32),
        channel_aberration=np.ascontiguousarray(channel_aberration.transpose(1, 2, 0), np.float32),
        maps=np.ascontiguousarray(maps, np.float32),
        vignetting_apertures=np.array(aberration_map.vignetting_apertures, np.float32).reshape(-1, 2),
        tilt=np.array((aberration_map.tilt, *aberration_map.aperture_axes), np.float32),
        column=column,
        row=row,
        scale=scale,
        max_aberration=largest,
        max_stretch=stretch,
    )


def _bounds(lens_response: LensResponse, half_diagonal: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ``max_aberration`` and ``max_stretch`` of :class:`LensTable`, and the spread of one color.

    The spread is the mean over wavelengths and directions of the largest distance from the mean transverse
    aberration, pixels.
    """
    aberration_map = lens_response.aberration_map
    radius = (np.arange(_RINGS) + 1) / _RINGS
    angle = np.arange(_SPOKES) * (2 * math.pi / _SPOKES)
    pupil = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    fields = np.linspace(0, 1, _FIELDS)
    directions = (
        np.arange(8) * (math.pi / 4)
        if any(aberration_map.tilt) or lens_response.chromatic_aberration is not None
        else [0.0]
    )
    wavelengths = np.union1d(aberration_map.wavelengths, [MIN_WAVELENGTH, MAX_WAVELENGTH])
    largest, stretch = np.zeros(_FIELDS), np.zeros(_FIELDS)
    spread = np.zeros((len(directions), len(wavelengths), _FIELDS))
    for at, direction in enumerate(directions):
        field = fields[:, None, None, None] * np.array([math.cos(direction), math.sin(direction)])
        for color, wavelength in enumerate(wavelengths):
            transverse_aberration, run, passes = aberration_map(pupil[None], field, wavelength)
            transverse_aberration = half_diagonal * transverse_aberration
            if lens_response.chromatic_aberration is not None:
                axial, lateral = (
                    half_diagonal * lens_response.chromatic_aberration.strengths(np.array([wavelength]))[0]
                )
                maps = lens_response.chromatic_aberration.maps(field)
                transverse_aberration = (
                    transverse_aberration + axial * maps[..., :1] * pupil + lateral * maps[..., 1:] * field
                )
            largest = np.maximum(
                largest, (passes * np.linalg.norm(transverse_aberration, axis=-1)).max((1, 2))
            )
            stretch = np.maximum(stretch, (passes * np.linalg.norm(run - pupil, axis=-1)).max((1, 2)))
            stretch = np.maximum(stretch, 1.0 - passes.mean((1, 2)))
            weights = passes[..., None] / np.maximum(passes.sum((1, 2)), 1)[:, None, None, None]
            deviation = transverse_aberration - (weights * transverse_aberration).sum((1, 2), keepdims=True)
            spread[at, color] = (passes * np.linalg.norm(deviation, axis=-1)).max((1, 2))
    return (
        largest,
        stretch,
        np.trapezoid(spread.mean(0), wavelengths, axis=0) / (MAX_WAVELENGTH - MIN_WAVELENGTH),
    )


@njit(cache=True, forceinline=True)
def collapse(coefficients, square, collapsed):
    """Fill ``collapsed`` (orders, 2 or 4, 10) with the coefficients for h.h = ``square``."""
    fourth, third = coefficients[3].reshape(-1), coefficients[2].reshape(-1)
    second, first = coefficients[1].reshape(-1), coefficients[0].reshape(-1)
    flat = collapsed.reshape(-1)
    for i in range(flat.size):
        flat[i] = ((fourth[i] * square + third[i]) * square + second[i]) * square + first[i]


@njit(cache=True, forceinline=True)
def _polynomial(c, order, which, x, y):
    """Return the polynomial in the lanes x = a.a and y = a.h, from the collapsed coefficients."""
    inner = broadcast8(c[order, which, 8]) * y + broadcast8(c[order, which, 7])
    inner = (broadcast8(c[order, which, 9]) * x + inner) * x
    row = broadcast8(c[order, which, 6]) * y + broadcast8(c[order, which, 5])
    inner = (row * y + broadcast8(c[order, which, 4]) + inner) * x
    row = broadcast8(c[order, which, 3]) * y + broadcast8(c[order, which, 2])
    row = (row * y + broadcast8(c[order, which, 1])) * y + broadcast8(c[order, which, 0])
    return row + inner


@njit(cache=True, forceinline=True)
def _run_lanes(collapsed, tilt, u, v, h_x, h_y, f, g, bend_f, bend_g):
    """Return E and A of eight rays from the polynomials at their wavelengths; see :func:`send_rays`."""
    across, down = broadcast8(h_x), broadcast8(h_y)
    a_x, a_y = u, v
    if collapsed.shape[1] == 4:
        a_x, a_y = a_x + u * bend_f + across * bend_g, a_y + v * bend_f + down * bend_g
    if tilt[3, 0] != 0.0 or tilt[3, 1] != 0.0:
        along = broadcast8(tilt[3, 0]) * a_x + broadcast8(tilt[3, 1]) * a_y
        a_x, a_y = (
            broadcast8(tilt[1, 0]) * a_x + broadcast8(tilt[1, 1]) * a_y - along * across,
            broadcast8(tilt[2, 0]) * a_x + broadcast8(tilt[2, 1]) * a_y - along * down,
        )
    if tilt[0, 0] != 0.0 or tilt[0, 1] != 0.0:
        divisor = broadcast8(np.float32(1)) + broadcast8(tilt[0, 0]) * u + broadcast8(tilt[0, 1]) * v
        a_x, a_y = divide8(a_x, divisor), divide8(a_y, divisor)
    return u * f + across * g, v * f + down * g, a_x, a_y


@njit(cache=True, forceinline=True)
def send_rays(collapsed, tilt, u, v, h_x, h_y, wave):
    """Return transverse aberration E in pixels and coordinates A of eight rays: (E_x, E_y, A_x, A_y).

    Args:
        collapsed: Coefficients of the pixel, from :func:`collapse`.
        tilt: Tilt of the lens table.
        u: Aperture coordinate along x, lanes of float32.
        v: Aperture coordinate along y, lanes of float32.
        h_x: Field position of the pixel along x, float32.
        h_y: Field position of the pixel along y, float32.
        wave: Wavelength variable, lanes.

    Returns:
        Four lanes of float32.
    """
    square, product = u * u + v * v, u * broadcast8(h_x) + v * broadcast8(h_y)
    bent = collapsed.shape[1] == 4
    f, g = _polynomial(collapsed, 0, 0, square, product), _polynomial(collapsed, 0, 1, square, product)
    bend_f, bend_g = f, g
    if bent:
        bend_f = _polynomial(collapsed, 0, 2, square, product)
        bend_g = _polynomial(collapsed, 0, 3, square, product)
    power = wave
    for order in range(1, collapsed.shape[0]):
        f = f + power * _polynomial(collapsed, order, 0, square, product)
        g = g + power * _polynomial(collapsed, order, 1, square, product)
        if bent:
            bend_f = bend_f + power * _polynomial(collapsed, order, 2, square, product)
            bend_g = bend_g + power * _polynomial(collapsed, order, 3, square, product)
        power = power * wave
    return _run_lanes(collapsed, tilt, u, v, h_x, h_y, f, g, bend_f, bend_g)


@njit(cache=True, forceinline=True)
def send_channels(collapsed, tilt, u, v, h_x, h_y, waves):
    """Return the result of :func:`send_rays` for each of three wavelengths, three tuples of lanes."""
    square, product = u * u + v * v, u * broadcast8(h_x) + v * broadcast8(h_y)
    bent = collapsed.shape[1] == 4
    f, g = _polynomial(collapsed, 0, 0, square, product), _polynomial(collapsed, 0, 1, square, product)
    bend_f, bend_g = f, g
    if bent:
        bend_f = _polynomial(collapsed, 0, 2, square, product)
        bend_g = _polynomial(collapsed, 0, 3, square, product)
    fs, gs, bend_fs, bend_gs = (f, f, f), (g, g, g), (bend_f, bend_f, bend_f), (bend_g, bend_g, bend_g)
    powers = waves
    for order in range(1, collapsed.shape[0]):
        fs = _add_order(fs, powers, _polynomial(collapsed, order, 0, square, product))
        gs = _add_order(gs, powers, _polynomial(collapsed, order, 1, square, product))
        if bent:
            bend_fs = _add_order(bend_fs, powers, _polynomial(collapsed, order, 2, square, product))
            bend_gs = _add_order(bend_gs, powers, _polynomial(collapsed, order, 3, square, product))
        powers = (powers[0] * waves[0], powers[1] * waves[1], powers[2] * waves[2])
    return (
        _run_lanes(collapsed, tilt, u, v, h_x, h_y, fs[0], gs[0], bend_fs[0], bend_gs[0]),
        _run_lanes(collapsed, tilt, u, v, h_x, h_y, fs[1], gs[1], bend_fs[1], bend_gs[1]),
        _run_lanes(collapsed, tilt, u, v, h_x, h_y, fs[2], gs[2], bend_fs[2], bend_gs[2]),
    )


@njit(cache=True, forceinline=True)
def _add_order(sums, powers, values):
    return sums[0] + powers[0] * values, sums[1] + powers[1] * values, sums[2] + powers[2] * values


@njit(cache=True, forceinline=True)
def keep_within(u, v, shift_x, shift_y, radius, w):
    """Return the weights ``w`` (lanes) of rays inside a pupil circle; outside if its radius is negative."""
    away_x, away_y = u - broadcast8(np.float32(shift_x)), v - broadcast8(np.float32(shift_y))
    beyond = less8(broadcast8(np.float32(radius * radius)), away_x * away_x + away_y * away_y)
    if radius < 0:
        return select8(beyond, w, broadcast8(np.float32(0)))
    return select8(beyond, broadcast8(np.float32(0)), w)
