"""Disparity of the surface under a pixel: holes, noise, thin things, slopes, borders."""

import numpy as np
import pytest

from bokehnet.scene.focus_patch import surface_disparity

RNG = np.random.default_rng(5)
TEXTURE = np.clip(0.4 + 0.13 * RNG.standard_normal((80, 120, 3)), 0.02, 1).astype(np.float32)


def two_surfaces():
    """Near from column 40 on, 0.8; far before it, 0.2."""
    values = np.full((80, 120), 0.8, np.float32)
    values[:, :40] = 0.2
    return values


@pytest.mark.parametrize("image", [None, TEXTURE])
@pytest.mark.parametrize("size", [1, 2, 4])
@pytest.mark.parametrize("wrong", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("corner", [(30, 60), (0, 60), (76, 116), (30, 41)])
def test_a_hole_of_the_map_takes_the_surface_around_it(image, size, wrong, corner):
    """Authority: the map without the hole. Holes inside, on the border, and near a depth edge."""
    values = two_surfaces()
    row, column = corner
    values[row : row + size, column : column + size] = wrong
    assert surface_disparity(values, column, row, image) == pytest.approx(0.8)


def test_a_hole_at_a_depth_edge_takes_the_side_of_its_colour():
    """Authority: the picture, dark before the edge and bright behind it; the hole covers both sides."""
    values = two_surfaces()
    image = np.full((80, 120, 3), 0.6, np.float32)
    image[:, :40] = 0.05
    values[30:33, 38:42] = 0.5
    assert surface_disparity(values, 39, 31, image) == pytest.approx(0.2)
    assert surface_disparity(values, 40, 31, image) == pytest.approx(0.8)


@pytest.mark.parametrize("image", [None, TEXTURE])
def test_thin_things_stay(image):
    """Authority: the map. Wires and twigs of one pixel have no colour of their own here."""
    values = two_surfaces()
    values[:, 70] = 0.95
    values[50:57, 90] = 0.95
    for row, column in ((20, 70), (0, 70), (53, 90)):
        assert surface_disparity(values, column, row, image) == pytest.approx(0.95)


def test_a_small_thing_stays_where_its_colour_differs():
    values = two_surfaces()
    values[30:33, 60:63] = 0.1
    image = TEXTURE.copy()
    image[30:33, 60:63] = (1.0, 0.0, 0.0)
    assert surface_disparity(values, 61, 31, image) == pytest.approx(0.1)
    assert surface_disparity(values, 61, 31, TEXTURE) == pytest.approx(0.8)


def test_a_slope_keeps_its_value_at_the_pixel():
    """Authority: the formula of the slope; its median over opposite pixels is the value between them."""
    y, x = np.mgrid[:80, :120]
    values = (0.1 + 0.005 * x + 0.003 * y).astype(np.float32)
    for row, column in ((40, 60), (0, 0), (79, 60), (3, 118)):
        assert surface_disparity(values, column, row, TEXTURE) == pytest.approx(
            float(values[row, column]), abs=1e-6
        )


def test_noise_of_the_map_averages_out():
    """Authority: standard error of a median of 121 values, 1.25 sigma / 11 = 0.0034; four times that."""
    clean = two_surfaces()
    noisy = (clean + 0.03 * RNG.standard_normal(clean.shape)).astype(np.float32)
    for row, column in ((20, 80), (40, 20), (60, 100)):
        assert abs(surface_disparity(noisy, column, row, TEXTURE) - clean[row, column]) < 0.014


def test_pixels_next_to_an_edge_keep_their_side():
    values = two_surfaces()
    assert surface_disparity(values, 39, 40, TEXTURE) == pytest.approx(0.2)
    assert surface_disparity(values, 40, 40, TEXTURE) == pytest.approx(0.8)


def test_holes_grow_with_the_map():
    """A map of 8 times fewer pixels has holes of 8x8 pixels of the picture."""
    values = np.full((1200, 1600), 0.6, np.float32)
    values[:, :400] = 0.1
    values[600:608, 800:808] = 0.0
    assert surface_disparity(values, 803, 603) == pytest.approx(0.6)
