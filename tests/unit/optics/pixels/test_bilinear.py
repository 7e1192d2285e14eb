"""Bilinear interpolation, against the planes that it reproduces and scipy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.optics.pixels.resampling import bilinear

ndimage = pytest.importorskip("scipy.ndimage", reason="needs scipy")


def test_agrees_with_scipy_up_to_the_border():
    """Authority: ``scipy.ndimage.map_coordinates`` of order 1."""
    rng = np.random.default_rng(0)
    values, places = rng.uniform(size=(2, 7, 11)), rng.uniform(size=(2, 50, 3))
    rows, columns = 6 * places[0], 10 * places[1]
    rows[0], columns[1] = 6, 10  # the last row and column
    expected = [ndimage.map_coordinates(one, (rows, columns), order=1) for one in values]
    assert_allclose(bilinear(values, rows, columns), expected, atol=1e-14)


def test_pixel_centres_keep_their_values():
    values = np.random.default_rng(1).uniform(size=(5, 4)).astype(np.float32)
    rows, columns = np.mgrid[0:5, 0:4].astype(np.float32)
    assert_array_equal(bilinear(values, rows, columns, np.float32), values)


def test_weights_of_float32_keep_float32():
    values, place = np.ones((3, 3), np.float32), np.array([0.5])
    assert bilinear(values, place, place, np.float32).dtype == np.float32
    assert bilinear(values, place, place).dtype == np.float64
