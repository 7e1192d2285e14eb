"""The disc of a light behind an aberrated lens: its rays, laid down by small pieces of the pupil.

A light at q with defocus d lights the pixels p with ``p = q + d A(a, h(p)) + E(a, h(p))``, where A and E are
the aberration map's. For one light and one wavelength that is a smooth map from the pupil to the picture. It
is solved at a few nodes of the pupil; the polynomial through them maps a lattice so fine that its cells are
smaller than pixels. Each cell lays its light down on the rectangle that it covers, so that folds of the map
come out as the bright rims they are, without dots. All of the light arrives, in each colour.

Source: Lee and Eisemann, "Practical real-time lens-flare rendering", Computer Graphics Forum 2013, for
lattices of rays whose cells carry light; polynomials per light and rectangles are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.classical.base import Frame
from bokehnet.classical.highlights.psf_images import passing, profile_sums, share_at, vignetting_shares
from bokehnet.classical.highlights.ray_polynomials import NODES, RayPolynomials, polynomials, solve_nodes
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture

__all__ = ["AberratedPsf"]

# Wavelengths are drawn in this number, and then gathered into groups of neighbours: so many that the rims of
# two groups are this far apart in pixels, but no fewer and no more than these.
_DRAWN, _APART, _FEWEST, _MOST = 125, 1.5, 4, 25

# Where a disc is measured rims are taken to be larger, by a quarter of this one's inverse: they move over it.
_SOFT = 4.0

# Widest cell in pixels, unless that makes more than so many cells for all lights together, and the numbers of
# cells across the pupil that there are.
_WIDEST, _MOST_CELLS = 0.5, 6e6
_CELL_COUNTS = np.round(16 * 2 ** (np.arange(29) / 4)).astype(int)


class AberratedPsf:
    """PSF images of lights behind an aberrated lens."""

    planes = 5

    def __init__(
        self, aperture: Aperture, lens_response: LensResponse, lights: np.ndarray, frame: Frame
    ) -> None:
        """Take what all PSF images share.

        Args:
            aperture: Shape of the discs.
            lens_response: Of the lens.
            lights: (N, 8), see :func:`bokehnet.classical.highlights.lights.separate_lights`.
            frame: Where the rows and columns lie in the picture.
        """
        self._lights = lights
        vignetting_apertures = lens_response.aberration_map.vignetting_apertures
        if aperture.cats_eye > 0:
            vignetting_apertures = (*vignetting_apertures, (aperture.cats_eye, 1.0))
        self._vignetting_apertures = np.array(vignetting_apertures, float).reshape(-1, 2)
        self._shares = (
            vignetting_shares(aperture, vignetting_apertures) if vignetting_apertures else np.ones((2, 2, 2))
        )
        drawn, colors = lens_response.sample_wavelengths(_DRAWN)
        ends = np.unique([drawn.min(), np.median(drawn), drawn.max()])
        measured = np.empty((len(lights), 4))
        paths = RayPolynomials.of(lens_response, ends, frame)
        with parallel_region:
            _measure(lights, paths, self._vignetting_apertures, measured)
        apart = math.ceil(measured[:, 3].max() / _APART)
        wavelengths, self._colors = _group(drawn, colors, min(max(apart, _FEWEST), _MOST))
        self._paths = RayPolynomials.of(lens_response, wavelengths, frame)
        self.margins = 1.03 * measured[:, :2] + 1.0
        across = 2 * measured[:, 2] / _WIDEST
        across /= max(1.0, math.sqrt((across**2).sum() * len(wavelengths) / _MOST_CELLS))
        wanted = np.searchsorted(_CELL_COUNTS, across)
        self._cells = _CELL_COUNTS[np.minimum(wanted, len(_CELL_COUNTS) - 1)]
        self._light, self._first = _cell_light(aperture, self._cells)

    def fill(self, batch: np.ndarray, boxes: np.ndarray, starts: np.ndarray, psf_images: np.ndarray) -> None:
        """Write the PSF images of the lights numbered ``batch``."""
        tables = self._light, self._first, self._vignetting_apertures, self._shares, self._colors
        _fill_psf_images(
            self._lights[batch], self._cells[batch], boxes, starts, self._paths, *tables, psf_images
        )


def _group(drawn: np.ndarray, colors: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gather wavelengths into at most ``count`` groups: their means, and their colours (groups, 3), sum 1."""
    wavelengths, which = np.unique(drawn, return_inverse=True)
    group = np.minimum(np.arange(len(wavelengths)) * count // len(wavelengths), count - 1)
    if len(wavelengths) <= count:
        group = np.arange(len(wavelengths))
    share = colors / colors.sum(axis=0)
    weights = np.bincount(group[which.reshape(-1)], share.sum(axis=1))
    means = np.bincount(group[which.reshape(-1)], share.sum(axis=1) * drawn) / weights
    grouped = np.stack([np.bincount(group[which.reshape(-1)], column) for column in share.T], axis=1)
    return means, grouped


def _cell_light(aperture: Aperture, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Light of each cell for the numbers in use, flat, and where each number's begins, (2, largest + 1)."""
    numbers = np.unique(cells)
    first = np.zeros((2, numbers[-1] + 1), np.int64)
    fine = 2 ** math.ceil(math.log2(max(128, numbers[-1])))
    parts, count = [], 0
    for side in (1, -1):
        sums = profile_sums(aperture, side, fine)
        for number in numbers:
            place = np.arange(number + 1) * (fine / number)
            low = np.minimum(place.astype(np.intp), fine - 1)
            inside = place - low
            rows = sums[low] * (1 - inside)[:, None] + sums[low + 1] * inside[:, None]
            both = rows[:, low] * (1 - inside) + rows[:, low + 1] * inside
            parts.append(np.maximum(np.diff(np.diff(both, axis=0), axis=1), 0).astype(np.float32).ravel())
            first[0 if side > 0 else 1, number] = count
            count += number * number
    return np.concatenate(parts), first


@njit(cache=True, parallel=True)
def _measure(lights, paths, vignetting_apertures, measured):  # type: ignore[no-untyped-def]
    """Write how far each light's rays go, right and down, their steepest slope, and how far colours part.

    All in pixels, (N, 4), for rays that pass the vignetting apertures; slopes are per unit of the pupil.
    """
    count = paths.coefficients.shape[0]
    for i in prange(lights.shape[0]):
        nodes, terms = np.empty((4, NODES, NODES)), np.empty((count, 4, NODES, NODES))
        line = np.empty((count, 4, NODES))
        for k in range(count):
            solve_nodes(paths, k, lights[i, 0], lights[i, 1], lights[i, 2], nodes)
            polynomials(paths, nodes, terms[k])
        measured[i] = 0.0
        for j in range(33):
            v = j / 16.0 - 1.0
            for k in range(count):
                _collapse(terms[k], v, line[k])
            half = math.sqrt(max(1.0 - v * v, 0.0))
            for n in range(17):
                u = half * (n / 8.0 - 1.0)
                for axis in range(2):
                    low, high = 1e30, -1e30
                    for k in range(count):
                        place, slope = line[k, axis, NODES - 1], 0.0
                        for m in range(NODES - 2, -1, -1):
                            slope = slope * u + place
                            place = place * u + line[k, axis, m]
                        if k == 0 and vignetting_apertures.shape[0] > 0:
                            x, y = lights[i, 0], lights[i, 1]
                            h_x, h_y = (
                                (x - paths.frame[0]) * paths.frame[2],
                                (y - paths.frame[1]) * paths.frame[2],
                            )
                            if passing(vignetting_apertures, u, v, h_x, h_y, _SOFT) <= 0.0:
                                break
                        low, high = min(low, place), max(high, place)
                        slope = max(abs(slope), abs(_slope_down(terms[k, axis], u, v)))
                        measured[i, 2] = max(measured[i, 2], slope)
                    if high >= low:
                        measured[i, axis] = max(measured[i, axis], abs(low), abs(high))
                        measured[i, 3] = max(measured[i, 3], high - low)


@njit(cache=True)
def _slope_down(terms, u, v):  # type: ignore[no-untyped-def]
    """Derivative by v of a polynomial in both coordinates."""
    total = 0.0
    for row in range(NODES - 1, 0, -1):
        value = 0.0
        for column in range(NODES - 1, -1, -1):
            value = value * u + terms[row, column]
        total = total * v + row * value
    return total


@njit(cache=True)
def _collapse(terms, v, line):  # type: ignore[no-untyped-def]
    """Write the polynomials in u that are left in a row of the pupil, (4, NODES)."""
    for which in range(4):
        for column in range(NODES):
            value = 0.0
            for row in range(NODES - 1, -1, -1):
                value = value * v + terms[which, row, column]
            line[which, column] = value


@njit(cache=True)
def _places(line, first, begin, step, places):  # type: ignore[no-untyped-def]
    """Write two of the polynomials of a row at ``begin + step * i``, (2, n)."""
    for axis in range(2):
        c = line[first + axis]
        for i in range(places.shape[1]):
            u = begin + step * i
            value = c[NODES - 1]
            for m in range(NODES - 2, -1, -1):
                value = value * u + c[m]
            places[axis, i] = value


@njit(cache=True)
def _lay_down(plane, x, y, wide, high, light, miss_x, miss_y):  # type: ignore[no-untyped-def]
    """Scatter light evenly over a rectangle around (x, y); pixel i lies between i and i + 1."""
    low_x, high_x, low_y, high_y = x - 0.5 * wide, x + 0.5 * wide, y - 0.5 * high, y + 0.5 * high
    scale = light / (wide * high)
    for row in range(max(int(math.floor(low_y)), 0), min(int(math.ceil(high_y)), plane.shape[0])):
        down = (min(high_y, row + 1.0) - max(low_y, float(row))) * scale
        for column in range(max(int(math.floor(low_x)), 0), min(int(math.ceil(high_x)), plane.shape[1])):
            share = (min(high_x, column + 1.0) - max(low_x, float(column))) * down
            plane[row, column, 0] += share
            plane[row, column, 1] += share * miss_x
            plane[row, column, 2] += share * miss_y


@njit(cache=True)
def _lay_pupil(terms, light, cells, origin, place, paths, vignetting_apertures, plane):  # type: ignore[no-untyped-def]
    """Lay the light of all cells of the pupil down for one wavelength.

    Args:
        terms: Polynomials (4, NODES, NODES): place beside the light, right and down, and the transverse
            aberration.
        light: Of each cell, (cells * cells,).
        cells: Cells across.
        origin: First column and row of the plane.
        place: Column and row of the light.
        paths: For the field position.
        vignetting_apertures: (R, 2).
        plane: (rows, columns, 3): light, and light times the transverse aberration.
    """
    step = 2.0 / cells
    line, middle = np.empty((4, NODES)), np.empty((4, NODES))
    upper, lower = np.empty((2, cells + 1)), np.empty((2, cells + 1))
    transverse_aberrations = np.empty((2, cells))
    _collapse(terms, -1.0, line)
    _places(line, 0, -1.0, step, upper)
    for j in range(cells):
        v = (j + 0.5) * step - 1.0
        _collapse(terms, v + 0.5 * step, line)
        _places(line, 0, -1.0, step, lower)
        _collapse(terms, v, middle)
        _places(middle, 2, 0.5 * step - 1.0, step, transverse_aberrations)
        for i in range(cells):
            amount = light[j * cells + i]
            if amount <= 0.0:
                continue
            x = 0.25 * (upper[0, i] + upper[0, i + 1] + lower[0, i] + lower[0, i + 1]) + place[0]
            y = 0.25 * (upper[1, i] + upper[1, i + 1] + lower[1, i] + lower[1, i + 1]) + place[1]
            if vignetting_apertures.shape[0] > 0:
                h_x, h_y = (x - paths.frame[0]) * paths.frame[2], (y - paths.frame[1]) * paths.frame[2]
                amount *= passing(vignetting_apertures, (i + 0.5) * step - 1.0, v, h_x, h_y, 0.5 * cells)
            wide, high = 1e-3, 1e-3
            wide = max(wide, 0.5 * abs(upper[0, i + 1] - upper[0, i] + lower[0, i + 1] - lower[0, i]))
            wide = max(wide, 0.5 * abs(lower[0, i] - upper[0, i] + lower[0, i + 1] - upper[0, i + 1]))
            high = max(high, 0.5 * abs(upper[1, i + 1] - upper[1, i] + lower[1, i + 1] - lower[1, i]))
            high = max(high, 0.5 * abs(lower[1, i] - upper[1, i] + lower[1, i + 1] - upper[1, i + 1]))
            x, y = x + 0.5 - origin[0], y + 0.5 - origin[1]
            _lay_down(
                plane, x, y, wide, high, amount, transverse_aberrations[0, i], transverse_aberrations[1, i]
            )
        upper, lower = lower, upper


@njit(cache=True)
def _average(line, width, sums):  # type: ignore[no-untyped-def]
    """Average a line of pixels over ``width`` pixels around each."""
    count = line.shape[0]
    sums[0] = 0.0
    for i in range(count):
        sums[i + 1] = sums[i] + line[i]
    for i in range(count):
        total = 0.0
        for sign in (-1.0, 1.0):
            place = min(max(i + 0.5 + sign * 0.5 * width, 0.0), float(count))
            cell = min(int(place), count - 1)
            total += sign * (sums[cell] + (place - cell) * (sums[cell + 1] - sums[cell]))
        line[i] = total / width


@njit(cache=True, parallel=True)
def _fill_psf_images(  # type: ignore[no-untyped-def]
    lights, cells, boxes, starts, paths, light, first, vignetting_apertures, shares, colors, psf_images
):
    """Write red, green, blue and the transverse aberration of each PSF image, (pixels, 5)."""
    count = paths.coefficients.shape[0]
    for i in prange(lights.shape[0]):
        top, bottom, left, right = boxes[i]
        if top >= bottom or left >= right:
            continue
        light_x, light_y, depth = lights[i, 0], lights[i, 1], lights[i, 2]
        side = 0 if depth > 0 else 1
        begin = first[side, cells[i]]
        own = light[begin : begin + cells[i] * cells[i]]
        pad_x, pad_y = int(math.ceil(0.5 * lights[i, 6])), int(math.ceil(0.5 * lights[i, 7]))
        height, width = bottom - top + 2 * pad_y, right - left + 2 * pad_x
        planes, plane = np.zeros((height, width, 6)), np.empty((height, width, 3))
        nodes, terms = np.empty((4, NODES, NODES)), np.empty((4, NODES, NODES))
        origin, place = (left - pad_x, top - pad_y), (light_x, light_y)
        for k in range(count):
            plane[:] = 0.0
            solve_nodes(paths, k, light_x, light_y, depth, nodes)
            polynomials(paths, nodes, terms)
            _lay_pupil(terms, own, cells[i], origin, place, paths, vignetting_apertures, plane)
            for c in range(3):
                planes[:, :, c] += colors[k, c] * plane[:, :, 0]
                planes[:, :, 3 + c] += plane[:, :, c]
        sums = np.empty(max(height, width) + 1)
        for c in range(6):
            if lights[i, 6] > 1.0:
                for y in range(height):
                    _average(planes[y, :, c], lights[i, 6], sums)
            if lights[i, 7] > 1.0:
                for x in range(width):
                    _average(planes[:, x, c], lights[i, 7], sums)
        k = starts[i]
        for y in range(top, bottom):
            for x in range(left, right):
                found = planes[y - origin[1], x - origin[0]]
                passed = 1.0
                if vignetting_apertures.shape[0] > 0:
                    h_x, h_y = (x - paths.frame[0]) * paths.frame[2], (y - paths.frame[1]) * paths.frame[2]
                    passed = share_at(shares, side, h_x, h_y)
                for c in range(3):
                    psf_images[k, c] = found[c] / passed
                if found[3] > 0.0:
                    psf_images[k, 3], psf_images[k, 4] = found[4] / found[3], found[5] / found[3]
                k += 1
