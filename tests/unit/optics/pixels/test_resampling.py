"""Pictures between their pixels: what cubic convolution promises, without its rings."""

import numpy as np
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.optics.pixels.resampling import inside, sample

RNG = np.random.default_rng(0)


def grid(height, width):
    return np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)


def test_in_the_middle_of_pixels_every_bit_is_kept():
    image = (100 * RNG.random((7, 9, 3)) ** 8).astype(np.float32)
    samples = sample(image, grid(7, 9))
    assert samples.dtype == np.float32
    assert_array_equal(samples, image)


def test_rising_parabolas_are_exact():
    """Authority: Keys 1981, the cubic with a = -1/2 reproduces polynomials of the second degree."""
    x, y = np.moveaxis(grid(20, 24), -1, 0)
    curve = lambda x, y: 3 + 0.2 * x + 0.05 * x * x + 0.1 * y + 0.02 * y * y  # noqa: E731
    places = RNG.uniform(2, 16, (100, 2))
    samples = sample(curve(x, y)[..., None], places)
    assert_allclose(samples[:, 0], curve(places[:, 0], places[:, 1]), rtol=1e-12)


def test_a_lamp_draws_no_ring():
    """Within the range of the four pixels around, so never below 0."""
    image = np.zeros((9, 9, 1))
    image[4, 4] = 1000
    samples = sample(image, grid(9, 9) + np.array([0.3, -0.4]))
    assert samples.min() == 0
    assert samples.max() <= 1000
    assert_array_equal(np.argwhere(samples[..., 0] > 0), [[4, 3], [4, 4], [5, 3], [5, 4]])


def test_the_border_is_repeated_with_a_notice():
    image = RNG.random((4, 5, 2))
    places = np.array([[-3.0, 1.0], [99.0, 1.0], [np.inf, -np.inf], [2.0, 3.0]])
    assert_array_equal(sample(image, places), [image[1, 0], image[1, 4], image[0, 4], image[3, 2]])
    fading = np.array([[0.0, 0.0], [-0.25, 1.0], [4.0, 3.75], [4.5, 3.5], [-1.0, 0.0], [np.inf, 0.0]])
    assert_allclose(inside(fading, 4, 5), [1, 0.75, 0.25, 0.25, 0, 0])


def test_a_batch_is_pictures_one_by_one():
    images = torch.from_numpy(RNG.random((2, 6, 7, 3)))
    places = torch.from_numpy(RNG.uniform(-1, 7, (4, 5, 2)))
    samples = sample(images, places)
    assert samples.shape == (2, 4, 5, 3)
    for one, image in zip(samples, images, strict=True):
        assert_allclose(one.numpy(), sample(image.numpy(), places.numpy()), atol=1e-14)


def test_gradients_of_light_and_places():
    """Oracle: finite differences, by gradcheck."""
    image = torch.from_numpy(RNG.random((4, 5, 2))).requires_grad_()
    places = torch.from_numpy(RNG.uniform(0, 3, (6, 2))).requires_grad_()
    assert torch.autograd.gradcheck(sample, (image, places))
