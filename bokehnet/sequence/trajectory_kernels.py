"""Kernels of the temporal filter: trajectories through neighbouring frames, and polynomials along them."""

import math

import numpy as np
from numba import prange

from bokehnet.kernels import njit

__all__ = ["COMPONENTS", "fit_trajectories"]

# Results per pixel of fit_trajectories: squared fourth differences and their weight, the mean, then the value
# at the frame and the energy of each further component: three degrees, three narrower windows.
COMPONENTS = 15

# Weight of a frame below which its trajectory ends.
_MIN_WEIGHT = 1e-3

# Sum of the squared coefficients of a fourth difference (1, -4, 6, -4, 1).
_FOURTH_DIFFERENCE_GAIN = 70.0

# Squared norm of a polynomial, relative to that of the lower degree, below which the frames do not determine
# it. Time counts in reaches: two successive frames have 4e-4.
_MIN_SPREAD = 1e-6

# Halvings of the reach for the narrower windows of the residual.
_HALVINGS = 3


@njit(cache=True, inline="always")
def _sample(values, y, x, max_step):  # type: ignore[no-untyped-def]
    """Return a value by bilinear interpolation; the nearest one where its neighbours are an edge apart."""
    height, width = values.shape
    top, left = int(y), int(x)
    below, right = min(top + 1, height - 1), min(left + 1, width - 1)
    v, u = y - top, x - left
    a, b = np.float64(values[top, left]), np.float64(values[top, right])
    c, d = np.float64(values[below, left]), np.float64(values[below, right])
    if max(max(a, b), max(c, d)) - min(min(a, b), min(c, d)) > max_step:
        row = top if v < 0.5 else below
        return np.float64(values[row, left if u < 0.5 else right])
    upper, lower = a + u * (b - a), c + u * (d - c)
    return upper + v * (lower - upper)


@njit(cache=True, inline="always")
def _motion(flow, axis, y, x, scale):  # type: ignore[no-untyped-def]
    """Return one component of a flow that is stored at 1/scale of the picture's size; bilinear."""
    height, width = flow.shape[0], flow.shape[1]
    row = min(max((y + 0.5) / scale - 0.5, 0.0), height - 1.0)
    column = min(max((x + 0.5) / scale - 0.5, 0.0), width - 1.0)
    top, left = int(row), int(column)
    below, right = min(top + 1, height - 1), min(left + 1, width - 1)
    v, u = row - top, column - left
    upper = flow[top, left, axis] + u * (flow[top, right, axis] - flow[top, left, axis])
    lower = flow[below, left, axis] + u * (flow[below, right, axis] - flow[below, left, axis])
    return scale * (upper + v * (lower - upper))


@njit(cache=True)
def _follow(  # type: ignore[no-untyped-def]
    values, similarity, flow, slots, center, row, column, scale, max_step, differences, weights
):
    """Fill the differences to the pixel's value, and their weights, along its trajectory."""
    height, width = values.shape[1], values.shape[2]
    own = np.float64(values[slots[center], row, column])
    weights[:] = 0.0
    differences[:] = 0.0
    weights[center] = 1.0
    for direction in range(2):
        step = 1 - 2 * direction
        y, x, weight, index = float(row), float(column), 1.0, center
        while 0 <= index + step < len(slots):
            slot = slots[index]
            weight *= similarity[direction, slot, int(y + 0.5), int(x + 0.5)] / 255.0
            if weight < _MIN_WEIGHT:
                break
            down = _motion(flow[direction, slot], 1, y, x, scale)
            right = _motion(flow[direction, slot], 0, y, x, scale)
            y, x = y + down, x + right
            if not (-0.5 <= y <= height - 0.5 and -0.5 <= x <= width - 0.5):
                break
            y, x = min(max(y, 0.0), height - 1.0), min(max(x, 0.0), width - 1.0)
            index += step
            differences[index] = _sample(values[slots[index]], y, x, max_step) - own
            weights[index] = weight


