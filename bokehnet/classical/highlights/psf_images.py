"""Disc of a light as a picture of its own: fraction of its energy on each pixel.

Behind a perfect lens a light at q with defocus d lights the pixels ``q + d a`` for every open point a of the
pupil. A pixel's fraction is the transmission over its square, projected to the pupil: four lookups in running
sums. Squares of adjacent pixels share their corners, so the fractions sum to one at every position of the
light and every radius, and edges are as smooth as the pixel grid can show them.

A light that was merged from neighbours is a rectangle of even brightness instead of a point. A disc averaged
over n by m pixels needs the same four lookups with a rectangle of n by m pixels, so that a merged row of
equal pixels is exactly their sum.

Source: Crow, "Summed-area tables for texture mapping", SIGGRAPH 1984, for running sums; fractions of pixels
and rectangles are ours.
"""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Frame
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture, transmission

__all__ = [
    "PerfectPsf",
    "cover_cells",
    "passing",
    "place_psf_images",
    "profile_sums",
    "share_at",
    "vignetting_shares",
]

# Cells across the pupil: minimum, maximum, and number per pixel of the disc's diameter.
_MIN_CELLS, _MAX_CELLS, _CELLS_PER_PIXEL = 512, 2048, 4

# Cells that resolve the slow change of the light away from edges.
_INNER_CELLS = 512

# Samples on each side of the pupil's square where an edge of the aperture crosses it, and the minimum number
# per cell.
_EDGE_SAMPLES, _MIN_SAMPLES = 8192, 8

# Field positions along each side of the square [-1, 1]^2 at which the fraction that vignetting apertures
# transmit is tabulated, and pupil points along each side for its sum.
_FIELDS, _POINTS = 33, 128


def cover_cells(radius: float) -> int:
    """Return the number of cells across the pupil for discs of a radius in pixels, a power of two."""
    cells = 2 * radius * _CELLS_PER_PIXEL
    return int(min(max(_MIN_CELLS, 2 ** math.ceil(math.log2(max(cells, 1)))), _MAX_CELLS))


