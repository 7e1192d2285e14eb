"""Removal of overshoots. Authority: the map before the ringing filter."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, zoom

from bokehnet.depth_repair.config import RepairConfig
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.stages.overshoots import overshoot_fraction, remove_overshoots


def disc(side=160):
    """Return a near disc in front of a far slope, with edges as soft as those of a network."""
    rows, columns = np.mgrid[:side, :side]
    inside = np.hypot(rows - side / 2, columns - side / 2) < 0.28 * side
    return gaussian_filter(np.where(inside, 0.85, 0.1 + 0.1 * rows / side), 2.0).astype(np.float32)


def ringing(smooth):
    """Return the map with overshoots from unsharp masking."""
    return (2.5 * smooth - 1.5 * gaussian_filter(smooth, 2.0)).astype(np.float32)


def test_a_rim_is_removed():
    smooth = disc()
    ringing_map = ringing(smooth)
    assert ringing_map.max() > 0.88
    assert ringing_map.min() < 0.08
    result = remove_overshoots(ringing_map)
    tolerance = 2 * 0.015 * np.ptp(ringing_map)  # tolerance of flat regions and lower bound of overshoots
    assert 0.1 - tolerance < result.min()
    assert result.max() < 0.85 + tolerance
    assert np.mean(result != ringing_map) < 0.15


@pytest.mark.parametrize("factor", [2, 4])
def test_overshoots_of_cubic_interpolation_are_removed(factor):
    rows, columns = np.mgrid[:240, :240]
    small = np.where(np.hypot(rows - 120, columns - 120) < 70, 0.85, 0.15)
    small = gaussian_filter(small, 0.45)
    large = zoom(small, factor, order=3, mode="nearest", grid_mode=True).astype(np.float32)
    tolerance = 2 * 0.015 * np.ptp(large)
    assert large.max() > 0.85 + tolerance
    result = remove_overshoots(large)
    assert 0.15 - tolerance < result.min()
    assert result.max() < 0.85 + tolerance


def test_subsampling_of_large_maps_removes_nearly_all_overshoots():
    """Few overshoots remain where edges bend between the sampled rows and columns."""
    large = zoom(gaussian_filter(np.where(disc(240) > 0.5, 0.85, 0.15), 0.45), 9, order=3, mode="nearest")
    beyond = np.abs(large - 0.5) > 0.35 + 2 * 0.015 * np.ptp(large)
    result = np.abs(remove_overshoots(large) - 0.5) > 0.35 + 2 * 0.015 * np.ptp(large)
    assert beyond.mean() > 0.002
    assert result.sum() < 0.05 * beyond.sum()


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (-0.02, 3.0), (40.0, -7.0)])
def test_the_result_does_not_depend_on_sign_scale_and_offset(scale, offset):
    ringing_map = ringing(disc()).astype(np.float64)
    expected = scale * remove_overshoots(ringing_map) + offset
    np.testing.assert_allclose(
        remove_overshoots(scale * ringing_map + offset), expected, atol=2e-6 * max(1, abs(scale))
    )


def test_maps_without_ringing_do_not_change():
    smooth = disc()
    rises = 8 * 0.1 / 160  # rise of the slope behind the disc within the window
    np.testing.assert_allclose(remove_overshoots(smooth), smooth, atol=rises)
    rows, columns = np.mgrid[:120, :120]
    wires = gaussian_filter(np.where(columns % 30 < 3, 0.9, 0.1), 1.5).astype(np.float32)
    np.testing.assert_array_equal(remove_overshoots(wires), wires)
    ground = np.where(rows < 60, 0.05, 0.3 + 0.005 * (rows - 60)).astype(np.float32)
    np.testing.assert_array_equal(remove_overshoots(ground), ground)


def test_only_ringing_maps_count_as_such():
    """Authority: the filter that made the map; ridges of blurred wires are no overshoots."""
    rows, columns = np.mgrid[:160, :160]
    wires = gaussian_filter(np.where(columns % 16 < 1, 0.9, 0.1) + 0.001 * rows, 2.0).astype(np.float32)
    limit = RepairConfig().min_overshoots
    for smooth in (disc(), wires):
        assert overshoot_fraction(smooth, remove_overshoots(smooth)) < limit
    assert overshoot_fraction(ringing(disc()), remove_overshoots(ringing(disc()))) > limit


def test_a_separate_object_in_front_of_a_rim_does_not_change():
    before = disc()
    before[75:85, 118:124] = 1.0  # nearer than the disc by more than the maximum overshoot
    np.testing.assert_array_equal(remove_overshoots(before)[75:85, 118:124], 1.0)


def test_the_repair_creates_no_rim():
    """The repaired map is constant on a flat disc whose input has a rim."""
    ringing_map = ringing(disc(192))
    rows, columns = np.mgrid[:192, :192]
    inside = np.hypot(rows - 96, columns - 96) < 54
    image = np.where(inside[..., None], (0.8, 0.3, 0.1), (0.1, 0.3, 0.7)).astype(np.float32)
    result = DisparityRepair().repair(image, ringing_map, "on").disparity
    near = result > 0.5
    assert abs(near.mean() / inside.mean() - 1) < 0.05
    assert np.ptp(result[near]) < 0.02


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (17, 3)])
def test_small_maps_keep_their_shape(shape):
    ringing_map = np.linspace(0, 1, shape[0] * shape[1], dtype=np.float32).reshape(shape)
    assert remove_overshoots(ringing_map).shape == shape
