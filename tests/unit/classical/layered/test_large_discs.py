"""Very large discs at half the size: the parts against plain loops, the picture against full size."""

import numpy as np
import pytest

import bokehnet.classical.rays_renderer as rays_renderer
from bokehnet.classical.layered.large_discs import LEAST, all_blurred, halved, lay_over
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.rays_renderer import rays
from bokehnet.pyramid import upsample2


def test_only_pixels_far_from_all_sharp_surfaces_are_blurred():
    """Oracle: every pixel against every other one."""
    rng = np.random.default_rng(0)
    defocus = rng.choice([-90.0, -30.0, 40.0], (90, 110, 2)).astype(np.float32)
    defocus[rng.integers(90, size=4), rng.integers(110, size=4), rng.integers(2, size=4)] = 5
    sharp = np.argwhere((np.abs(defocus) < LEAST).any(-1))
    y, x = np.mgrid[:90, :110]
    away = [np.maximum(abs(y - v), abs(x - u)) for v, u in sharp]
    np.testing.assert_array_equal(all_blurred(defocus), np.min(away, 0) > LEAST)
    assert all_blurred(np.full((4, 5, 1), -LEAST, np.float32)).all()


@pytest.mark.parametrize("size", [(6, 8), (1, 1), (3, 2)])
def test_laying_over_is_bilinear_doubling(size):
    coarse = np.random.default_rng(0).random((*size, 3), dtype=np.float32)
    wanted = np.random.default_rng(1).random((2 * size[0], 2 * size[1])) < 0.5
    result = np.zeros((*wanted.shape, 3), np.float32)
    lay_over(coarse, wanted, result)
    doubled = upsample2(coarse.transpose(2, 0, 1)).transpose(1, 2, 0)
    np.testing.assert_allclose(result, np.where(wanted[..., None], doubled, 0), atol=1e-6)


def test_halving_keeps_surfaces_apart_and_light_whole():
    rng = np.random.default_rng(0)
    image = rng.random((5, 7, 3), dtype=np.float32)
    defocus = np.tile(np.float32([30, 30, 30, -20, -20, -20, -20]), (5, 1))
    layers = Layers(
        colors=np.stack([image, np.zeros_like(image)], 2),
        defocus=np.stack([defocus, np.full_like(defocus, -20)], -1),
        coverage=np.ones((5, 7, 2), np.float32),
    )
    small, values, found = halved(image, defocus, layers)
    np.testing.assert_array_equal(values[0], [15, 15, -10, -10])
    np.testing.assert_array_equal(found.defocus[..., 0], values)
    np.testing.assert_allclose(small[0, 1], image[:2, 2:4].mean((0, 1)), atol=1e-6)
    np.testing.assert_allclose(small[2, 3], image[4, 6], atol=1e-6)
    np.testing.assert_allclose(found.colors[0, 1, 0], image[:2, 2].mean(0), atol=1e-6)  # of its surface alone
    np.testing.assert_allclose(found.colors[0, 2, 0], image[:2, 4:6].mean((0, 1)), atol=1e-6)
    assert (found.coverage == 1).all()


@pytest.mark.parametrize("cats_eye", [0.0, 0.5])
def test_the_picture_is_that_of_full_size(cats_eye, monkeypatch):
    """As near to it as another seed is, up to 1 dB; some pixels are in focus, most are not."""
    from bokehnet.optics.aperture import Aperture

    rng = np.random.default_rng(0)
    height, width = 200, 241
    image = np.kron(rng.random((height // 4, width // 4 + 1, 3)), np.ones((4, 4, 1)))[:, :width]
    y, x = np.mgrid[:height, :width]
    defocus = np.where(np.hypot(y - 90, x - 60) < 40, 100.0, np.where(x > 180, 0.0, -60.0))
    aperture = Aperture(cats_eye=cats_eye)
    found = rays(image, defocus, aperture=aperture)
    monkeypatch.setattr(rays_renderer, "LARGE", 1e9)
    whole, other = (rays(image, defocus, aperture=aperture, seed=seed) for seed in (0, 1))
    apart, noise = (float(np.sqrt(np.mean((picture - whole) ** 2))) for picture in (found, other))
    assert 0 < apart < 1.12 * noise