def _inner_light(aperture: Aperture, side: int, cells: int) -> np.ndarray:
    """Return the mean transmission of each cell away from edges."""
    coarse = min(cells, _INNER_CELLS) if aperture.picture is None else cells
    samples = 1
    if aperture.picture is not None:
        samples += math.ceil(max(aperture.picture.shape) / cells)
    axis = (np.arange(coarse * samples) + 0.5) * (2 / (coarse * samples)) - 1
    light = transmission(aperture, axis[None, :], axis[:, None], side)
    light = light.reshape(coarse, samples, coarse, samples).mean(axis=(1, 3))
    return np.repeat(np.repeat(light, cells // coarse, 0), cells // coarse, 1)


@lru_cache(maxsize=2)
def profile_sums(aperture: Aperture, side: int, cells: int) -> np.ndarray:
    """Return running sums of the transmission over the pupil, total 1; (cells + 1, cells + 1), along v, u.

    Args:
        aperture: Shape of the aperture, without its cat's-eye.
        side: +1 in front of focus, -1 behind it.
        cells: Cells along each side of the square [-1, 1]^2.
    """
    light = _inner_light(aperture, side, cells)
    edges = np.arange(cells + 1) * (2 / cells) - 1
    outline = replace(aperture, spherical_profile=0.0, onion=0.0, grain=0.0)
    lit = transmission(outline, edges[None, :], edges[:, None]) > 0
    corners = lit[:-1, :-1] * 1 + lit[1:, :-1] + lit[:-1, 1:] + lit[1:, 1:]
    row, column = np.nonzero((corners > 0) & (corners < 4) | ((light > 0) != (corners == 4)))
    samples = max(_MIN_SAMPLES, _EDGE_SAMPLES // cells)
    inside = (np.arange(samples) + 0.5) * (2 / cells / samples)
    for batch in np.array_split(np.arange(len(row)), len(row) // 4096 + 1):
        u = edges[column[batch]][:, None, None] + inside[None, None, :]
        v = edges[row[batch]][:, None, None] + inside[None, :, None]
        light[row[batch], column[batch]] = transmission(aperture, u, v, side).mean(axis=(1, 2))
    sums = np.pad(light.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    sums /= sums[-1, -1]
    sums.setflags(write=False)
    return sums


@lru_cache(maxsize=8)
def vignetting_shares(
    aperture: Aperture, vignetting_apertures: tuple[tuple[float, float], ...]
) -> np.ndarray:
    """Return the fraction that vignetting apertures transmit, (2 sides, fields, fields), field [-1, 1]^2.

    Args:
        aperture: Shape of the aperture, without its cat's-eye.
        vignetting_apertures: Pairs (shift, radius) as in
            :class:`bokehnet.optics.aberrations.aberration_map.AberrationMap`.

    Returns:
        Fractions above 0; in front of focus first. Lights are divided by them, as all other light in the
        picture is divided by the light transmitted at its position.
    """
    axis, fields = (np.arange(_POINTS) + 0.5) * (2 / _POINTS) - 1, np.linspace(-1, 1, _FIELDS)
    light = np.stack([transmission(aperture, axis[None], axis[:, None], side) for side in (1, -1)])
    light = light / light.sum(axis=(1, 2), keepdims=True)
    shares = np.empty((2, _FIELDS, _FIELDS))
    for i, y in enumerate(fields):
        for j, x in enumerate(fields):
            passes: np.ndarray = np.ones((_POINTS, _POINTS))
            for shift, radius in vignetting_apertures:
                distance = np.hypot(axis[None] - shift * x, axis[:, None] - shift * y)
                within = radius - distance if radius > 0 else distance + radius
                passes = passes * np.clip(0.5 + within * (_POINTS / 2), 0, 1)
            shares[:, i, j] = (light * passes).sum(axis=(1, 2))
    shares = np.maximum(shares, 1e-3)
    shares.setflags(write=False)
    return shares


@njit(cache=True)
def share_at(shares, side, h_x, h_y):
    """Return the transmitted fraction at a field position, by bilinear interpolation."""
    last = shares.shape[1] - 1
    column = min(max((h_x + 1.0) * 0.5 * last, 0.0), last - 1e-9)
    row = min(max((h_y + 1.0) * 0.5 * last, 0.0), last - 1e-9)
    j, i = int(column), int(row)
    x, y = column - j, row - i
    upper = shares[side, i, j] * (1.0 - x) + shares[side, i, j + 1] * x
    lower = shares[side, i + 1, j] * (1.0 - x) + shares[side, i + 1, j + 1] * x
    return upper * (1.0 - y) + lower * y


@njit(cache=True)
def passing(vignetting_apertures, u, v, h_x, h_y, sharpness):
    """Return the transmittance of all vignetting apertures at (u, v), with edges of width 1 / sharpness."""
    transmittance = 1.0
    for i in range(vignetting_apertures.shape[0]):
        distance = math.hypot(u - vignetting_apertures[i, 0] * h_x, v - vignetting_apertures[i, 0] * h_y)
        radius = vignetting_apertures[i, 1]
        within = radius - distance if radius > 0.0 else distance + radius
        transmittance *= min(max(0.5 + within * sharpness, 0.0), 1.0)
    return transmittance


def place_psf_images(lights: np.ndarray, margin: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return rows and columns (top, bottom, left, right) of each light's PSF image in the picture, (N, 4).

    Args:
        lights: (N, 8), see :func:`bokehnet.classical.highlights.lights.separate_lights`.
        margin: Reach of the disc from its light, to the right and down, pixels, (N, 2).
        shape: Height and width of the picture.
    """
    reach = margin + lights[:, 6:8] / 2 + 0.5
    low, high = np.floor(lights[:, :2] - reach), np.ceil(lights[:, :2] + reach) + 1
    low, high = np.maximum(low, 0), np.minimum(high, (shape[1], shape[0]))
    high = np.maximum(high, low)
    return np.stack([low[:, 1], high[:, 1], low[:, 0], high[:, 0]], axis=1).astype(np.int64)


@njit(cache=True)
def _sum_at(sums, row, y, position):
    """Return the running sum at the row ``row + y`` and a column ``position``, both in cells, bilinear."""
    last = sums.shape[1] - 1
    position = min(max(position, 0.0), float(last))
    column = min(int(position), last - 1)
    x = position - column
    upper = sums[row, column] * (1.0 - x) + sums[row, column + 1] * x
    lower = sums[row + 1, column] * (1.0 - x) + sums[row + 1, column + 1] * x
    return upper * (1.0 - y) + lower * y


@njit(cache=True)
def _split(position, last):
    """Return cell and position inside it, clipped to the sums."""
    position = min(max(position, 0.0), float(last))
    cell = min(int(position), last - 1)
    return cell, position - cell


@njit(cache=True, parallel=True)
def _fill_psf_images(lights, boxes, starts, sums, vignetting_apertures, shares, frame, psf_images):
    """Write the fractions of each light's energy, (pixels, 1), behind a perfect lens.

    Args:
        lights: (N, 8).
        boxes: From :func:`place_psf_images`.
        starts: First pixel of each PSF image in ``psf_images``, (N,).
        sums: Running sums in front of and behind focus, or one for both, (1 or 2, cells + 1, cells + 1).
        vignetting_apertures: (R, 2).
        shares: From :func:`vignetting_shares`.
        frame: Column, row and scale of a :class:`Frame`.
        psf_images: Output.
    """
    last = sums.shape[1] - 1
    for i in prange(lights.shape[0]):
        light_x, light_y, depth = lights[i, 0], lights[i, 1], lights[i, 2]
        half_x, half_y = 0.5 * lights[i, 6], 0.5 * lights[i, 7]
        top, bottom, left, right = boxes[i]
        side = 0 if depth > 0 else 1
        table = sums[min(side, sums.shape[0] - 1)]
        per_pixel = 0.5 * last / depth
        half_cells = abs(half_x * per_pixel)
        area = lights[i, 6] * lights[i, 7]
        k = starts[i]
        for y in range(top, bottom):
            middle = (y - light_y) * per_pixel + 0.5 * last
            half = abs(half_y * per_pixel)
            upper, above = _split(middle - half, last)
            lower, below = _split(middle + half, last)
            for x in range(left, right):
                position = (x - light_x) * per_pixel + 0.5 * last
                fraction = _sum_at(table, lower, below, position + half_cells)
                fraction -= _sum_at(table, lower, below, position - half_cells)
                fraction -= _sum_at(table, upper, above, position + half_cells)
                fraction += _sum_at(table, upper, above, position - half_cells)
                fraction = max(fraction, 0.0) / area
                if fraction > 0.0 and vignetting_apertures.shape[0] > 0:
                    h_x, h_y = (x - frame[0]) * frame[2], (y - frame[1]) * frame[2]
                    u, v = (x - light_x) / depth, (y - light_y) / depth
                    fraction *= passing(vignetting_apertures, u, v, h_x, h_y, abs(depth)) / share_at(
                        shares, side, h_x, h_y
                    )
                psf_images[k, 0] = fraction
                k += 1


class PerfectPsf:
    """PSF images of lights behind a perfect lens."""

    planes = 1

    def __init__(self, aperture: Aperture, lights: np.ndarray, frame: Frame) -> None:
        """Prepare the data that all PSF images share.

        Args:
            aperture: Shape of the discs.
            lights: (N, 8), see :func:`bokehnet.classical.highlights.lights.separate_lights`.
            frame: Centre and scale of the picture.
        """
        self._lights, self._frame = lights, frame
        radius = np.abs(lights[:, 2])
        cells = cover_cells(float(radius.max()))
        sides = (1, -1) if aperture.spherical_profile or aperture.onion else (1,)
        self._sums = np.stack([profile_sums(aperture, side, cells) for side in sides])
        vignetting_apertures = ((aperture.cats_eye, 1.0),) if aperture.cats_eye > 0 else ()
        self._shares = (
            vignetting_shares(aperture, vignetting_apertures) if vignetting_apertures else np.ones((2, 2, 2))
        )
        self._vignetting_apertures = np.array(vignetting_apertures).reshape(-1, 2)
        self.margins = np.stack([radius, radius], axis=1)

    def fill(self, batch: np.ndarray, boxes: np.ndarray, starts: np.ndarray, psf_images: np.ndarray) -> None:
        """Write the PSF images of the lights with the indices ``batch``."""
        lights, frame = self._lights[batch], tuple(self._frame)
        _fill_psf_images(
            lights, boxes, starts, self._sums, self._vignetting_apertures, self._shares, frame, psf_images
        )
