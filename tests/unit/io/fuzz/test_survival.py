"""Odd, hostile and extreme files: each is a picture or one clear line."""

import os

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.containers.input_checks import PIXEL_LIMIT_VARIABLE
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from tests.unit.io.exr.exr_by_hand import MIP, ONE, RIP, scan_lines, tiles
from tests.unit.io.exr.exr_files import write_exr

ALL = (".png", ".jpg", ".tif", ".webp", ".exr", ".hdr")


@pytest.mark.parametrize("extension", ALL)
@pytest.mark.parametrize("size", [(1, 1), (1, 37), (37, 1)])
def test_the_smallest_pictures_are_pictures(tmp_path, extension, size):
    image = np.broadcast_to(np.linspace(0, 1, max(size)).reshape(*size, 1), (*size, 3))
    path = tmp_path / f"a{extension}"
    write_image(path, image)
    frame = read_frame(path)
    assert_allclose(frame.image, image, atol=0.05)
    write_frame(path, frame, frame.image)
    assert_allclose(read_frame(path).image, image, atol=0.1)


@pytest.mark.parametrize("extension", [".png", ".jpg", ".tif", ".exr"])
@pytest.mark.parametrize("size", [(1, 1), (1, 37), (37, 1)])
def test_the_smallest_maps_are_maps(tmp_path, extension, size):
    write_image(tmp_path / f"a{extension}", np.full((*size, 3), 0.5))
    assert read_disparity(tmp_path / f"a{extension}").shape == size


@pytest.mark.parametrize("extension", [".png", ".jpg", ".tif", ".exr"])
@pytest.mark.parametrize("size", [(1, 65500), (65500, 1)])
def test_the_widest_pictures_are_pictures(tmp_path, extension, size):
    image = np.zeros((*size, 3), np.float32)
    image.reshape(-1, 3)[::1000] = 1
    path = tmp_path / f"a{extension}"
    write_image(path, image, quality=100)
    assert_allclose(read_image(path), image, atol=0.1)


@pytest.mark.parametrize(
    ("extension", "way_out"), [(".jpg", "65500"), (".webp", "16383"), (".hdr", "32767 .*; use .exr")]
)
def test_a_format_too_small_for_the_picture_names_its_limit(tmp_path, extension, way_out):
    with pytest.raises(ImageFileError, match=way_out):
        write_image(tmp_path / f"a{extension}", np.zeros((1, 70000, 3), np.float32))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("orientation", range(1, 9))
def test_picture_and_disparity_are_rotated_together(store, orientation):
    """A disparity map that the same phone wrote beside its picture."""
    y, x = np.mgrid[:16, :24]
    ramp = (5 * x + 8 * y).astype(np.uint8)
    picture = store("a.jpg", np.dstack([ramp] * 3), Orientation=orientation)
    disparity = store("a.png", ramp, Orientation=orientation)
    image, values = read_image(picture), read_disparity(disparity)
    assert image.shape[:2] == values.shape == ((24, 16) if orientation > 4 else (16, 24))
    # any other turn makes the correlation of these slopes small or negative
    assert np.corrcoef(image[..., 1].ravel(), values.ravel())[0, 1] > 0.9


def test_a_cmyk_jpeg_is_read_as_its_colours(tmp_path):
    """Oracle: Pillow's own conversion; both are the naive one, without a profile."""
    pillow = pytest.importorskip("PIL.Image")
    colours = [(255, 0, 0, 0), (0, 255, 0, 0), (0, 0, 255, 0), (0, 0, 0, 255), (0, 0, 0, 0)]
    stored = np.repeat(np.repeat(np.array([colours], np.uint8), 16, axis=0), 16, axis=1)
    picture = pillow.fromarray(stored, "CMYK")
    picture.save(tmp_path / "a.jpg", quality=100)
    expected = np.asarray(picture.convert("RGB")) / 255
    assert_allclose(read_image(tmp_path / "a.jpg"), expected, atol=0.05)


def test_a_transparent_palette_keeps_its_alpha(store_png):
    """ISO/IEC 15948, chunk tRNS: alpha of the palette's entries."""
    chunks = [(b"PLTE", bytes([255, 0, 0, 0, 0, 255])), (b"tRNS", bytes([51, 255]))]
    frame = read_frame(store_png("a.png", 2, 3, [[0, 1]], chunks))
    assert_allclose(frame.alpha, [[0.2, 1]], atol=1e-6)
    assert_allclose(frame.image, [[[0.2, 0, 0], [0, 0, 1]]], atol=1e-6)


@pytest.mark.parametrize("levels", [1, 2, 65535])
def test_sixteen_bit_grey_keeps_its_levels(store, levels):
    stored = (np.arange(6).reshape(2, 3) * levels % 65536).astype(np.uint16)
    spread = stored.astype(np.float64) - stored.min()
    expected = spread / spread.max()
    assert_allclose(read_disparity(store("a.png", stored)), expected, atol=1e-6)
    assert read_image(store("b.png", stored)).shape == (2, 3, 3)


