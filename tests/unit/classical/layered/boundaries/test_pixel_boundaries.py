"""Boundaries inside pixels, against outlines whose filtered coverage is known everywhere."""

import math

import numpy as np
import pytest
from numba import njit
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.layered.boundaries.pixel_boundaries import coverage_at, with_slopes
from bokehnet.classical.simd.float8 import LANES, load8, store8

NEAR, FAR = 5.0, -3.0


@njit
def read(coverage, x, y):
    result = np.empty(LANES, np.float32)
    store8(result, 0, coverage_at(load8(coverage, 0), load8(x, 0), load8(y, 0)))
    return result


def covered(distance: np.ndarray) -> np.ndarray:
    """Share of a Gaussian pixel filter, as wide as Blackman-Harris over 1.5 pixels, on one side of a line."""
    return np.vectorize(lambda d: 0.5 * (1 + math.erf(d / (0.21 * math.sqrt(2)))))(distance)


def half_plane(angle: float, offset: float, size: int = 9):
    """Defocus and coverage (H, W, 2) of a near half plane, and its distance from each pixel's centre."""
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    distance = np.cos(angle) * x + np.sin(angle) * y + offset
    coverage = covered(distance).astype(np.float32)
    coverage[coverage < 1e-4] = 0
    coverage[coverage > 1 - 1e-4] = 1
    near = np.where(coverage > 0, NEAR, FAR)
    defocus = np.stack([near, np.full_like(near, FAR)], -1).astype(np.float32)
    layers = np.stack([np.where(coverage > 0, coverage, 1), np.ones_like(coverage)], -1).astype(np.float32)
    return defocus, layers, distance


@pytest.mark.parametrize("angle", [0.0, 0.4, 0.785, 1.3, 2.0, 3.0, 4.4, 5.9])
@pytest.mark.parametrize("offset", [-0.15, 0.0, 0.15])
def test_coverage_inside_a_pixel_is_that_of_the_outline(angle, offset):
    """The boundary, where half is covered, lies within a tenth of a pixel of the true line."""
    defocus, coverage, distance = half_plane(angle, offset)
    result = with_slopes(defocus, coverage)[..., 0]
    mixed = (coverage[..., 0] > 0.2) & (coverage[..., 0] < 0.8)
    assert mixed.any()
    for y, x in np.argwhere(mixed[1:-1, 1:-1]) + 1:
        along = np.linspace(-0.5, 0.5, LANES).astype(np.float32)
        right, down = along * np.float32(math.cos(angle)), along * np.float32(math.sin(angle))
        inside = read(np.full(LANES, result[y, x]), right, down)
        expected = distance[y, x] + along > 0
        clear = np.abs(distance[y, x] + along) > 0.1
        assert_array_equal((inside > 0.5)[clear], expected[clear])


def test_at_the_centre_it_is_the_coverage_itself():
    """To half a level, and read as a number it is so to a whole one."""
    rng = np.random.default_rng(0)
    coverage = rng.random((20, 20, 1)).astype(np.float32)
    packed = with_slopes(rng.normal(size=(20, 20, 1)).astype(np.float32), coverage)
    assert_allclose(packed, coverage, atol=1 / 1024)
    assert packed.max() < 1
    for i in range(0, 400, LANES):
        part = packed.reshape(-1)[i : i + LANES].copy()
        zero = np.zeros(LANES, np.float32)
        assert_allclose(read(part, zero, zero), coverage.reshape(-1)[i : i + LANES], atol=0.51 / 1024)


def test_whole_and_empty_stay_and_thin_things_have_no_side():
    coverage = np.zeros((5, 5, 1), np.float32)
    coverage[:, 0] = 1
    coverage[2, 3] = 0.5  # alone: as much on every side
    packed = with_slopes(np.zeros((5, 5, 1), np.float32), coverage)
    assert_array_equal(packed[coverage == 1], 1)
    assert_array_equal(packed[coverage == 0], 0)
    half = np.full(LANES, 0.3, np.float32)
    assert_allclose(read(np.full(LANES, packed[2, 3, 0]), half, half), 0.5, atol=1 / 1024)
