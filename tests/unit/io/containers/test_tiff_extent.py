"""Ends of TIFF files: as Pillow and OpenImageIO write them, classic and big, in strips and tiles."""

import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.tiff_extent import tiff_end
from bokehnet.io.image import read_image

Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")


def palette(path):
    pixels = np.random.default_rng(0).integers(0, 255, (40, 30), np.uint8)
    Image.fromarray(pixels).convert("P").save(path, compression="packbits")


def big(path):
    pixels = np.random.default_rng(0).integers(0, 255, (40, 30, 3), np.uint8)
    Image.fromarray(pixels).save(path, big_tiff=True)


def tiled(path):
    spec = oiio.ImageSpec(70, 50, 3, "uint16")
    spec.tile_width = spec.tile_height = 16
    spec.attribute("tiff:bigendian", 1)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec)
    for _ in range(2):
        output.write_image(np.random.default_rng(0).random((50, 70, 3)).astype(np.float32))
        output.open(str(path), spec, "AppendSubimage")
    output.write_image(np.random.default_rng(1).random((50, 70, 3)).astype(np.float32))
    output.close()


@pytest.mark.parametrize("make", [palette, big, tiled])
def test_whole_files_are_whole_and_cut_ones_are_refused(tmp_path, make):
    path = tmp_path / "a.tif"
    make(path)
    data, end = path.read_bytes(), tiff_end(path)
    assert len(data) // 2 < end <= len(data)
    read_image(path)
    cut = tmp_path / "cut.tif"
    cut.write_bytes(data[: end - 1])
    with pytest.raises(ImageFileError, match=r"cut\.tif: "):
        read_image(cut)


def test_a_cut_palette_is_not_made_up(tmp_path):
    path, cut = tmp_path / "a.tif", tmp_path / "cut.tif"
    palette(path)
    cut.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ImageFileError, match="TIFF file is truncated at byte"):
        read_image(cut)


@pytest.mark.parametrize("data", [b"", b"II*\0", b"no tiff at all", b"II*\0\xff\xff\xff\x7f"])
def test_what_is_no_whole_tiff_has_no_end(tmp_path, data):
    path = tmp_path / "a.tif"
    path.write_bytes(data)
    assert tiff_end(path) == 0


def test_pages_that_lead_in_a_circle_end(tmp_path):
    path = tmp_path / "a.tif"
    strip = struct.pack("<HHIHHHHIHH", 273, 3, 1, 100, 0, 279, 3, 1, 50, 0)
    path.write_bytes(b"II*\0" + struct.pack("<IH", 8, 2) + strip + struct.pack("<I", 8))
    assert tiff_end(path) == 150


@pytest.mark.parametrize("place", [2**62, 2**63, 2**64 - 1])
def test_a_page_beyond_every_file_does_not_exist(place, tmp_path):
    path = tmp_path / "a.tif"
    big(path)
    data = bytearray(path.read_bytes())
    struct.pack_into("<Q", data, 8, place)
    path.write_bytes(data)
    assert tiff_end(path) == 0
    with pytest.raises(ImageFileError):
        read_image(path)
