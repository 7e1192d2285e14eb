"""Soft steps made sharp."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from bokehnet.inference.disparity_edges import repair_soft_edges, soft_edge_fraction


def disc(size: int = 80) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    near = np.hypot(y - size / 2, x - size / 2) < 0.3 * size
    return np.where(near, 0.9, 0.1).astype(np.float32)


@pytest.mark.parametrize(("sigma", "softness"), [(1.0, 0.15), (2.0, 0.4), (3.0, 0.6)])
def test_a_blurred_step_comes_back_where_it_was(sigma, softness):
    """A symmetric blur leaves the middle of a straight step in place, and moves a curved one by little."""
    soft = gaussian_filter(disc(), sigma, mode="nearest")
    wrong = np.abs(repair_soft_edges(soft) - disc()) > 0.4
    assert wrong.sum() < 0.15 * (np.abs(soft - disc()) > 0.1).sum()
    assert soft_edge_fraction(soft) > softness
    assert soft_edge_fraction(repair_soft_edges(soft)) < 0.1


def test_sharp_steps_and_slopes_stay_as_they_are():
    assert_array_equal(repair_soft_edges(disc()), disc())
    slope = np.broadcast_to(np.linspace(0, 1, 200, dtype=np.float32), (50, 200))
    assert_array_equal(repair_soft_edges(slope), slope)
    assert soft_edge_fraction(disc()) == 0
    assert soft_edge_fraction(slope) == 0


def test_unit_and_offset_pass_through():
    soft = gaussian_filter(disc(), 2.0)
    assert_allclose(repair_soft_edges(30 * soft - 4), 30 * repair_soft_edges(soft) - 4, rtol=1e-4)
    assert soft_edge_fraction(30 * soft - 4) == pytest.approx(soft_edge_fraction(soft), abs=0.01)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 2)])
def test_any_size(shape):
    values = np.random.default_rng(0).random(shape, dtype=np.float32)
    assert repair_soft_edges(values).shape == shape
    assert 0 <= soft_edge_fraction(values) <= 1
