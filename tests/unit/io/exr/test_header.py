import struct

import numpy as np
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.exr.header import Attribute, channel_sizes, is_exr, read_headers
from tests.unit.io.exr.exr_files import write_exr


@pytest.fixture
def exr(tmp_path):
    channels = {"R": ("half", np.zeros((3, 4))), "Z": ("float", np.zeros((3, 4)))}
    return write_exr(tmp_path / "a.exr", {"channels": channels, "attributes": {"focus": 2.5, "note": "ü"}})


def test_packing_gives_the_bytes_of_the_file_back(exr):
    headers = read_headers(exr)
    assert headers.pack() == exr.read_bytes()[: headers.end]
    assert not headers.multi_part


def test_values_are_found_by_name(exr):
    (attributes,) = read_headers(exr).parts
    assert attributes["focus"].value() == 2.5
    assert attributes["note"].value() == "ü"
    assert attributes["dataWindow"].value() == (0, 0, 3, 2)
    assert attributes["channels"].value() is None
    assert channel_sizes(attributes["channels"]) == {"R": 2, "Z": 4}


def test_rationals_are_divided_and_odd_lengths_are_nothing():
    assert Attribute("rational", struct.pack("<iI", 24000, 1001)).value() == 24000 / 1001
    assert Attribute("rational", struct.pack("<iI", 1, 0)).value() is None
    assert Attribute("float", b"123").value() is None


@pytest.mark.parametrize("kept", range(0, 300, 7))
def test_a_truncated_header_is_an_error(exr, kept):
    assert kept < read_headers(exr).end
    exr.write_bytes(exr.read_bytes()[:kept])
    with pytest.raises(ImageFileError, match="truncated or damaged"):
        read_headers(exr)


@pytest.mark.parametrize("length", [-1, 2**31 - 1])
def test_a_hostile_length_is_an_error(exr, length):
    data = exr.read_bytes()
    at = data.index(b"focus\0float\0") + len(b"focus\0float\0")
    exr.write_bytes(data[:at] + struct.pack("<i", length) + data[at + 4 :])
    with pytest.raises(ImageFileError, match="'focus'"):
        read_headers(exr)


def test_a_repeated_attribute_is_an_error(tmp_path):
    """ "OpenEXR File Layout": attribute names are unique within a header."""
    twice = b"focus\0float\0" + struct.pack("<if", 4, 1.0)
    (tmp_path / "a.exr").write_bytes(struct.pack("<2I", 20000630, 2) + 2 * twice + b"\0")
    with pytest.raises(ImageFileError, match="'focus' occurs twice"):
        read_headers(tmp_path / "a.exr")


def test_only_exr_files_are_exr(exr, tmp_path):
    (tmp_path / "b.exr").write_bytes(b"PNG")
    assert is_exr(exr)
    assert not is_exr(tmp_path / "b.exr")