@njit(cache=True)
def _noise(differences, weights, times):  # type: ignore[no-untyped-def]
    """Return the weighted sum of squared fourth differences, as variances of one value, and the weight."""
    total, weight_sum = 0.0, 0.0
    for k in range(len(times) - 4):
        weight, gap, even = weights[k], times[k + 1] - times[k], True
        for i in range(k, k + 4):
            weight = min(weight, weights[i + 1])
            even = even and times[i + 1] - times[i] == gap
        if weight > 0 and even:
            change = differences[k] - 4 * differences[k + 1] + 6 * differences[k + 2]
            change += differences[k + 4] - 4 * differences[k + 3]
            total += weight * change * change / _FOURTH_DIFFERENCE_GAIN
            weight_sum += weight
    return total, weight_sum


@njit(cache=True)
def _fit(differences, weights, times, reach, fitted, polynomials, energies):  # type: ignore[no-untyped-def]
    """Fit a cubic to a window, subtract it from the differences, and fill values and energies by degree.

    Orthogonal polynomials follow from each other by Forsythe's recurrence, p' = (t - a) p - b p before.
    """
    fitted[:] = 0.0
    energies[:] = 0.0
    before_norm, b = 1.0, 0.0
    polynomials[0, :] = 0.0
    polynomials[1, :] = 1.0
    center = 0
    for k in range(len(times)):
        if times[k] == 0:
            center = k
    for degree in range(len(fitted)):
        norm = moment = product = 0.0
        for k in range(len(times)):
            if weights[k] > 0 and abs(times[k]) <= reach:
                t = times[k] / (reach + 1.0)
                weighted = weights[k] * (1.0 - t * t) * polynomials[1, k]
                norm += weighted * polynomials[1, k]
                moment += weighted * polynomials[1, k] * t
                product += weighted * differences[k]
        if norm <= _MIN_SPREAD * before_norm:
            break
        coefficient, a = product / norm, moment / norm
        b = norm / before_norm if degree else 0.0
        fitted[degree] = coefficient * polynomials[1, center]
        energies[degree] = coefficient * product
        before_norm = norm
        for k in range(len(times)):
            differences[k] -= coefficient * polynomials[1, k]
            t = times[k] / (reach + 1.0)
            following = (t - a) * polynomials[1, k] - b * polynomials[0, k]
            polynomials[0, k], polynomials[1, k] = polynomials[1, k], following


@njit(cache=True, parallel=True)
def fit_trajectories(  # type: ignore[no-untyped-def]
    values, similarity, flow, slots, times, center, scale, reach, max_step, result
):
    """Fit polynomials to the values along the trajectory of each pixel of one frame.

    Args:
        values: Maps of the stored frames, (S, H, W), float32.
        similarity: Similarity to the next and to the previous frame, (2, S, H, W), uint8, 255 for equal.
        flow: Motion to the next and to the previous frame, (2, S, h, w, 2), stored pixels right and down.
        slots: Index of the stored frame for each frame of the window, in time order, (N,).
        times: Frame numbers relative to the frame, (N,), float64.
        center: Index of the frame in the window.
        scale: Pixels of the picture per stored pixel of flow.
        reach: Largest distance in time, frames.
        max_step: Difference of neighbouring values from which they are not interpolated.
        result: Receives the components, (COMPONENTS, H, W), float32.
    """
    height, width = values.shape[1], values.shape[2]
    for row in prange(height):
        differences, weights = np.empty(len(slots)), np.empty(len(slots))
        polynomials, fitted, energies = np.empty((2, len(slots))), np.empty(4), np.empty(4)
        for column in range(width):
            _follow(
                values, similarity, flow, slots, center, row, column, scale, max_step, differences, weights
            )
            total, weight = _noise(differences, weights, times)
            _fit(differences, weights, times, reach, fitted, polynomials, energies)
            result[0, row, column], result[1, row, column], result[2, row, column] = total, weight, fitted[0]
            for degree in range(1, 4):
                result[1 + 2 * degree, row, column] = fitted[degree]
                result[2 + 2 * degree, row, column] = energies[degree]
            for halving in range(_HALVINGS):
                narrow = math.floor(reach / 2 ** (halving + 1))
                _fit(differences, weights, times, narrow, fitted, polynomials, energies)
                result[9 + 2 * halving, row, column] = fitted.sum()
                result[10 + 2 * halving, row, column] = energies.sum()
