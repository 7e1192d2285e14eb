"""Noise of maps: estimate and removal."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter, minimum_filter, uniform_filter

from bokehnet.depth_repair.config import RepairConfig
from bokehnet.depth_repair.diagnosis import noise_level
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.depth_repair.stages.denoise import denoise_map, without_outliers
from bokehnet.optics.encoding import encode


def scene(height: int = 160, width: int = 224) -> tuple[np.ndarray, np.ndarray]:
    """Return picture and map of discs of one colour in front of a slope of another."""
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
def test_the_level_equals_the_standard_deviation_of_normal_noise(deviation, scale):
    """Authority: the added noise."""
    noisy = with_noise(np.kron(scene()[1], np.ones((scale, scale), np.float32)), deviation)
    assert_allclose(noise_level(noisy) * np.ptp(noisy), deviation, rtol=0.05)


@pytest.mark.parametrize(
    "degrade",
    [
        lambda d: d,
        lambda d: gaussian_filter(d, 2),
        lambda d: minimum_filter(d, 5),
        lambda d: np.round(255 * d) / 255,
        np.square,
    ],
    ids=["true", "blurred", "eroded", "8 bits", "squared"],
)
def test_maps_without_noise_are_not_noisy(degrade):
    assert noise_level(degrade(scene()[1])) < RepairConfig().noise_range[0]


@pytest.mark.parametrize("shape", [(1, 1), (31, 200), (200, 31)])
def test_the_level_of_small_and_constant_maps_is_zero(shape):
    assert noise_level(np.random.default_rng(0).random(shape, dtype=np.float32)) == 0
    assert noise_level(np.full((64, 64), 0.5, np.float32)) == 0


@pytest.mark.parametrize("deviation", [0.01, 0.03])
def test_errors_that_neighbours_share_are_noise(deviation):
    """Authority: the deviation of the noise, the mean of 5x5 normal deviates, within a quarter of it."""
    noise = 5 * uniform_filter(np.random.default_rng(0).standard_normal((480, 672)), 5)
    noisy = np.kron(scene()[1], np.ones((3, 3))) + deviation * noise
    assert_allclose(noise_level(noisy) * np.ptp(noisy), deviation, rtol=0.25)


def test_a_net_over_half_of_the_picture_is_not_noise():
    y, x = np.mgrid[:160, :224]
    net = np.where((x % 8 < 2) | (y % 8 < 2), 0.5, 0.3) + 0.001 * x
    net[:, 112:] = 0.2
    assert noise_level(net) < RepairConfig().noise_range[0]


def test_denoising_equals_two_joint_bilateral_filters():
    """Oracle: the formula of the docstring, window by window."""
    rng = np.random.default_rng(0)
    image, disparity = rng.random((9, 11, 3), np.float32), rng.random((9, 11), np.float32)
    colors, expected = encode(image).astype(np.float64), disparity.astype(np.float64)
    radius, deviation = 3, 0.2
    for step, color_sigma in ((3, 0.06), (1, np.inf)):
        previous, expected = expected, np.empty_like(expected)
        for y, x in np.ndindex(previous.shape):
            places = (np.arange(-radius, radius + 1) * step + place for place in (y, x))
            window = np.ix_(*(a[(a >= 0) & (a < n)] for a, n in zip(places, previous.shape, strict=True)))
            color_distance = ((colors[window] - colors[y, x]) ** 2).sum(-1) / color_sigma**2
            weight = np.exp(-0.5 * (color_distance + ((previous[window] - previous[y, x]) / deviation) ** 2))
            expected[y, x] = (weight * previous[window]).sum() / weight.sum()
    assert_allclose(denoise_map(image, disparity, 0.1), expected, atol=1e-5)


def test_wrong_single_pixels_take_the_value_of_their_neighbours():
    """Authority: the map without them; a lamp of one pixel, of a colour of its own, stays."""
    image, disparity = scene()
    wrong = disparity.copy()
    wrong[5::16, 3::16] = 0.5
    result, fraction = without_outliers(image, wrong, 0.05)
    assert fraction == (result != wrong).mean()
    assert (np.abs(result - disparity) > 0.01).mean() < 0.2 * (np.abs(wrong - disparity) > 0.01).mean()
    lamp = image.copy()
    lamp[5, 3] = 1
    assert without_outliers(lamp, wrong, 0.05)[0][5, 3] == np.float32(0.5)


def test_nets_and_accurate_maps_have_no_wrong_pixels():
    image, disparity = scene()
    assert without_outliers(image, disparity, 0.05)[0] is disparity
    y, x = np.mgrid[:160, :224]
    net = np.where((x % 3 == 0) & (y % 3 == 0), 0.9, 0.1).astype(np.float32)
    assert without_outliers(image, net, 0.05)[0] is net


@pytest.mark.parametrize("size", [(1, 1), (4, 9), (9, 4), (5, 5)])
def test_wrong_pixels_of_the_smallest_maps(size):
    """Only a window of 5x5 pixels has a wrong one, in its middle; authority: the definition."""
    disparity = np.zeros(size, np.float32)
    disparity[size[0] // 2, size[1] // 2] = 1
    result, fraction = without_outliers(np.ones((*size, 3), np.float32), disparity, 0.05, fraction=0.005)
    assert fraction == (1 / 25 if size == (5, 5) else 0)
    assert_array_equal(result, 0 if fraction else disparity)


@pytest.mark.parametrize(("planned", "corrected"), [(0.0, False), (0.005, True)])
def test_the_plan_decides_on_the_wrong_pixels_of_a_frame(planned, corrected):
    """Authority: the frame, of which far too few pixels are wrong for a decision, and its correct values."""
    image, disparity = scene()
    wrong = disparity.copy()
    wrong[5, 3::16] = 0.5
    plan = RepairPlan(repaired=False, softness=0, shift=0, wrong_pixels=planned)
    frame = DisparityRepair().repair(image, wrong, "auto", plan=plan)
    assert ("wrong single pixels corrected" in frame.reason) == corrected
    changed = frame.disparity != wrong
    assert changed.any() == corrected
    assert_allclose(frame.disparity[changed], disparity[changed], atol=0.01)


def test_corrected_pixels_are_part_of_plan_and_reason():
    image, disparity = scene()
    wrong = disparity.copy()
    wrong[5::16, 3::16] = 0.5
    result = DisparityRepair().repair(image, wrong, "auto")
    assert not result.repaired
    assert result.plan.wrong_pixels == result.diagnosis.wrong_pixels == (result.disparity != wrong).mean()
    assert "% wrong single pixels corrected" in result.reason


@pytest.mark.parametrize("deviation", [0.01, 0.03])
@pytest.mark.parametrize("mode", ["auto", "on"])
def test_noisy_maps_are_restored(deviation, mode):
    """Authority: the map before noise; at most a quarter of the noise remains, and all edges stay."""
    image, disparity = scene()
    noisy = with_noise(disparity, deviation)
    repaired = DisparityRepair().repair(image, noisy, mode)
    assert np.abs(repaired.disparity - disparity).mean() < 0.25 * np.abs(noisy - disparity).mean()
    assert_array_equal(repaired.disparity > 0.6, disparity > 0.6)
    assert "noise of" in repaired.reason
    assert_allclose(repaired.plan.noise * np.ptp(noisy), deviation, rtol=0.05)


def test_heavy_noise_is_removed_and_noise_alone_stays():
    """Authority: the map before noise of an eighth of its depths; a map that is nothing but noise."""
    image, disparity = scene()
    noisy = with_noise(disparity, 0.1)
    repaired = DisparityRepair().repair(image, noisy, "auto").disparity
    assert np.abs(repaired - disparity).mean() < 0.4 * np.abs(noisy - disparity).mean()
    alone = with_noise(np.zeros_like(disparity), 1.0)
    assert_array_equal(DisparityRepair().repair(image, alone, "auto").disparity, alone)


def test_the_plan_of_a_shot_contains_the_noise():
    image, disparity = scene()
    noisy = with_noise(disparity, 0.01)
    repair = DisparityRepair()
    plan = repair.repair(image, noisy, "auto").plan
    repaired = repair.repair(image, noisy, "auto", plan=plan)
    assert repaired.plan == plan
    assert_array_equal(repaired.disparity, repair.repair(image, noisy, "auto").disparity)
