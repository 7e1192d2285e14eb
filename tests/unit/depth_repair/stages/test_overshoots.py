"""Authority: the map before a filter made it ring."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, zoom

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.stages.overshoots import remove_overshoots


def disc(side=160):
    """A near disc before a far slope, steps as soft as those of a network."""
    rows, columns = np.mgrid[:side, :side]
    inside = np.hypot(rows - side / 2, columns - side / 2) < 0.28 * side
    return gaussian_filter(np.where(inside, 0.85, 0.1 + 0.1 * rows / side), 2.0).astype(np.float32)


def ringing(smooth):
    """The same, sharpened so that it overshoots."""
    return (2.5 * smooth - 1.5 * gaussian_filter(smooth, 2.0)).astype(np.float32)


def test_a_rim_is_taken_back():
    smooth = disc()
    given = ringing(smooth)
    assert given.max() > 0.88
    assert given.min() < 0.08
    found = remove_overshoots(given)
    left = 2 * 0.015 * np.ptp(given)  # a flat part may hold so much, and as little is no overshoot
    assert 0.1 - left < found.min()
    assert found.max() < 0.85 + left
    assert np.mean(found != given) < 0.15


@pytest.mark.parametrize("factor", [2, 4])
def test_a_map_enlarged_by_cubic_interpolation(factor):
    rows, columns = np.mgrid[:240, :240]
    small = np.where(np.hypot(rows - 120, columns - 120) < 70, 0.85, 0.15)
    small = gaussian_filter(small, 0.45)
    large = zoom(small, factor, order=3, mode="nearest", grid_mode=True).astype(np.float32)
    left = 2 * 0.015 * np.ptp(large)
    assert large.max() > 0.85 + left
    found = remove_overshoots(large)
    assert 0.15 - left < found.min()
    assert found.max() < 0.85 + left


def test_of_a_large_map_few_rows_and_columns_are_seen():
    """Rims that are left where edges bend within what is not seen are a small part of all."""
    large = zoom(gaussian_filter(np.where(disc(240) > 0.5, 0.85, 0.15), 0.45), 9, order=3, mode="nearest")
    beyond = np.abs(large - 0.5) > 0.35 + 2 * 0.015 * np.ptp(large)
    found = np.abs(remove_overshoots(large) - 0.5) > 0.35 + 2 * 0.015 * np.ptp(large)
    assert beyond.mean() > 0.002
    assert found.sum() < 0.05 * beyond.sum()


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (-0.02, 3.0), (40.0, -7.0)])
def test_near_and_far_scale_and_offset_are_alike(scale, offset):
    given = ringing(disc()).astype(np.float64)
    wanted = scale * remove_overshoots(given) + offset
    np.testing.assert_allclose(
        remove_overshoots(scale * given + offset), wanted, atol=2e-6 * max(1, abs(scale))
    )


def test_what_does_not_ring_stays_as_it_is():
    smooth = disc()
    rises = 8 * 0.1 / 160  # what the slope behind the disc does within the window
    np.testing.assert_allclose(remove_overshoots(smooth), smooth, atol=rises)
    rows, columns = np.mgrid[:120, :120]
    wires = gaussian_filter(np.where(columns % 30 < 3, 0.9, 0.1), 1.5).astype(np.float32)
    np.testing.assert_array_equal(remove_overshoots(wires), wires)
    ground = np.where(rows < 60, 0.05, 0.3 + 0.005 * (rows - 60)).astype(np.float32)
    np.testing.assert_array_equal(remove_overshoots(ground), ground)


def test_a_thing_of_its_own_before_a_rim_stays():
    before = disc()
    before[75:85, 118:124] = 1.0  # nearer than the disc by more than an overshoot
    np.testing.assert_array_equal(remove_overshoots(before)[75:85, 118:124], 1.0)


def test_the_repair_makes_no_ring():
    """Its sharp map holds one value on all of a flat disc that was given with a rim."""
    given = ringing(disc(192))
    rows, columns = np.mgrid[:192, :192]
    inside = np.hypot(rows - 96, columns - 96) < 54
    image = np.where(inside[..., None], (0.8, 0.3, 0.1), (0.1, 0.3, 0.7)).astype(np.float32)
    found = DisparityRepair().repair(image, given, "on").disparity
    near = found > 0.5
    assert abs(near.mean() / inside.mean() - 1) < 0.05
    assert np.ptp(found[near]) < 0.02


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (17, 3)])
def test_small_maps(shape):
    given = np.linspace(0, 1, shape[0] * shape[1], dtype=np.float32).reshape(shape)
    assert remove_overshoots(given).shape == shape