def test_a_picture_larger_than_the_limit_is_refused_from_its_header(store_png, tmp_path, monkeypatch):
    """A bomb: 900 MP in a file of a hundred bytes, whose pixels are not even there."""
    path = store_png("a.png", 30000, 0, [b""] * 30000)
    with pytest.raises(ImageFileError, match=r"30000x30000 pixels.*limit of 200000000;.*BOKEHNET_MAX_PIXELS"):
        read_image(path)
    write_image(tmp_path / "b.exr", np.zeros((20, 30, 3)))
    monkeypatch.setenv(PIXEL_LIMIT_VARIABLE, "599")
    for read in (read_image, read_frame, read_disparity):
        with pytest.raises(ImageFileError, match="30x20 pixels are more than the limit of 599"):
            read(tmp_path / "b.exr")
    monkeypatch.setenv(PIXEL_LIMIT_VARIABLE, "6e2")
    assert read_image(tmp_path / "b.exr").shape == (20, 30, 3)
    monkeypatch.setenv(PIXEL_LIMIT_VARIABLE, "many")
    with pytest.raises(ParameterError, match=r"BOKEHNET_MAX_PIXELS: expected a number.*'many'"):
        read_image(tmp_path / "b.exr")


def test_a_raised_limit_does_not_make_up_pixels(store_png, monkeypatch):
    monkeypatch.setenv(PIXEL_LIMIT_VARIABLE, "1e10")
    path = store_png("a.png", 20000, 0, [b""] * 20000)
    with pytest.raises(ImageFileError, match=r"truncated or damaged|do not fit into memory"):
        read_image(path)


@pytest.mark.parametrize("name", ["-a.png", "--help.exr", "a b.jpg", "ä漢字🎈.tif", "%d.webp", "a\nb.png"])
def test_any_name_is_a_name(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    write_image(name, np.full((16, 16, 3), 0.5))
    frame = read_frame(name)
    write_frame(name, frame, frame.image)
    assert_allclose(read_image(name), 0.5, atol=0.01)
    assert os.listdir(tmp_path) == [name]


def test_a_negative_picture_is_a_picture(tmp_path):
    """Wide-gamut colours are negative in Rec.709."""
    image = np.full((4, 4, 3), -0.25, np.float32)
    write_image(tmp_path / "a.exr", image)
    assert_array_equal(read_image(tmp_path / "a.exr"), image)


def test_a_name_that_is_not_unicode_is_an_error_that_can_be_printed(tmp_path):
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xff.png")
    with pytest.raises(ImageFileError, match="not UTF-8; rename it") as caught:
        write_image(path, np.zeros((4, 4, 3)))
    str(caught.value).encode()
    write_image(tmp_path / "a.png", np.zeros((4, 4, 3)))
    os.rename(tmp_path / "a.png", path)
    with pytest.raises(ImageFileError, match="not UTF-8; rename it") as caught:
        read_image(path)
    str(caught.value).encode()


@pytest.mark.parametrize("progressive", [False, True])
def test_a_cut_jpeg_is_never_made_up(tmp_path, progressive):
    """Authority: ITU-T T.81: a file ends with the marker EOI; what follows it is no part of it."""
    pillow = pytest.importorskip("PIL.Image")
    rng = np.random.default_rng(0)
    picture = pillow.fromarray(rng.integers(0, 256, (40, 60, 3), dtype=np.uint8))
    picture.save(tmp_path / "a.jpg", progressive=progressive)
    data = (tmp_path / "a.jpg").read_bytes()
    for cut in rng.integers(2, len(data), 40):
        (tmp_path / "b.jpg").write_bytes(data[:cut])
        with pytest.raises(ImageFileError, match=r"truncated|damaged"):
            read_image(tmp_path / "b.jpg")
    (tmp_path / "c.jpg").write_bytes(data + b"more \xff\xd8 of something")
    assert_array_equal(read_image(tmp_path / "c.jpg"), read_image(tmp_path / "a.jpg"))


def test_an_exr_of_which_nothing_is_shown_is_black(tmp_path):
    rgb = {name: np.ones((4, 6), np.float32) for name in "RGB"}
    path = write_exr(
        tmp_path / "a.exr",
        {
            "channels": {name: ("half", array) for name, array in rgb.items()},
            "x": 20, "y": 3,"full_width": 10, "full_height": 8,
        },
    )  # fmt: skip
    frame = read_frame(path)
    write_frame(tmp_path / "b.png", frame, frame.image)
    assert_array_equal(read_image(tmp_path / "b.png"), np.zeros((8, 10, 3)))


@pytest.mark.parametrize("read", [read_image, read_frame, read_disparity])
@pytest.mark.parametrize("sampling", [{"Y": (1, 1)}, {"RY": (2, 2), "BY": (2, 2)}])
def test_luminance_and_chroma_are_not_taken_for_grey(tmp_path, read, sampling):
    names = ("Y", "RY", "BY")
    arrays = {name: ("half", np.full((4, 6), 0.5)) for name in names}
    (tmp_path / "a.exr").write_bytes(scan_lines(arrays, sampling))
    if read is read_disparity and "Y" in sampling:
        assert read(tmp_path / "a.exr").shape == (4, 6)  # of a map, luminance will do
        return
    with pytest.raises(ImageFileError, match=r"found .*RY.*; write R, G, B instead"):
        read(tmp_path / "a.exr")


@pytest.mark.parametrize("mode", [ONE, MIP, RIP])
def test_of_an_exr_with_levels_the_largest_is_the_picture(tmp_path, mode):
    """Authority: "OpenEXR File Layout", openexr.com, whose bytes the test writes by itself."""
    rng = np.random.default_rng(0)
    arrays = {name: ("half", rng.random((9, 13)).astype(np.float16)) for name in "RGB"}
    (tmp_path / "a.exr").write_bytes(tiles(arrays, 5, mode))
    expected = np.stack([arrays[name][1] for name in "RGB"], axis=-1)
    assert_array_equal(read_image(tmp_path / "a.exr"), expected)
