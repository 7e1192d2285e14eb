"""Soft shoulder of light above white in files of whole numbers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.formats.output_format import OutputFormat
from bokehnet.io.frame import Frame, read_frame, write_frame
from bokehnet.io.window import Window


def stored(path, light, shoulder, bits=16):
    frame = Frame(image=light, alpha=None, camera=None, window=Window.whole(*light.shape[1::-1]))
    write_frame(
        path, frame, light, output_format=OutputFormat(color_space="srgb", bits=bits, shoulder=shoulder)
    )
    return linear_to_srgb(read_frame(path).image)


def test_light_above_white_is_divided_by_the_root_of_its_brightest_channel(tmp_path):
    """Authority: the formula c / sqrt(max c), then a clip of each channel."""
    light = np.float32([[[4, 1, 0.4], [9, 2.4, 0.3], [1.44, 0.6, 0.6]]])
    expected = np.clip(light / np.sqrt(light.max(-1, keepdims=True)), 0, 1)
    assert_allclose(stored(tmp_path / "a.png", light, True), linear_to_srgb(expected), atol=2e-4)
    assert_allclose(stored(tmp_path / "b.png", light, False), linear_to_srgb(light.clip(0, 1)), atol=2e-4)


@pytest.mark.parametrize("bits", [8, 16])
def test_light_up_to_white_is_the_same(tmp_path, bits):
    light = np.random.default_rng(1).random((20, 30, 3), np.float32)
    assert_array_equal(
        stored(tmp_path / "a.png", light, True, bits), stored(tmp_path / "b.png", light, False, bits)
    )


def test_floating_point_files_keep_the_light(tmp_path):
    light = np.full((4, 4, 3), 7, np.float32)
    frame = Frame(image=light, alpha=None, camera=None, window=Window.whole(4, 4))
    write_frame(tmp_path / "a.exr", frame, light, output_format=OutputFormat(shoulder=True))
    assert_array_equal(read_frame(tmp_path / "a.exr").image, light)
