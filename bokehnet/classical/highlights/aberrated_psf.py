"""Point spread function of a light behind an aberrated lens, from rays through small cells of the pupil.

A light at q with defocus d lights the pixels p with ``p = q + d A(a, h(p)) + E(a, h(p))``, where A and E are
those of the aberration map. For one light and one wavelength that is a smooth map from the pupil to the
picture. It is solved at a few nodes of the pupil; the polynomial through them maps a lattice so fine that its
cells are smaller than pixels. Each cell distributes its light over the rectangle that it covers, so that
folds of the map become bright rims, without dots. All of the light arrives, in each color.

Source: Lee and Eisemann, "Practical real-time lens-flare rendering", Computer Graphics Forum 2013, for
lattices of rays whose cells carry light; polynomials per light and rectangles are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Frame
from bokehnet.classical.highlights.psf_images import passing, profile_sums, share_at, vignetting_shares
from bokehnet.classical.highlights.ray_polynomials import NODES, RayPolynomials, polynomials, solve_nodes
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture

__all__ = ["AberratedPsf"]

# Number of sampled wavelengths, which are then grouped; distance of the rims of two groups, pixels; minimum
# and maximum number of groups.
_SAMPLED_WAVELENGTHS, _GROUP_DISTANCE_PX, _MIN_GROUPS, _MAX_GROUPS = 125, 1.5, 4, 25

# Sharpness of the rims where a disc is measured: soft, since they move over the disc.
_RIM_SHARPNESS = 4.0

# Largest cell, pixels; maximum number of cells for all lights together, which takes precedence; available
# numbers of cells across the pupil.
_MAX_CELL_PX, _MAX_CELLS = 0.5, 6e6
_CELL_COUNTS = np.round(16 * 2 ** (np.arange(29) / 4)).astype(int)


class AberratedPsf:
    """PSF images of lights behind an aberrated lens."""

    planes = 5

    def __init__(
        self, aperture: Aperture, lens_response: LensResponse, lights: np.ndarray, frame: Frame
    ) -> None:
        """Prepare the data that all PSF images share.

        Args:
            aperture: Shape of the discs.
            lens_response: Response of the lens.
            lights: (N, 8), see :func:`bokehnet.classical.highlights.lights.separate_lights`.
            frame: Centre and scale of the picture.
        """
        self._lights = lights
        vignetting_apertures = lens_response.aberration_map.vignetting_apertures
        if aperture.cats_eye > 0:
            vignetting_apertures = (*vignetting_apertures, (aperture.cats_eye, 1.0))
        self._vignetting_apertures = np.array(vignetting_apertures, float).reshape(-1, 2)
        self._shares = (
            vignetting_shares(aperture, vignetting_apertures) if vignetting_apertures else np.ones((2, 2, 2))
        )
        sampled, colors = lens_response.sample_wavelengths(_SAMPLED_WAVELENGTHS)
        extreme_wavelengths = np.unique([sampled.min(), np.median(sampled), sampled.max()])
        measured = np.empty((len(lights), 4))
        paths = RayPolynomials.of(lens_response, extreme_wavelengths, frame)
        with parallel_region:
            _measure(lights, paths, self._vignetting_apertures, measured)
        groups = math.ceil(measured[:, 3].max() / _GROUP_DISTANCE_PX)
        wavelengths, self._colors = _group(sampled, colors, min(max(groups, _MIN_GROUPS), _MAX_GROUPS))
        self._paths = RayPolynomials.of(lens_response, wavelengths, frame)
        self.margins = 1.03 * measured[:, :2] + 1.0
        across = 2 * measured[:, 2] / _MAX_CELL_PX
        across /= max(1.0, math.sqrt((across**2).sum() * len(wavelengths) / _MAX_CELLS))
        size_index = np.searchsorted(_CELL_COUNTS, across)
        self._cells = _CELL_COUNTS[np.minimum(size_index, len(_CELL_COUNTS) - 1)]
        self._light, self._first = _cell_light(aperture, self._cells)

    def fill(self, batch: np.ndarray, boxes: np.ndarray, starts: np.ndarray, psf_images: np.ndarray) -> None:
        """Write the PSF images of the lights with the indices ``batch``."""
        tables = self._light, self._first, self._vignetting_apertures, self._shares, self._colors
        _fill_psf_images(
            self._lights[batch], self._cells[batch], boxes, starts, self._paths, *tables, psf_images
        )


def _group(sampled: np.ndarray, colors: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Group wavelengths into at most ``count`` groups: means, and colors (groups, 3) with the sum 1."""
    wavelengths, inverse = np.unique(sampled, return_inverse=True)
    group = np.minimum(np.arange(len(wavelengths)) * count // len(wavelengths), count - 1)
    if len(wavelengths) <= count:
        group = np.arange(len(wavelengths))
    fractions = colors / colors.sum(axis=0)
    weights = np.bincount(group[inverse.reshape(-1)], fractions.sum(axis=1))
    means = np.bincount(group[inverse.reshape(-1)], fractions.sum(axis=1) * sampled) / weights
    grouped = np.stack([np.bincount(group[inverse.reshape(-1)], column) for column in fractions.T], axis=1)
    return means, grouped


def _cell_light(aperture: Aperture, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the light of each cell for the counts in use, flat, and their offsets, (2, largest + 1)."""
    numbers = np.unique(cells)
    first = np.zeros((2, numbers[-1] + 1), np.int64)
    fine = 2 ** math.ceil(math.log2(max(128, numbers[-1])))
    parts, count = [], 0
    for side in (1, -1):
        sums = profile_sums(aperture, side, fine)
        for number in numbers:
            position = np.arange(number + 1) * (fine / number)
            low = np.minimum(position.astype(np.intp), fine - 1)
            inside = position - low
            rows = sums[low] * (1 - inside)[:, None] + sums[low + 1] * inside[:, None]
            both = rows[:, low] * (1 - inside) + rows[:, low + 1] * inside
            parts.append(np.maximum(np.diff(np.diff(both, axis=0), axis=1), 0).astype(np.float32).ravel())
            first[0 if side > 0 else 1, number] = count
            count += number * number
    return np.concatenate(parts), first


@njit(cache=True, parallel=True)
def _measure(lights, paths, vignetting_apertures, measured):
    """Write the reach of each light's rays, right and down, their steepest slope, and the color spread.

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
                            if passing(vignetting_apertures, u, v, h_x, h_y, _RIM_SHARPNESS) <= 0.0:
                                break
                        low, high = min(low, place), max(high, place)
                        slope = max(abs(slope), abs(_slope_down(terms[k, axis], u, v)))
                        measured[i, 2] = max(measured[i, 2], slope)
                    if high >= low:
                        measured[i, axis] = max(measured[i, axis], abs(low), abs(high))
                        measured[i, 3] = max(measured[i, 3], high - low)


@njit(cache=True)
def _slope_down(terms, u, v):
    """Return the derivative by v of a polynomial in both coordinates."""
    total = 0.0
    for row in range(NODES - 1, 0, -1):
        value = 0.0
        for column in range(NODES - 1, -1, -1):
            value = value * u + terms[row, column]
        total = total * v + row * value
    return total


@njit(cache=True)
def _collapse(terms, v, line):
    """Write the polynomials in u that remain for a row of the pupil, (4, NODES)."""
    for index in range(4):
        for column in range(NODES):
            value = 0.0
            for row in range(NODES - 1, -1, -1):
                value = value * v + terms[index, row, column]
            line[index, column] = value


@njit(cache=True)
def _evaluate_row(line, first, begin, step, places):
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
def _splat_rectangle(plane, x, y, box_width, box_height, light, aberration_x, aberration_y):
    """Distribute light evenly over a rectangle around (x, y); pixel i is between i and i + 1."""
    low_x, high_x, low_y, high_y = (
        x - 0.5 * box_width,
        x + 0.5 * box_width,
        y - 0.5 * box_height,
        y + 0.5 * box_height,
    )
    scale = light / (box_width * box_height)
    for row in range(max(int(math.floor(low_y)), 0), min(int(math.ceil(high_y)), plane.shape[0])):
        down = (min(high_y, row + 1.0) - max(low_y, float(row))) * scale
        for column in range(max(int(math.floor(low_x)), 0), min(int(math.ceil(high_x)), plane.shape[1])):
            amount = (min(high_x, column + 1.0) - max(low_x, float(column))) * down
            plane[row, column, 0] += amount
            plane[row, column, 1] += amount * aberration_x
            plane[row, column, 2] += amount * aberration_y


@njit(cache=True)
def _splat_pupil(terms, light, cells, origin, place, paths, vignetting_apertures, plane):
    """Splat the light of all cells of the pupil for one wavelength.

    Args:
        terms: Polynomials (4, NODES, NODES): offset from the light, right and down, and transverse
            aberration.
        light: Light of each cell, (cells * cells,).
        cells: Number of cells across.
        origin: First column and row of the plane.
        place: Column and row of the light.
        paths: Ray polynomials, for the field position.
        vignetting_apertures: (R, 2).
        plane: (rows, columns, 3): light, and light times the transverse aberration.
    """
    step = 2.0 / cells
    line, middle = np.empty((4, NODES)), np.empty((4, NODES))
    upper, lower = np.empty((2, cells + 1)), np.empty((2, cells + 1))
    transverse_aberrations = np.empty((2, cells))
    _collapse(terms, -1.0, line)
    _evaluate_row(line, 0, -1.0, step, upper)
    for j in range(cells):
        v = (j + 0.5) * step - 1.0
        _collapse(terms, v + 0.5 * step, line)
        _evaluate_row(line, 0, -1.0, step, lower)
        _collapse(terms, v, middle)
        _evaluate_row(middle, 2, 0.5 * step - 1.0, step, transverse_aberrations)
        for i in range(cells):
            amount = light[j * cells + i]
            if amount <= 0.0:
                continue
            x = 0.25 * (upper[0, i] + upper[0, i + 1] + lower[0, i] + lower[0, i + 1]) + place[0]
            y = 0.25 * (upper[1, i] + upper[1, i + 1] + lower[1, i] + lower[1, i + 1]) + place[1]
            if vignetting_apertures.shape[0] > 0:
                h_x, h_y = (x - paths.frame[0]) * paths.frame[2], (y - paths.frame[1]) * paths.frame[2]
                amount *= passing(vignetting_apertures, (i + 0.5) * step - 1.0, v, h_x, h_y, 0.5 * cells)
            box_width, box_height = 1e-3, 1e-3
            box_width = max(
                box_width, 0.5 * abs(upper[0, i + 1] - upper[0, i] + lower[0, i + 1] - lower[0, i])
            )
            box_width = max(
                box_width, 0.5 * abs(lower[0, i] - upper[0, i] + lower[0, i + 1] - upper[0, i + 1])
            )
            box_height = max(
                box_height, 0.5 * abs(upper[1, i + 1] - upper[1, i] + lower[1, i + 1] - lower[1, i])
            )
            box_height = max(
                box_height, 0.5 * abs(lower[1, i] - upper[1, i] + lower[1, i + 1] - upper[1, i + 1])
            )
            x, y = x + 0.5 - origin[0], y + 0.5 - origin[1]
            _splat_rectangle(
                plane,
                x,
                y,
                box_width,
                box_height,
                amount,
                transverse_aberrations[0, i],
                transverse_aberrations[1, i],
            )
        upper, lower = lower, upper


@njit(cache=True)
def _average(line, width, sums):
    """Average a line of pixels over ``width`` pixels around each."""
    count = line.shape[0]
    sums[0] = 0.0
    for i in range(count):
        sums[i + 1] = sums[i] + line[i]
    for i in range(count):
        total = 0.0
        for sign in (-1.0, 1.0):
            position = min(max(i + 0.5 + sign * 0.5 * width, 0.0), float(count))
            cell = min(int(position), count - 1)
            total += sign * (sums[cell] + (position - cell) * (sums[cell + 1] - sums[cell]))
        line[i] = total / width


@njit(cache=True, parallel=True)
def _fill_psf_images(
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
        cell_light = light[begin : begin + cells[i] * cells[i]]
        pad_x, pad_y = int(math.ceil(0.5 * lights[i, 6])), int(math.ceil(0.5 * lights[i, 7]))
        height, width = bottom - top + 2 * pad_y, right - left + 2 * pad_x
        planes, plane = np.zeros((height, width, 6)), np.empty((height, width, 3))
        nodes, terms = np.empty((4, NODES, NODES)), np.empty((4, NODES, NODES))
        origin, place = (left - pad_x, top - pad_y), (light_x, light_y)
        for k in range(count):
            plane[:] = 0.0
            solve_nodes(paths, k, light_x, light_y, depth, nodes)
            polynomials(paths, nodes, terms)
            _splat_pupil(terms, cell_light, cells[i], origin, place, paths, vignetting_apertures, plane)
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
                sums_at_pixel = planes[y - origin[1], x - origin[0]]
                transmitted = 1.0
                if vignetting_apertures.shape[0] > 0:
                    h_x, h_y = (x - paths.frame[0]) * paths.frame[2], (y - paths.frame[1]) * paths.frame[2]
                    transmitted = share_at(shares, side, h_x, h_y)
                for c in range(3):
                    psf_images[k, c] = sums_at_pixel[c] / transmitted
                if sums_at_pixel[3] > 0.0:
                    psf_images[k, 3], psf_images[k, 4] = (
                        sums_at_pixel[4] / sums_at_pixel[3],
                        sums_at_pixel[5] / sums_at_pixel[3],
                    )
                k += 1
