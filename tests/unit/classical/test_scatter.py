"""The fast scatter against the slow oracle and against what must hold for any scatter."""

import math

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.base import make_classical
from bokehnet.classical.kernels import scatter_forward
from bokehnet.classical.reference import disc_coverage, disc_weights, scatter_reference
from bokehnet.classical.scatter import scatter
from bokehnet.errors import ParameterError, ShapeError


def point_image(size: int, value: float = 1.0) -> np.ndarray:
    image = np.zeros((size, size, 3))
    image[size // 2, size // 2] = value
    return image


@pytest.mark.parametrize("shape", [(17, 23), (40, 9), (1, 12), (12, 1), (1, 1), (70, 33)])
def test_scatter_equals_the_slow_oracle(shape):
    rng = np.random.default_rng(0)
    image = rng.random((*shape, 3))
    defocus = rng.uniform(-7, 7, shape)
    assert_allclose(scatter(image, defocus), scatter_reference(image, defocus), atol=2e-6)


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.5, 0.7, 1.0, 2.5, 8.3, 40.0, 90.4])
def test_weights_of_one_point_sum_to_one(radius):
    size = 2 * math.ceil(radius) + 5
    _, weight = scatter_forward(np.zeros((size, size, 3)), np.full((size, size), 0.0))
    assert_allclose(weight, 1)
    total, _ = scatter_forward(point_image(size), np.full((size, size), radius))
    assert_allclose(total.sum(axis=(0, 1)), 1, atol=1e-9)


@pytest.mark.parametrize("radius", [2.0, 5.5, 17.3, 40.0])
def test_point_becomes_a_disc_of_the_given_radius(radius):
    """A uniform disc of radius r has a mean squared distance of r^2 / 2 to its centre; a pixel adds 1/6."""
    size = 4 * math.ceil(radius) + 5
    disc = scatter(point_image(size), np.full((size, size), radius))[..., 0]
    y, x = np.mgrid[:size, :size] - size // 2
    measured = math.sqrt(2 * ((disc * (x**2 + y**2)).sum() / disc.sum() - 1 / 6))
    assert measured == pytest.approx(radius, abs=0.05)
    assert disc.sum() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(("radius", "tolerance"), [(1.3, 0.18), (2.6, 0.06), (5.5, 0.03), (20.4, 0.011)])
def test_row_weights_approach_the_exact_area_of_the_disc(radius, tolerance):
    """Authority: area by counting sub-pixels. The row model moves light only along the ends of a row."""
    reach = math.ceil(radius) + 1
    exact = disc_coverage(radius, reach) / (math.pi * radius**2)
    assert np.abs(disc_weights(radius, reach) - exact).sum() < tolerance


def test_no_defocus_is_the_identity():
    image = np.random.default_rng(1).random((20, 30, 3)).astype(np.float32)
    assert_array_equal(scatter(image, np.zeros((20, 30), np.float32)), image)
    assert_allclose(scatter(image, np.full((20, 30), 0.5, np.float32)), image, rtol=1e-6)


def test_uniform_picture_stays_uniform_up_to_the_border():
    rng = np.random.default_rng(2)
    image = np.full((33, 41, 3), 0.7, np.float32)
    assert_allclose(scatter(image, rng.uniform(-20, 20, (33, 41)).astype(np.float32)), 0.7, rtol=1e-5)


def test_mirrored_input_gives_mirrored_output():
    rng = np.random.default_rng(3)
    image, defocus = rng.random((21, 34, 3)), rng.uniform(-5, 5, (21, 34))
    assert_allclose(scatter(image[::-1, ::-1], defocus[::-1, ::-1])[::-1, ::-1], scatter(image, defocus))


def test_sign_of_the_defocus_does_not_matter_to_the_scatter():
    rng = np.random.default_rng(4)
    image, defocus = rng.random((21, 34, 3)), rng.uniform(-5, 5, (21, 34))
    assert_array_equal(scatter(image, -defocus), scatter(image, defocus))


def test_any_number_of_threads_gives_the_same_bits():
    rng = np.random.default_rng(5)
    image = rng.random((150, 80, 3), dtype=np.float32)
    defocus = rng.uniform(-12, 12, (150, 80)).astype(np.float32)
    results = []
    before = numba.get_num_threads()
    for threads in {1, before}:
        numba.set_num_threads(threads)
        results.append(scatter(image, defocus))
    numba.set_num_threads(before)
    for result in results:
        assert_array_equal(result, results[0])


def test_strong_highlight_leaves_no_streak_beside_its_disc():
    """Sums are kept in float64: beyond a disc 10,000 times brighter, black stays black."""
    image = point_image(101, 1e4).astype(np.float32)
    total, _ = scatter_forward(image, np.full((101, 101), 20.0, np.float32))
    y, x = np.mgrid[:101, :101] - 50
    assert np.abs(total[np.hypot(x, y) > 22]).max() < 1e-9


@pytest.mark.parametrize("radius", [1e3, 1e6, 1e12, 1e38])
def test_radius_larger_than_the_picture_tends_to_the_mean(radius):
    image = np.random.default_rng(6).random((6, 8, 3), dtype=np.float32)
    mean = np.broadcast_to(image.mean(axis=(0, 1), keepdims=True), image.shape)
    assert_allclose(scatter(image, np.full((6, 8), radius, np.float32)), mean, atol=1e-4)


def test_bad_input_is_rejected_at_the_door():
    image, defocus = np.zeros((4, 5, 3)), np.zeros((4, 5))
    with pytest.raises(ShapeError, match=r"image is 5x4 pixels but defocus is 4x5"):
        scatter(image, defocus.T)
    with pytest.raises(ShapeError, match="3 channels"):
        scatter(np.zeros((4, 5, 1)), defocus)
    with pytest.raises(ParameterError, match="found 1 that are NaN"):
        scatter(image, np.where(np.arange(20).reshape(4, 5) == 7, np.nan, 0.0))
    with pytest.raises(ParameterError, match="classical renderer: expected one of scatter"):
        make_classical("magic")
