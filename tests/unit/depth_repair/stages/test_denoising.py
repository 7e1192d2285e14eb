"""Noise of maps: how strong it is, and taken out."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter, minimum_filter

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.stages.denoising import denoise_map, is_noisy, noise_level
from bokehnet.optics.encoding import encode


def scene(height: int = 160, width: int = 224) -> tuple[np.ndarray, np.ndarray]:
    """Picture and map of discs of one colour before a slope of another."""
    y, x = np.mgrid[:height, :width]
    near = np.hypot(y % 64 - 32, x % 64 - 32) < 20
    disparity = np.where(near, 0.9, 0.1 + 1e-3 * x).astype(np.float32)
    image = np.where(near[..., None], [0.7, 0.3, 0.1], [0.1, 0.2, 0.4]).astype(np.float32)
    return image, disparity


def with_noise(disparity: np.ndarray, deviation: float) -> np.ndarray:
    noise = np.random.default_rng(0).standard_normal(disparity.shape)
    return (disparity + deviation * noise).astype(np.float32)


@pytest.mark.parametrize("deviation", [0.002, 0.01, 0.05])
@pytest.mark.parametrize("scale", [1, 3], ids=["small", "large"])
def test_the_level_is_the_deviation_of_normal_noise(deviation, scale):
    """Authority: the noise that was added."""
    noisy = with_noise(np.kron(scene()[1], np.ones((scale, scale), np.float32)), deviation)
    assert_allclose(noise_level(noisy) * np.ptp(noisy), deviation, rtol=0.05)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d,
        lambda d: gaussian_filter(d, 2),
        lambda d: minimum_filter(d, 5),
        lambda d: np.round(255 * d) / 255,
        np.square,
    ],
    ids=["true", "blurred", "eroded", "8 bits", "squared"],
)
def test_maps_without_noise_have_none(spoil):
    assert not is_noisy(noise_level(spoil(scene()[1])))


@pytest.mark.parametrize("shape", [(1, 1), (31, 200), (200, 31)])
def test_small_maps_and_constant_ones_have_no_level(shape):
    assert noise_level(np.random.default_rng(0).random(shape, dtype=np.float32)) == 0
    assert noise_level(np.full((64, 64), 0.5, np.float32)) == 0


def test_the_mean_is_the_joint_bilateral_filter_done_twice():
    """Oracle: the formula of the docstring, window by window."""
    rng = np.random.default_rng(0)
    image, disparity = rng.random((9, 11, 3), np.float32), rng.random((9, 11), np.float32)
    colors, wanted = encode(image).astype(np.float64), disparity.astype(np.float64)
    for deviation in (0.25, 0.125):
        before, wanted = wanted, np.empty_like(wanted)
        for y, x in np.ndindex(before.shape):
            window = slice(max(0, y - 3), y + 4), slice(max(0, x - 3), x + 4)
            away = ((colors[window] - colors[y, x]) ** 2).sum(-1) / 0.06**2
            weight = np.exp(-0.5 * (away + ((before[window] - before[y, x]) / deviation) ** 2))
            wanted[y, x] = (weight * before[window]).sum() / weight.sum()
    assert_allclose(denoise_map(image, disparity, 0.1), wanted, atol=1e-5)


@pytest.mark.parametrize("deviation", [0.01, 0.03])
@pytest.mark.parametrize("mode", ["auto", "on"])
def test_noisy_maps_come_back(deviation, mode):
    """Authority: the map before the noise, of which a fourth is left, and all steps where they were."""
    image, disparity = scene()
    noisy = with_noise(disparity, deviation)
    found = DisparityRepair().repair(image, noisy, mode)
    assert np.abs(found.disparity - disparity).mean() < 0.25 * np.abs(noisy - disparity).mean()
    assert_array_equal(found.disparity > 0.6, disparity > 0.6)
    assert "noise of" in found.reason
    assert_allclose(found.plan.noise * np.ptp(noisy), deviation, rtol=0.05)


def test_the_plan_of_a_shot_tells_the_noise():
    image, disparity = scene()
    noisy = with_noise(disparity, 0.01)
    repair = DisparityRepair()
    plan = repair.repair(image, noisy, "auto").plan
    found = repair.repair(image, noisy, "auto", plan=plan)
    assert found.plan == plan
    assert_array_equal(found.disparity, repair.repair(image, noisy, "auto").disparity)
