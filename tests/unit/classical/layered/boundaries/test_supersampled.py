"""Authority: scenes whose coverage is known by construction."""

import numpy as np
import pytest

from bokehnet.classical.layered.boundaries.supersampled import reduce_supersampled
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter
from bokehnet.optics.pixels.supersampling import downsample


def slanted(factor, height=12, width=16):
    """A textured front before a flat wall at ``factor`` times the size; also which samples are front."""
    y, x = np.mgrid[: factor * height, : factor * width] / factor
    front = x + 0.35 * y < 9
    image = np.where(front[..., None], (0.8, 0.2, 0.1), (0.1, 0.3, 0.9)).astype(np.float32)
    return image, factor * np.where(front, 9.0, -2.0).astype(np.float32), front


@pytest.mark.parametrize("factor", [2, 4])
def test_coverage_is_the_share_of_the_samples(factor):
    image, defocus, front = slanted(factor)
    small, values, known = reduce_supersampled(image, defocus, factor, None)
    share = front.reshape(12, factor, 16, factor).mean((1, 3))
    mixed = (share > 0) & (share < 1)
    np.testing.assert_array_equal(np.argwhere(mixed), np.stack([known.rows, known.columns], -1))
    np.testing.assert_allclose(known.coverage, share[mixed], atol=1e-6)
    np.testing.assert_allclose(values, np.where(share >= 0.5, 9.0, -2.0), atol=1e-6)
    np.testing.assert_allclose(small, image.reshape(12, factor, 16, factor, 3).mean((1, 3)), atol=1e-6)
    np.testing.assert_allclose(known.near, 9.0)
    np.testing.assert_allclose(known.far, -2.0)
    np.testing.assert_allclose(known.front, np.tile([0.8, 0.2, 0.1], (mixed.sum(), 1)), atol=1e-5)
    np.testing.assert_allclose(known.back, np.tile([0.1, 0.3, 0.9], (mixed.sum(), 1)), atol=1e-5)
    assert known.complete


def test_both_surfaces_add_up_to_the_pixel_and_are_pure_though_the_samples_are_filtered():
    image, defocus, front = slanted(4)
    shown, covered = image.copy(), front.astype(np.float32)
    for axis in (0, 1):  # as a renderer filters its fine pixels, too: a box of twice their width
        shown, covered = (
            0.25 * np.roll(v, 1, axis) + 0.5 * v + 0.25 * np.roll(v, -1, axis) for v in (shown, covered)
        )
    small, _, known = reduce_supersampled(shown, defocus, 4, PixelFilter("box", 2))
    share = known.coverage[:, None]
    added = share * known.front + (1 - share) * known.back
    np.testing.assert_allclose(added, small[known.rows, known.columns], atol=1e-5)
    inside = (known.rows > 1) & (known.rows < 10) & (known.columns > 1)
    minor = np.where(share > 0.5, known.back, known.front)[inside]
    truth = np.where(share > 0.5, (0.1, 0.3, 0.9), (0.8, 0.2, 0.1))[inside]
    assert np.abs(minor - truth).max() < 0.06  # as they are, up to 0.5
    exact = covered.reshape(12, 4, 16, 4).mean((1, 3))[known.rows, known.columns]
    assert np.abs(known.coverage - exact)[inside].max() < 0.02


def test_a_slope_is_one_surface():
    slope = np.tile(np.linspace(-20, 30, 64, dtype=np.float32), (48, 1))
    small, values, known = reduce_supersampled(np.ones((48, 64, 3), np.float32), slope, 4, DEFAULT_FILTER)
    assert len(known.rows) == 0
    np.testing.assert_allclose(values, slope.reshape(12, 4, 16, 4).mean((1, 3)) / 4, rtol=1e-5)
    np.testing.assert_allclose(small, 1.0)


@pytest.mark.parametrize("lamp", [(6, 30), (6, 31), (6, 36), (6, 37)])
def test_a_lamp_at_an_outline_keeps_its_light(lamp):
    image, defocus, _ = slanted(4)
    image[lamp] = 4000.0
    small, _, known = reduce_supersampled(image, defocus, 4, DEFAULT_FILTER)
    shown = small.astype(np.float64)
    share = known.coverage[:, None].astype(np.float64)
    shown[known.rows, known.columns] = share * known.front + (1 - share) * known.back
    assert shown.sum() == pytest.approx(image.sum(dtype=np.float64) / 16, rel=1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1)])
def test_small_pictures(shape):
    rng = np.random.default_rng(0)
    fine = (4 * shape[0], 4 * shape[1])
    image, defocus = rng.random((*fine, 3), dtype=np.float32), 90 * rng.random(fine, dtype=np.float32)
    small, values, known = reduce_supersampled(image, defocus, 4, DEFAULT_FILTER)
    assert small.shape == (*shape, 3)
    assert len(known.rows)
    for array in (small, values, known.front, known.back, known.near, known.far):
        assert np.isfinite(array).all()
    assert known.front.min() >= 0 <= known.back.min()
    assert np.isfinite(downsample(image, 4)).all()
