"""Continuation of pictures beyond their border, and the blur that reaches across it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.arrays.beyond_border import beyond_border
from bokehnet.classical.rays_renderer import rays

RNG = np.random.default_rng(7)
SOFT = (0.2 + 0.1 * np.linspace(0, 1, 60)[:, None, None] + 0.05 * RNG.random((60, 80, 3))).astype(np.float32)
RADIUS = 12
BACKGROUND = 0.02


def blurred(image):
    return rays(image, np.full(image.shape[:2], -RADIUS, np.float32))


@pytest.mark.parametrize(("above", "below", "sides"), [(0, 0, 0), (3, 0, 2), (70, 90, 100)])
def test_soft_pictures_repeat_their_border(above, below, sides):
    """Authority: NumPy's edge padding."""
    padding = ((above, below), (sides, sides), (0, 0))
    assert_allclose(beyond_border(SOFT, above, below, sides, sides), np.pad(SOFT, padding, "edge"), atol=1e-6)


def test_a_line_along_a_side_is_mirrored_once():
    image = SOFT.copy()
    image[0] = 1
    larger = beyond_border(image, 20, 0, 0, 0)
    assert_array_equal(larger[19], image[0])
    assert_array_equal(larger[15:20], image[4::-1])
    assert larger[:19].max() < 0.5


@pytest.mark.parametrize("level", [0.0, 1.0])
def test_a_line_around_the_picture_makes_no_frame_as_wide_as_the_blur(level):
    """Authority: the disc over the mirrored picture: two lines of one pixel in a disc of 12."""
    image = np.full((100, 140, 3), 0.25, np.float32)
    image[0] = image[-1] = image[:, 0] = image[:, -1] = level
    row = np.arange(-RADIUS, RADIUS + 1) + 0.5
    chord = 2 * np.sqrt(np.maximum(0, RADIUS**2 - row**2)) / (np.pi * RADIUS**2)
    lines = float(chord[(row == 0.5) | (row == -0.5)].sum())
    expected = 0.25 + (level - 0.25) * lines
    assert blurred(image)[0, 70, 0] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("place", [(0, 70), (0, 0), (99, 139), (50, 70)])
@pytest.mark.parametrize("size", [1, 3])
def test_a_lamp_on_the_border_keeps_its_energy(place, size):
    """Authority: the sum of its light; repeating the border gave 3.7 times as much, in a corner 12.5."""
    image = np.full((100, 140, 3), BACKGROUND, np.float32)
    row, column = min(place[0], 100 - size), min(place[1], 140 - size)
    image[row : row + size, column : column + size] = 40
    light = (blurred(image) - BACKGROUND).sum() / (image - BACKGROUND).sum()
    assert light == pytest.approx(1, abs=0.1)


def test_pixels_that_no_disc_connects_to_the_border_do_not_change():
    """Authority: the same picture without its line, bit by bit."""
    line = SOFT.copy()
    line[:, 0] = 3
    assert_array_equal(blurred(line)[:, 2 * RADIUS :], blurred(SOFT)[:, 2 * RADIUS :])
