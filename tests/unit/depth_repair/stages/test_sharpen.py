"""Sharpening of soft edges. Authority: the map before blurring."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from bokehnet.depth_repair.stages.sharpen import (
    repair_soft_edges,
    slope_mask,
    soft_edge_fraction,
    soft_pixels,
)


def disc(size: int = 80) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    near = np.hypot(y - size / 2, x - size / 2) < 0.3 * size
    return np.where(near, 0.9, 0.1).astype(np.float32)


@pytest.mark.parametrize(("sigma", "softness"), [(1.0, 0.15), (2.0, 0.4), (3.0, 0.6)])
def test_a_blurred_edge_is_restored_in_place(sigma, softness):
    """A symmetric blur keeps the middle of a straight edge and hardly moves that of a curved one."""
    soft = gaussian_filter(disc(), sigma, mode="nearest")
    wrong = np.abs(repair_soft_edges(soft) - disc()) > 0.4
    assert wrong.sum() < 0.15 * (np.abs(soft - disc()) > 0.1).sum()
    assert soft_edge_fraction(soft) > softness
    assert soft_edge_fraction(repair_soft_edges(soft)) < 0.1


def test_sharp_edges_and_slopes_do_not_change():
    assert_array_equal(repair_soft_edges(disc()), disc())
    slope = np.broadcast_to(np.linspace(0, 1, 200, dtype=np.float32), (50, 200))
    assert_array_equal(repair_soft_edges(slope), slope)
    assert soft_edge_fraction(disc()) == 0
    assert soft_edge_fraction(slope) == 0


@pytest.mark.parametrize("length", [40, 60])
def test_an_edge_is_sharpened_and_an_equally_steep_slope_stays(length):
    """A wall towards the camera rises as much as an edge within a few pixels, but continues."""
    wall = np.broadcast_to(np.linspace(0, 1, length, dtype=np.float32), (60, length))
    y = np.arange(60)[:, None]
    truth = np.where(y < 30, wall, 0.0).astype(np.float32)
    soft = gaussian_filter(truth, 2.0, mode="nearest")
    sharp = repair_soft_edges(soft)
    assert_array_equal(sharp[:15, 8:-8], soft[:15, 8:-8])
    right = np.s_[20:40, length // 2 : -8]
    halfway = [(np.abs(x[right] / wall[right] - 0.5) < 0.25).sum() for x in (soft, sharp)]
    assert halfway[1] < 0.1 * halfway[0]


@pytest.mark.parametrize("axis", [0, 1])
def test_slopes_and_ramps_are_distinguished(axis):
    """Edges blurred by a Gaussian of 4 pixels or a ramp of 10 pixels are not slopes, along both axes."""
    x = np.arange(-40.0, 41.0)
    for profile, expected in (
        (0.02 * x, True),
        (0.02 * x + 0.001 * (-1) ** np.arange(81), True),
        (np.clip(x / 10, -0.5, 0.5), False),
        (gaussian_filter(np.sign(x), 4.0), False),
    ):
        values = np.moveaxis(np.broadcast_to(profile.astype(np.float32), (30, 81)), 1, axis)
        near_middle = np.moveaxis(np.broadcast_to(np.abs(x) < 4, (30, 81)), 1, axis)
        is_slope = slope_mask(values, near_middle)
        assert_array_equal(is_slope, near_middle & expected)


def test_sharpening_commutes_with_unit_and_offset():
    soft = gaussian_filter(disc(), 2.0)
    assert_allclose(repair_soft_edges(30 * soft - 4), 30 * repair_soft_edges(soft) - 4, rtol=1e-4)
    assert soft_edge_fraction(30 * soft - 4) == pytest.approx(soft_edge_fraction(soft), abs=0.01)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 2)])
def test_maps_of_any_size(shape):
    values = np.random.default_rng(0).random(shape, dtype=np.float32)
    assert repair_soft_edges(values).shape == shape
    assert 0 <= soft_edge_fraction(values) <= 1


def test_soft_pixels_are_those_between_both_sides():
    """Authority: a ramp of eight pixels; its pixels are between the extremes of their windows."""
    ramp = np.tile(np.clip((np.arange(60) - 26) / 8, 0, 1).astype(np.float32), (40, 1))
    soft = soft_pixels(ramp, 0.05)
    assert soft[:, 27:33].all()
    assert not soft[:, :24].any()
    assert not soft[:, 37:].any()
    assert not soft_pixels(disc(), 0.05).any()
    assert not soft_pixels(np.tile(np.linspace(0, 1, 32, dtype=np.float32), (24, 1)), 0.05).any()
