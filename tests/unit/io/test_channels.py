import numpy as np
import pytest

from bokehnet.errors import ImageFileError, ShapeError
from bokehnet.io.channels import read_channels, write_channels
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_depth, read_map

RNG = np.random.default_rng(0)
CHANNELS = {
    name: RNG.normal(size=(5, 7)).astype(np.float32)
    for name in ("R", "G", "B", "all_in_focus.R", "all_in_focus.G", "all_in_focus.B", "normal.X", "normal.Z")
}


def test_all_channels_and_attributes_come_back_exactly(tmp_path):
    depth = np.full((5, 7), 2.5, np.float32)
    depth[0] = np.inf
    write_channels(tmp_path / "a.exr", {**CHANNELS, "Z": depth}, {"bokehnet:samples": "17"})
    channels = read_channels(tmp_path / "a.exr")
    assert set(channels.channels) == {*CHANNELS, "Z"}
    for name, values in CHANNELS.items():
        assert np.array_equal(channels.channels[name], values)
    assert np.array_equal(channels.channels["Z"], depth)
    assert channels.attributes["bokehnet:samples"] == "17"


def test_other_readers_find_picture_and_depth(tmp_path):
    write_channels(tmp_path / "a.exr", {**CHANNELS, "Z": np.full((5, 7), 2.5)})
    assert np.array_equal(read_image(tmp_path / "a.exr")[..., 1], CHANNELS["G"])
    assert np.array_equal(read_depth(tmp_path / "a.exr"), np.full((5, 7), 2500, np.float32))
    assert np.array_equal(read_map(tmp_path / "a.exr", "normal.X"), CHANNELS["normal.X"])


def test_wrong_sizes_and_other_formats_are_refused(tmp_path):
    with pytest.raises(ShapeError, match="one size"):
        write_channels(tmp_path / "a.exr", {"R": np.zeros((2, 3)), "G": np.zeros((3, 2))})
    with pytest.raises(ImageFileError, match=r"unknown extension '\.png'"):
        write_channels(tmp_path / "a.png", {"R": np.zeros((2, 3))})
    assert list(tmp_path.iterdir()) == []
