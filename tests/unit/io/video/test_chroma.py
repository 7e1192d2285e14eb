"""Planes of luma and chroma against the numbers of ITU-R BT.709 and BT.2020, and their own inverse."""

import numpy as np
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.video.chroma import PixelFormat


def flat(color):
    return np.broadcast_to(np.array(color, np.float32), (4, 4, 3))


@pytest.mark.parametrize(
    ("name", "matrix", "full", "color", "expected"),
    [
        # ITU-R BT.709-6, item 3.4 and 4.6: black 16, white 235; Y of red is 0.2126, its Cr the largest.
        ("yuv420p", 1, False, (0, 0, 0), (16, 128, 128)),
        ("yuv420p", 1, False, (1, 1, 1), (235, 128, 128)),
        ("yuv420p", 1, False, (1, 0, 0), (63, 102, 240)),
        # ITU-R BT.2100-2, table 9: 10 bits, narrow range.
        ("yuv420p10le", 9, False, (1, 1, 1), (940, 512, 512)),
        ("yuv422p10le", 9, False, (0, 0, 1), (116, 960, 476)),
        ("yuv444p", 6, False, (0, 1, 0), (145, 54, 34)),  # ITU-R BT.601-7, table 3: 0.587
        ("yuvj420p", 6, False, (1, 1, 1), (255, 128, 128)),
        ("yuv420p", 6, True, (0, 0, 0), (0, 128, 128)),
    ],
)
def test_colors_become_the_numbers_of_the_standard(name, matrix, full, color, expected):
    planes = PixelFormat.named(name, matrix, full).planes(flat(color))
    assert [int(plane[1, 1]) for plane in planes] == list(expected)


@pytest.mark.parametrize("name", ["yuv420p", "yuv422p10le", "yuv444p12le"])
@pytest.mark.parametrize("size", [(6, 8), (5, 7)])
def test_a_slope_comes_back_within_a_level(name, size):
    height, width = size
    y, x = np.mgrid[:height, :width].astype(np.float32)
    colors = np.stack([0.3 + 0.02 * x, 0.4 + 0.02 * y, 0.5 - 0.01 * x], 2)
    kind = PixelFormat.named(name, 1, False)
    planes = kind.planes(colors)
    back = kind.colors(planes)
    inner = (slice(2, -2), slice(2, -2))  # chroma has no neighbours beyond the border
    assert np.abs(back - colors)[inner].max() < 2.5 / 2**kind.bits
    again = kind.planes(back)
    assert np.abs(again[0].astype(int) - planes[0]).max() <= 1


def test_other_pixels_are_refused_by_name():
    with pytest.raises(ImageFileError, match="found pixels of pal8"):
        PixelFormat.named("pal8", 1, False)
