"""Averages over windows. Authority: means of lines, of independent numbers."""

import numpy as np
import pytest

from bokehnet.classical.layered.march.ray_accumulators import (
    BACK_GROUP,
    FRONT_GROUP,
    GROUPS,
    PLAIN,
    SHARP_GROUP,
)
from bokehnet.classical.layered.march.ray_averages import resolve, window_halo, window_reach

SIZE = 256


def sums_of(group: int, colors: np.ndarray, radius: float | np.ndarray = 48.0) -> np.ndarray:
    """All rays of each pixel meet surfaces of one group."""
    sums = np.zeros((*colors.shape[:2], GROUPS, PLAIN), np.float32)
    sums[:, :, group, :3] = colors
    sums[:, :, group, 3] = 1.0
    sums[:, :, group, 4] = 1.0 / radius
    return sums


def resolved(sums: np.ndarray, radius: float = 48.0) -> np.ndarray:
    result = np.zeros((*sums.shape[:2], 3), np.float32)
    weight = np.zeros(sums.shape[:2], np.float32)
    resolve(sums, np.ones(weight.shape, bool), 0, 0, len(sums), result, weight, radius)
    return result


@pytest.mark.parametrize("group", [FRONT_GROUP, BACK_GROUP])
@pytest.mark.parametrize(("radius", "pixels"), [(5.0, 9), (24.0, 25), (48.0, 81)])
def test_noise_of_blurred_surfaces_falls_as_that_of_a_mean(group, radius, pixels):
    """The variance of a mean of n independent numbers is 1 / n of theirs."""
    noise = np.random.default_rng(0).standard_normal((SIZE, SIZE, 3)).astype(np.float32)
    left = resolved(sums_of(group, noise, radius))[4:-4, 4:-4]
    assert left.var() == pytest.approx(1 / pixels, rel=0.1)


def test_between_two_windows_the_outer_ring_counts_in_part():
    """Half of the ring of 5x5: (9 + 16 / 4) / (9 + 16 / 2)^2 of the variance."""
    noise = np.random.default_rng(1).standard_normal((SIZE, SIZE, 3)).astype(np.float32)
    left = resolved(sums_of(BACK_GROUP, noise, 18.0))[4:-4, 4:-4]
    assert left.var() == pytest.approx(13 / 17**2, rel=0.1)


@pytest.mark.parametrize("group", [FRONT_GROUP, BACK_GROUP])
@pytest.mark.parametrize(("radius", "side"), [(72.0, 13), (96.0, 17), (192.0, 33), (500.0, 65)])
def test_windows_of_blocks_take_as_much_noise_away_as_windows_of_pixels(group, radius, side):
    """A mean over the pixels up to radius / 12 away, at most 32; straight lines between blocks widen it."""
    noise = np.random.default_rng(3).standard_normal((4 * SIZE, 3 * SIZE, 3)).astype(np.float32)
    halo = window_halo(radius)
    left = resolved(sums_of(group, noise, radius), radius)[halo:-halo, halo:-halo]
    assert 0.5 / side**2 < left.var() < 1.1 / side**2


@pytest.mark.parametrize("group", [FRONT_GROUP, BACK_GROUP])
@pytest.mark.parametrize("radius", [48.0, 96.0, 192.0, 384.0])
def test_straight_slopes_stay(group, radius):
    y, x = np.mgrid[:SIZE, :SIZE].astype(np.float32)
    slope = np.stack([x, y, x - 2 * y], -1)
    left = resolved(sums_of(group, slope, radius), radius)
    inner = np.s_[(halo := window_halo(radius)) : -halo, halo:-halo]
    np.testing.assert_allclose(left[inner], slope[inner], atol=1e-4)


def test_rows_depend_on_no_more_than_their_halo():
    noise = np.random.default_rng(4).random((SIZE, 64, 3), dtype=np.float32)
    sums, halo = sums_of(BACK_GROUP, noise, 150.0), window_halo(150.0)
    whole = resolved(sums, 150.0)
    first = 96 - -(-halo // 8) * 8
    result, weight = np.zeros((SIZE, 64, 3), np.float32), np.zeros((SIZE, 64), np.float32)
    part = sums[first : 128 + halo].copy()
    resolve(part, np.ones((SIZE, 64), bool), first, 96, 128, result, weight, 150.0)
    np.testing.assert_array_equal(result[96:128], whole[96:128])


@pytest.mark.parametrize("radius", [48.0, 150.0, 500.0])
def test_pixels_that_send_no_rays_change_no_window(radius):
    """Sums of 0 add nothing: a mask of all pixels is the oracle of one of those that sent rays."""
    rng = np.random.default_rng(5)
    mask = np.zeros((SIZE, SIZE), bool)
    mask[20:37, 3:90] = mask[120:122, 200:] = mask[200:, 100:101] = True
    mask &= rng.random(mask.shape) < 0.8
    sums = sums_of(BACK_GROUP, rng.random((SIZE, SIZE, 3), dtype=np.float32), radius)
    sums[~mask] = 0
    result, weight = np.zeros((SIZE, SIZE, 3), np.float32), np.zeros((SIZE, SIZE), np.float32)
    resolve(sums, mask, 0, 0, SIZE, result, weight, radius)
    np.testing.assert_array_equal(result[mask], resolved(sums, radius)[mask])


def test_large_discs_are_not_averaged_with_small_ones():
    """Left half black with discs of 192 pixels, right half white with discs of 5."""
    radius = np.full((SIZE, SIZE), 192.0, np.float32)
    radius[:, SIZE // 2 :] = 5.0
    colors = np.zeros((SIZE, SIZE, 3), np.float32)
    colors[:, SIZE // 2 :] = 1.0
    left = resolved(sums_of(BACK_GROUP, colors, radius), 192.0)
    np.testing.assert_array_equal(left[:, : SIZE // 2 - 4], 0.0)
    np.testing.assert_allclose(left[:, SIZE // 2 + 1 :], 1.0, atol=1e-6)


def test_sharp_surfaces_are_their_own():
    texture = np.random.default_rng(2).random((SIZE, SIZE, 3), dtype=np.float32)
    np.testing.assert_allclose(resolved(sums_of(SHARP_GROUP, texture)), texture, rtol=1e-6)


def test_blur_behind_a_sharp_edge_leaves_the_edge():
    """Left half sharp and white, right half far behind and black: no grey between them."""
    colors = np.zeros((SIZE, SIZE, 3), np.float32)
    sums = sums_of(BACK_GROUP, colors)
    sums[:, : SIZE // 2] = sums_of(SHARP_GROUP, colors + 1)[:, : SIZE // 2]
    left = resolved(sums)
    np.testing.assert_array_equal(left[:, : SIZE // 2], 1.0)
    np.testing.assert_array_equal(left[:, SIZE // 2 :], 0.0)


def test_a_few_small_discs_keep_the_window_narrow():
    """Harmonic mean: a tenth of radius 4 among radius 40 counts as 1 / (0.1 / 4 + 0.9 / 40) = 21."""
    reach = window_reach(1.0, 0.1 / 4 + 0.9 / 40)
    assert reach == pytest.approx((1 / (0.1 / 4 + 0.9 / 40)) / 12)
