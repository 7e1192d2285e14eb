"""Growth of thin structures. Authority: the synthetic scene of the map."""

import numpy as np

from bokehnet.depth_repair.filters import shift_edges
from bokehnet.depth_repair.stages.thin_growth import grow_thin_structures, thin_fraction

NEAR, FAR, MIN_HEIGHT, SIZE = np.float32(0.8), np.float32(0.1), 0.05, 96


def scene(near):
    """Return the picture (H, W, 3) and the map (H, W) of a grey object before checkered cloth."""
    y, x = np.mgrid[:SIZE, :SIZE]
    checks = ((y // 12 + x // 12) % 2)[..., None]
    picture = np.where(checks, (0.6, 0.5, 0.1), (0.1, 0.2, 0.5)).astype(np.float32)
    picture[near] = (0.85, 0.85, 0.9)
    return picture, np.where(near, NEAR, FAR)


def blade():
    """Return the pixels of a blade 4 pixels wide, (H, W) bool."""
    y, x = np.mgrid[:SIZE, :SIZE]
    return (np.abs(y - 0.5 * x - 20) < 2.5) & (x >= 10) & (x < 70)


def test_a_blade_grows_to_its_end_from_the_piece_that_the_map_kept():
    picture, truth = scene(blade())
    lost = truth.copy()
    lost[:, 36:] = FAR
    grown = grow_thin_structures(picture, lost, MIN_HEIGHT)
    missing = truth != lost
    assert (grown[missing] == NEAR).mean() > 0.9
    assert (grown != lost)[~missing].mean() < 0.002


def test_a_line_of_the_background_that_runs_into_a_surface_does_not_grow():
    y, x = np.mgrid[:SIZE, :SIZE]
    surface = x < 30
    picture, disparity = scene(surface | (np.abs(y - 48) < 2.5))
    disparity = np.where(surface, disparity, FAR)
    np.testing.assert_array_equal(grow_thin_structures(picture, disparity, MIN_HEIGHT), disparity)


def test_a_blade_of_the_colours_of_its_background_does_not_grow():
    picture, truth = scene(blade())
    lost = truth.copy()
    lost[:, 36:] = FAR
    grey = np.full_like(picture, 0.4)
    np.testing.assert_array_equal(grow_thin_structures(grey, lost, MIN_HEIGHT), lost)


def test_the_thin_fraction_is_zero_after_an_opening_only():
    y, x = np.mgrid[:SIZE, :SIZE]
    _, disparity = scene(blade() | ((y > 70) & (x > 60)))
    assert thin_fraction(disparity, MIN_HEIGHT) > 0.1
    opened = shift_edges(shift_edges(disparity, -3), 3)
    assert opened.max() == NEAR
    assert thin_fraction(opened, MIN_HEIGHT) == 0
