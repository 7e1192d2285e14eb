"""Portable float maps, against Pillow and files made by hand."""

import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from bokehnet.errors import ImageFileError
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.info import image_info
from bokehnet.io.maps import read_depth, read_map

GREY = np.array([[0.5, 2.0, -3.0], [1e-20, 7.0, 1e9]], np.float32)
COLOUR = np.arange(2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)


def by_hand(letters, values, scale):
    """The format as Debevec describes it: rows from the bottom upwards."""
    order = "<" if scale < 0 else ">"
    upwards = values[::-1].ravel()
    header = f"{letters}\n{values.shape[1]} {values.shape[0]}\n{scale}\n".encode()
    return header + struct.pack(f"{order}{upwards.size}f", *upwards)


@pytest.mark.parametrize("scale", [-1.0, 1.0, -0.003922])
def test_maps_are_read_in_both_orders_of_bytes(tmp_path, scale):
    """The size of the scale is not applied, only its sign is."""
    (tmp_path / "a.pfm").write_bytes(by_hand("Pf", GREY, scale))
    assert_array_equal(read_map(tmp_path / "a.pfm"), GREY)


@pytest.mark.parametrize("scale", [-1.0, 1.0])
def test_colour_is_linear_light(tmp_path, scale):
    (tmp_path / "a.pfm").write_bytes(by_hand("PF", COLOUR, scale))
    assert_array_equal(read_image(tmp_path / "a.pfm"), COLOUR)


def test_the_content_determines_the_format(tmp_path):
    (tmp_path / "depth.data").write_bytes(by_hand("Pf", np.abs(GREY), -1))
    assert_array_equal(read_depth(tmp_path / "depth.data", unit="mm"), np.abs(GREY))


def test_alpha_is_not_written(tmp_path):
    alpha = np.array([[0.5, 1, 0], [1, 0.25, 1]], np.float32)
    write_image(tmp_path / "a.exr", COLOUR, alpha=alpha)
    frame = read_frame(tmp_path / "a.exr")
    assert_array_equal(frame.alpha, alpha)
    write_frame(tmp_path / "a.pfm", frame, frame.image)
    assert (tmp_path / "a.pfm").read_bytes() == by_hand("PF", COLOUR, -1.0)


def test_pillow_reads_what_is_written(tmp_path):
    Image = pytest.importorskip("PIL.Image", reason="reads files with Pillow")  # noqa: N806

    values = np.random.default_rng(0).normal(size=(300, 5)).astype(np.float32)  # more rows than a band
    write_map(tmp_path / "a.pfm", values)
    assert_array_equal(np.asarray(Image.open(tmp_path / "a.pfm")), values)


def test_colour_is_written_as_requested(tmp_path):
    write_image(tmp_path / "a.pfm", COLOUR)
    assert (tmp_path / "a.pfm").read_bytes() == by_hand("PF", COLOUR, -1.0)
    info = image_info(tmp_path / "a.pfm")
    assert (info.file_format, info.color_space, info.pixel_type) == ("pfm", "linear", "float")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (by_hand("PF", COLOUR, -1)[:-1], "truncated: expected 82 bytes"),
        (b"PF\n3 2\n0\n" + bytes(72), "damaged header"),
        (b"PF4\n3 2\n-1\n" + bytes(96), "expected one of .*, found the format 'pnm'"),
        (b"PF\n3 2\nnan\n" + bytes(72), "damaged header"),
        (b"PF\n0 2\n-1\n" + bytes(72), "damaged header"),
        (b"PF\n3 two\n-1\n" + bytes(72), "damaged header"),
        (b"Pf\n999999999 999999999\n-1\n" + bytes(72), "truncated"),
    ],
)
def test_damage_is_reported(tmp_path, content, reason):
    (tmp_path / "a.pfm").write_bytes(content)
    with pytest.raises(ImageFileError, match=reason):
        read_image(tmp_path / "a.pfm")


def test_nan_is_reported(tmp_path):
    (tmp_path / "a.pfm").write_bytes(by_hand("PF", COLOUR * np.float32(np.nan), -1))
    with pytest.raises(ImageFileError, match="6 pixels are NaN"):
        read_image(tmp_path / "a.pfm")
