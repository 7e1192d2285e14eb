import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.arrays.viewport import Viewport
from bokehnet.io.window import Window

VALUES = np.arange(12).reshape(3, 4)


def window(x, y, width, height):
    return Window(x=x, y=y, width=width, height=height, display_width=10, display_height=8)


def test_pixels_keep_their_place_in_the_shown_picture():
    """Formula: pixel (x, y) of the display is found at (x - window.x, y - window.y) of either array."""
    source, target = window(-1, 2, 4, 3), window(1, 3, 2, 2)
    assert_array_equal(source.fit_to(VALUES, target), VALUES[1:3, 2:4])


def test_beyond_what_is_stored_the_border_is_repeated():
    moved = window(0, 0, 4, 3).fit_to(VALUES, window(-1, -2, 6, 6))
    assert_array_equal(moved, np.pad(VALUES, ((2, 1), (1, 1)), "edge"))


def test_the_same_window_changes_nothing():
    assert window(1, 1, 4, 3).fit_to(VALUES, window(1, 1, 4, 3)) is VALUES
    whole = Window.whole(4, 3)
    assert whole.crop_to_display(VALUES) is VALUES


def test_what_is_shown_is_cut_from_overscan_and_filled_with_black():
    frame = Window(x=-1, y=1, width=4, height=3, display_width=2, display_height=5)
    expected = np.zeros((5, 2))
    expected[1:4] = VALUES[:, 1:3]
    assert_array_equal(frame.crop_to_display(VALUES), expected)


def test_a_data_window_outside_the_display_window_shows_nothing():
    assert not window(20, 0, 4, 3).crop_to_display(np.ones((3, 4))).any()
    assert not window(-9, -9, 4, 3).crop_to_display(np.ones((3, 4))).any()


def test_a_window_gives_its_position_in_the_displayed_picture():
    viewport = Window(x=-1, y=2, width=4, height=3, display_width=12, display_height=5).viewport
    assert viewport == Viewport(left=-1, top=2, width=12, height=5)
    column, row, scale = viewport.below(2).frame
    assert (column, row) == (5.5 + 1, 2 - 4)  # the centre of the display, from the first stored pixel
    assert scale == pytest.approx(2 / 13)
