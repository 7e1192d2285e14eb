"""Depth packed into colours. Authority: the packing written out for each pixel in integers or bytes."""

import struct

import numpy as np
import pytest
from PIL import Image

from bokehnet.errors import ImageFileError
from bokehnet.io.maps import read_stored_map

VALUES = np.random.default_rng(4).random((6, 5))


def stored_map(tmp_path, levels, coding):
    path = tmp_path / "packed.png"
    Image.fromarray(np.asarray(levels, np.uint8)).save(path)
    return read_stored_map(path, coding=coding).values


@pytest.mark.parametrize("coding", ["rgb24", "bgr24"])
def test_24_bits(tmp_path, coding):
    counts = (VALUES * (2**24 - 1)).astype(int)
    levels = np.stack([counts & 255, counts >> 8 & 255, counts >> 16], axis=-1)
    levels = levels if coding == "rgb24" else levels[..., ::-1]
    assert np.abs(stored_map(tmp_path, levels, coding) - VALUES).max() < 2**-23


def test_the_bytes_of_a_float(tmp_path):
    metres = (100 * VALUES).astype(np.float32)
    levels = [[list(struct.pack("<f", value)) for value in row] for row in metres]
    assert (stored_map(tmp_path, levels, "rgba-float") == metres).all()


def test_the_fractions_of_shaders(tmp_path):
    levels = np.empty((*VALUES.shape, 4))
    rest = VALUES.copy()
    for channel in range(4):
        rest *= 255
        levels[..., channel] = np.floor(rest)
        rest -= levels[..., channel]
    assert np.abs(stored_map(tmp_path, levels, "rgba-fixed") - VALUES).max() < 1e-7


def test_too_few_channels_are_refused(tmp_path):
    with pytest.raises(ImageFileError, match="rgba-float needs 4 channels"):
        stored_map(tmp_path, np.zeros((2, 2, 3)), "rgba-float")
