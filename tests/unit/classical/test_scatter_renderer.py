"""The fast scatter against the slow oracle and against what must hold for any scatter."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.base import make_classical
from bokehnet.classical.scatter.oracle import scatter_reference
from bokehnet.classical.scatter_renderer import scatter_inside as scatter
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aperture import Aperture


def point_image(size: int, value: float = 1.0) -> np.ndarray:
    image = np.zeros((size, size, 3))
    image[size // 2, size // 2] = value
    return image


@pytest.mark.parametrize("shape", [(17, 23), (40, 9), (1, 12), (12, 1), (1, 1), (70, 33)])
def test_scatter_equals_the_slow_oracle(shape):
    rng = np.random.default_rng(0)
    image = rng.random((*shape, 3))
    defocus = rng.uniform(-7, 7, shape)
    assert_allclose(scatter(image, defocus), scatter_reference(image, defocus), atol=5e-4)


@pytest.mark.parametrize("radius", [2.0, 5.5, 17.3, 40.0])
def test_point_becomes_a_disc_of_the_given_radius(radius):
    """A uniform disc of radius r has a mean squared distance of r^2 / 2 to its centre; a pixel adds 1/6."""
    size = 4 * math.ceil(radius) + 5
    disc = scatter(point_image(size), np.full((size, size), radius))[..., 0]
    y, x = np.mgrid[:size, :size] - size // 2
    measured = math.sqrt(2 * ((disc * (x**2 + y**2)).sum() / disc.sum() - 1 / 6))
    assert measured == pytest.approx(radius, abs=0.05)
    assert disc.sum() == pytest.approx(1, abs=1e-3)


def test_no_defocus_is_the_identity():
    image = np.random.default_rng(1).random((20, 30, 3)).astype(np.float32)
    assert_array_equal(scatter(image, np.zeros((20, 30), np.float32)), image)
    assert_array_equal(scatter(image, np.full((20, 30), 0.5, np.float32)), image)


@pytest.mark.parametrize("largest", [20.0, 120.0])
def test_uniform_picture_stays_uniform_up_to_the_border(largest):
    rng = np.random.default_rng(2)
    image = np.full((33, 41, 3), 0.7, np.float32)
    for defocus in (rng.uniform(-largest, largest, (33, 41)), np.full((33, 41), largest)):
        assert_allclose(scatter(image, defocus.astype(np.float32)), 0.7, rtol=1e-5)


def test_sign_of_the_defocus_does_not_matter_to_a_disc():
    rng = np.random.default_rng(4)
    image, defocus = rng.random((21, 34, 3)), rng.uniform(-5, 5, (21, 34))
    assert_array_equal(scatter(image, -defocus), scatter(image, defocus))


@pytest.mark.parametrize("radius", [10.0, 30.0, 90.0])
def test_highlight_leaves_no_streak_next_to_its_disc(radius):
    """A light 1000 times as bright as white, beside black: the picture is black behind its disc."""
    size = 2 * math.ceil(radius) + 41
    bokeh = scatter(point_image(size, 1e3).astype(np.float32), np.full((size, size), radius, np.float32))
    y, x = np.mgrid[:size, :size] - size // 2
    own = 1e3 / (math.pi * radius**2)
    assert bokeh[np.hypot(x, y) > radius + 1.5].max() <= 1e-6 * own
    assert bokeh.min() >= 0


@pytest.mark.parametrize("radius", [1e3, 1e6, 1e12, 1e38])
def test_radius_larger_than_the_picture_tends_to_the_mean(radius):
    image = np.random.default_rng(6).random((6, 8, 3), dtype=np.float32)
    mean = np.broadcast_to(image.mean(axis=(0, 1), keepdims=True), image.shape)
    assert_allclose(scatter(image, np.full((6, 8), radius, np.float32)), mean, atol=1e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2), (3, 5)])
def test_small_pictures_are_rendered_whatever_the_radius(shape):
    """Every colour of the result is a mean of colours of the picture."""
    image = np.random.default_rng(7).random((*shape, 3), dtype=np.float32)
    for radius in (0.0, 0.6, 3.0, 13.0, 200.0):
        bokeh = scatter(image, np.full(shape, radius, np.float32))
        assert bokeh.shape == image.shape
        assert bokeh.min() >= image.min() - 1e-6
        assert bokeh.max() <= image.max() + 1e-6


def test_a_plain_disc_as_aperture_changes_nothing():
    rng = np.random.default_rng(8)
    image, defocus = rng.random((21, 34, 3)), rng.uniform(-5, 5, (21, 34))
    assert_array_equal(scatter(image, defocus, Aperture()), scatter(image, defocus))


def test_where_no_light_arrives_the_picture_keeps_its_colour():
    """The single pixel lies in the hole of its own ring."""
    image = np.full((1, 1, 3), 0.4)
    assert_array_equal(scatter(image, np.full((1, 1), 9.0), Aperture(obstruction=0.8)), image)


def test_bad_input_is_rejected_at_the_door():
    image, defocus = np.zeros((4, 5, 3)), np.zeros((4, 5))
    with pytest.raises(ShapeError, match=r"image is 5x4 pixels but defocus is 4x5"):
        scatter(image, defocus.T)
    with pytest.raises(ShapeError, match="3 channels"):
        scatter(np.zeros((4, 5, 1)), defocus)
    with pytest.raises(ParameterError, match="got 1 that are NaN"):
        scatter(image, np.where(np.arange(20).reshape(4, 5) == 7, np.nan, 0.0))
    with pytest.raises(ParameterError, match="classical: expected one of"):
        make_classical("magic")
