"""Authority: scenes whose coverage is known by construction."""

import numpy as np
import pytest

from bokehnet.classical.layered.supersampled import reduce_supersampled
from bokehnet.optics.supersampling import reduce_fine


def slanted(factor, height=12, width=16):
    """A textured front before a flat wall at ``factor`` times the size; also which samples are front."""
    y, x = np.mgrid[: factor * height, : factor * width] / factor
    front = x + 0.35 * y < 9
    image = np.where(front[..., None], (0.8, 0.2, 0.1), (0.1, 0.3, 0.9)).astype(np.float32)
    return image, np.where(front, 0.9, 0.2).astype(np.float32), front


@pytest.mark.parametrize("factor", [2, 4])
def test_coverage_is_the_share_of_the_samples(factor):
    image, disparity, front = slanted(factor)
    small, values, known = reduce_supersampled(image, disparity, factor)
    share = front.reshape(12, factor, 16, factor).mean((1, 3))
    mixed = (share > 0) & (share < 1)
    np.testing.assert_array_equal(np.argwhere(mixed), np.stack([known.rows, known.columns], -1))
    np.testing.assert_allclose(known.coverage, share[mixed], atol=1e-6)
    np.testing.assert_allclose(values, np.where(share >= 0.5, 0.9, 0.2), atol=1e-6)
    np.testing.assert_allclose(small, image.reshape(12, factor, 16, factor, 3).mean((1, 3)), atol=1e-6)
    np.testing.assert_allclose(known.front, np.tile([0.8, 0.2, 0.1], (mixed.sum(), 1)), atol=1e-5)
    np.testing.assert_allclose(known.back, np.tile([0.1, 0.3, 0.9], (mixed.sum(), 1)), atol=1e-5)
    assert known.complete


def test_both_surfaces_add_up_to_the_pixel_and_are_pure_though_the_samples_are_filtered():
    image, disparity, _ = slanted(4)
    filtered = image.copy()  # as a renderer filters its fine pixels, too
    for axis in (0, 1):
        filtered = 0.25 * np.roll(filtered, 1, axis) + 0.5 * filtered + 0.25 * np.roll(filtered, -1, axis)
    small, _, known = reduce_supersampled(filtered, disparity, 4)
    share = known.coverage[:, None]
    added = share * known.front + (1 - share) * known.back
    np.testing.assert_allclose(added, small[known.rows, known.columns], atol=1e-5)
    inside = (known.rows > 1) & (known.rows < 10)  # the roll has brought the other border in
    minor = np.where(share > 0.5, known.back, known.front)[inside]
    truth = np.where(share > 0.5, (0.1, 0.3, 0.9), (0.8, 0.2, 0.1))[inside]
    assert np.abs(minor - truth).max() < 0.06  # as they are, up to 0.5


def test_a_slope_is_one_surface():
    disparity = np.tile(np.linspace(0.2, 0.9, 64, dtype=np.float32), (48, 1))
    known = reduce_supersampled(np.ones((48, 64, 3), np.float32), disparity, 4)[2]
    assert len(known.rows) == 48 // 4 * 64 // 4  # as steep as that its samples lie apart, but
    assert (known.near - known.far).max() < 0.7 / 16  # no farther than the slope itself
    flat = reduce_supersampled(np.ones((8, 8, 3), np.float32), np.full((8, 8), 0.4, np.float32), 4)
    assert len(flat[2].rows) == 0


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1)])
def test_small_pictures(shape):
    rng = np.random.default_rng(0)
    fine = (4 * shape[0], 4 * shape[1])
    image, disparity = rng.random((*fine, 3), dtype=np.float32), rng.random(fine, dtype=np.float32)
    small, values, known = reduce_supersampled(image, disparity, 4)
    assert small.shape == (*shape, 3)
    for array in (small, values, known.front, known.back, known.near, known.far):
        assert np.isfinite(array).all()
    assert known.front.min() >= 0 <= known.back.min()
    assert np.isfinite(reduce_fine(image, 4)).all()
