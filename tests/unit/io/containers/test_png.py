"""PNG files of our own making, read by other decoders."""

import zlib

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_array_equal

from bokehnet.io.containers import png
from bokehnet.io.containers.png import write_png


def pixels(dtype, shape):
    """A slope, which every filter shrinks, beside noise, which none does, and hard edges."""
    height, width, channels = shape
    rng = np.random.default_rng(0)
    y, x, c = np.mgrid[:height, :width, :channels]
    slope = (3 * x + 5 * y + 20 * c) * (np.iinfo(dtype).max // 1000)
    noise = rng.integers(0, np.iinfo(dtype).max, shape, endpoint=True)
    return np.where(x < width // 2, slope, np.where(y % 7 == 0, 0, noise)).astype(dtype)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 9, 1), (9, 1, 4), (50, 40, 1), (50, 40, 3), (50, 40, 4)])
@pytest.mark.parametrize("band", [1, 700, 2**20])
def test_every_pixel_comes_back_from_another_decoder(tmp_path, monkeypatch, dtype, shape, band):
    """Oracle: libpng; bands of one row, of a few, and of the whole picture."""
    monkeypatch.setattr(png, "_BAND_BYTES", band)
    stored = pixels(dtype, shape)
    path = tmp_path / "a.png"
    write_png(path, shape, dtype, stored.__getitem__)
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), hints)
    assert_array_equal(file.read_image(np.dtype(dtype).name).reshape(shape), stored)
    assert file.geterror() == ""


def test_the_stream_is_one_that_zlib_accepts_whole(tmp_path, monkeypatch):
    """RFC 1950: the checksum at the end is that of all bands; zlib checks it."""
    monkeypatch.setattr(png, "_BAND_BYTES", 500)
    stored = pixels(np.uint8, (40, 30, 3))
    path = tmp_path / "a.png"
    write_png(path, stored.shape, np.uint8, stored.__getitem__)
    data, stream, at = path.read_bytes(), b"", 8
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        if data[at + 4 : at + 8] == b"IDAT":
            stream += data[at + 8 : at + 8 + length]
        at += 12 + length
    assert len(zlib.decompress(stream)) == 40 * (1 + 30 * 3)


def test_the_same_pixels_make_the_same_file(tmp_path):
    stored = pixels(np.uint8, (300, 2000, 3))
    for name in ("a.png", "b.png"):
        write_png(tmp_path / name, stored.shape, np.uint8, stored.__getitem__)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_slopes_become_small(tmp_path):
    """A slope of constant steps: after any good filter all bytes are alike, a hundredth of the raw size."""
    y, x = np.mgrid[:200, :300]
    stored = np.dstack([(x + y) % 256] * 3).astype(np.uint8)
    write_png(tmp_path / "a.png", stored.shape, np.uint8, stored.__getitem__)
    assert (tmp_path / "a.png").stat().st_size < stored.nbytes / 100
