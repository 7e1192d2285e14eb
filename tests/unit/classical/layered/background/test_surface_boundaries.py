"""Boundaries between surfaces behind an occluder. Authority: constructed surfaces."""

import numpy as np
import pytest

from bokehnet.classical.layered.background.surface_boundaries import smooth_boundaries

NEAR, FAR, OCCLUDER = 0.0, -20.0, 40.0


def smoothed(depths, distance=20.0):
    """Colors and defocus behind one large occluder after smoothing; the color of a surface is its defocus."""
    depths = depths.astype(np.float32)
    colors = np.repeat(depths[..., None], 3, 2)
    ys, xs = np.nonzero(np.ones(depths.shape, bool))
    shape = depths.shape
    smooth_boundaries(
        ys, xs, np.full(shape, OCCLUDER, np.float32), np.full(shape, distance, np.float32), colors, depths
    )
    return colors, depths


def half_planes(height=60, width=70, at=35):
    """A far surface on the left of a near one."""
    return np.where(np.arange(width) < at, FAR, NEAR)[None].repeat(height, 0)


@pytest.mark.parametrize("transposed", [False, True])
def test_straight_boundaries_stay_to_the_bit(transposed):
    straight = half_planes().T if transposed else half_planes()
    colors, depths = smoothed(straight)
    np.testing.assert_array_equal(depths, straight)
    np.testing.assert_array_equal(colors[..., 1], straight)


def test_a_diagonal_boundary_moves_by_a_pixel_at_most():
    rows, columns = np.mgrid[:80, :80]
    diagonal = np.where(rows > columns, FAR, NEAR)
    changed = (smoothed(diagonal)[1] != diagonal)[15:-15, 15:-15]  # at the border corners become round
    assert not changed[np.abs(rows - columns)[15:-15, 15:-15] > 1].any()


def test_spikes_of_single_directions_disappear():
    spiked = half_planes()
    for row in range(5, 58, 6):
        spiked[row, 24:35] = NEAR
        spiked[row + 3, 35:44] = FAR
    colors, depths = smoothed(spiked)
    before, after = ((x != half_planes()).mean() for x in (spiked, depths))
    assert after < 0.25 * before
    np.testing.assert_allclose(colors[..., 2], depths, atol=1e-5)


def test_a_pole_that_continues_on_both_sides_stays():
    pole = np.full((60, 60), FAR)
    pole[:, 30:32] = NEAR
    np.testing.assert_array_equal(smoothed(pole)[1], pole)


def test_pixels_next_to_the_edge_of_the_occluder_stay():
    spiked = half_planes()
    spiked[20, 25:35] = NEAR
    np.testing.assert_array_equal(smoothed(spiked, distance=5.0)[1], spiked)


def test_slopes_are_one_surface():
    slope = np.linspace(FAR, NEAR, 60)[None].repeat(40, 0)
    np.testing.assert_array_equal(smoothed(slope)[1], slope.astype(np.float32))
