import os

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError, ParameterError, ShapeError
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.image import IMAGE_EXTENSIONS, check_writable, read_image, write_image, write_map

RNG_SEED = 0


def decode(values, top):
    """Light of integers by IEC 61966-2-1, in double precision."""
    return srgb_to_linear(np.asarray(values, dtype=np.float64) / top)


@pytest.mark.parametrize("name", ["a.png", "a.tif"])
@pytest.mark.parametrize(("dtype", "top"), [(np.uint8, 255), (np.uint16, 65535)])
def test_integers_are_read_by_the_iec_formula(store, name, dtype, top):
    stored = np.random.default_rng(RNG_SEED).integers(0, top, (5, 7, 3), dtype=dtype, endpoint=True)
    image = read_image(store(name, stored))
    assert image.dtype == np.float32
    assert_allclose(image, decode(stored, top), rtol=2e-6, atol=1e-9)


@pytest.mark.parametrize("extension", [".png", ".tif"])
@pytest.mark.parametrize(("bits", "top"), [(8, 255), (16, 65535)])
def test_every_stored_level_survives_reading_and_writing(tmp_path, extension, bits, top):
    """Exact: decoding a level and encoding it again must give the level back."""
    levels = np.arange(top + 1) if bits == 8 else np.arange(0, top + 1, 7)
    image = np.repeat(decode(levels, top)[None, :, None], 3, axis=2)
    path = tmp_path / f"a{extension}"
    write_image(path, image, bits=bits)
    again = linear_to_srgb(read_image(path).astype(np.float64)) * top
    assert_array_equal(np.rint(again[0, :, 0]), levels)


@pytest.mark.parametrize("extension", [".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp"])
def test_a_flat_colour_survives_every_srgb_format(tmp_path, extension):
    """A codec may be off by two levels, colour conversion included; half a level at this grey is 0.0019."""
    colour = np.array([0.2, 0.5, 0.7])
    path = tmp_path / f"a{extension}"
    write_image(path, np.broadcast_to(colour, (16, 16, 3)))
    back = linear_to_srgb(read_image(path))
    assert_allclose(back, np.broadcast_to(linear_to_srgb(colour), (16, 16, 3)), atol=2.5 / 255)


def test_srgb_files_are_clipped(tmp_path):
    write_image(tmp_path / "a.png", np.array([[[-1.0, 0.0, 50.0]]]))
    assert_array_equal(read_image(tmp_path / "a.png"), [[[0, 0, 1]]])


def test_exr_keeps_half_precision_and_the_range_of_half(tmp_path):
    """IEEE 754 binary16: 11 significant bits, largest value 65504."""
    image = np.random.default_rng(RNG_SEED).uniform(-50, 50, (9, 11, 3))
    image[0, 0] = [1e9, -1e9, 65504]
    write_image(tmp_path / "a.exr", image)
    back = read_image(tmp_path / "a.exr")
    assert_array_equal(back[0, 0], [65504, -65504, 65504])
    assert_array_equal(back[1:], image[1:].astype(np.float16).astype(np.float32))


def test_hdr_keeps_eight_bits_of_mantissa(tmp_path):
    """Ward, "Real pixels", 1991: one shared exponent, so errors are within 1/128 of the largest channel."""
    image = np.random.default_rng(RNG_SEED).uniform(0, 1000, (9, 11, 3))
    write_image(tmp_path / "a.hdr", image)
    error = np.abs(read_image(tmp_path / "a.hdr") - image) / image.max(axis=-1, keepdims=True)
    assert error.max() <= 1 / 128


def test_float_tiff_is_linear(store):
    stored = np.array([[[0.5, 2.0, -1.0]]], np.float32)
    assert_array_equal(read_image(store("a.tif", stored)), stored)


def test_grey_becomes_three_channels(store):
    image = read_image(store("a.png", np.array([[0, 188, 255]], np.uint8)))
    assert image.shape == (1, 3, 3)
    assert_allclose(image[0, 1], decode(188, 255), rtol=1e-6)


def test_straight_alpha_lays_the_picture_over_black(store, store_png):
    """Porter and Duff, "Compositing digital images", 1984: over black, light is colour times alpha."""
    stored = np.array([[[200, 100, 50, 128], [255, 255, 255, 0], [10, 20, 30, 255]]], np.uint8)
    expected = decode(stored[..., :3], 255) * stored[..., 3:] / 255
    files = [
        store("a.tif", stored, "RGBA", oiio__UnassociatedAlpha=1),
        store_png("a.png", 3, 6, [stored.ravel()]),
    ]
    for path in files:
        assert_allclose(read_image(path), expected, atol=1e-6)


def test_premultiplied_alpha_stays_the_light_it_is(store):
    stored = np.array([[[0.4, 0.2, 0.1, 0.5], [3.0, 0.0, 0.0, 0.0]]], np.float32)  # the second one glows
    assert_array_equal(read_image(store("a.exr", stored, "RGBA")), stored[..., :3])


def test_premultiplied_encoded_alpha_is_undone_decoded_and_applied(store):
    stored = np.array([[[100, 50, 25, 128], [0, 0, 0, 0]]], np.uint8)
    alpha = stored[..., 3:] / 255
    straight = stored[..., :3] / np.maximum(stored[..., 3:], 1)
    assert_allclose(read_image(store("a.tif", stored, "RGBA")), srgb_to_linear(straight) * alpha, atol=1e-6)


@pytest.mark.parametrize(
    ("channels", "picked"),
    [
        (["R", "G", "B", "Z"], [0, 1, 2]),
        (["View.R", "View.G", "View.B", "View.A"], [0, 1, 2]),
        (
            ["V.Combined.R", "V.Combined.G", "V.Combined.B", "V.DiffCol.R", "V.DiffCol.G", "V.DiffCol.B"],
            [0, 1, 2],
        ),
        (["Y", "Z"], [0, 0, 0]),
    ],
)
def test_exr_channels_are_picked_by_name(store, channels, picked):
    stored = np.broadcast_to(np.arange(1, len(channels) + 1, dtype=np.float32), (2, 2, len(channels)))
    image = read_image(store("a.exr", stored, channels))
    assert_array_equal(image[0, 0], np.array(picked) + 1)


def test_exr_colours_are_found_in_a_later_part(store_parts):
    path = store_parts(
        "a.exr", [(["Z"], np.full((2, 2, 1), 9.0)), (["R", "G", "B"], np.full((2, 2, 3), 0.25))]
    )
    assert_array_equal(read_image(path), np.full((2, 2, 3), 0.25))


@pytest.mark.parametrize("channels", [["Z"], ["X", "Q"], ["A1.R", "A1.G", "A1.B", "A2.R", "A2.G", "A2.B"]])
def test_exr_without_a_clear_picture_is_an_error_that_lists_what_is_there(store, channels):
    path = store("a.exr", np.zeros((2, 2, len(channels)), np.float32), channels)
    with pytest.raises(ImageFileError, match=channels[0].split(".")[0]):
        read_image(path)


def test_pixels_that_are_not_finite_are_counted(store):
    stored = np.zeros((4, 4, 3), np.float32)
    stored[0, 0, 0] = np.nan
    stored[1, 1] = np.inf
    with pytest.raises(ImageFileError, match=": 2 pixels"):
        read_image(store("a.exr", stored))


@pytest.mark.parametrize("extension", IMAGE_EXTENSIONS)
def test_a_full_disk_is_one_line_and_keeps_the_older_file(tmp_path, python_process, extension):
    """Left alone, the encoders crash, hang, end the process or leave half a file, by format."""
    path = tmp_path / f"a{extension}"
    write_image(path, np.zeros((60, 60, 3)))
    old = path.read_bytes()
    source = """
import resource, sys
import numpy as np
from bokehnet.errors import ImageFileError
from bokehnet.io.image import write_image
image = np.random.default_rng(0).random((60, 60, 3))
for limit in (0, 100, 5000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        write_image(sys.argv[1], image)
    except ImageFileError as error:
        sys.stdout.write(f"{error}\\n")
"""
    outcome = python_process(source, path, timeout=60)
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.count("cannot be written") == 3
    assert path.read_bytes() == old
    assert os.listdir(tmp_path) == [path.name]


def test_what_cannot_be_read_back_never_takes_the_name(tmp_path, monkeypatch):
    import bokehnet.io.formats.encode as module

    write_image(tmp_path / "a.tif", np.zeros((4, 4, 3)))
    old = (tmp_path / "a.tif").read_bytes()

    def cut_then_open(path, progress):
        path.write_bytes(path.read_bytes()[:-20])
        return original(path)

    original = module.ImageFile
    monkeypatch.setattr(module, "ImageFile", cut_then_open)
    with pytest.raises(ImageFileError, match="read back"):
        write_image(tmp_path / "a.tif", np.ones((4, 4, 3)))
    assert (tmp_path / "a.tif").read_bytes() == old
    assert os.listdir(tmp_path) == ["a.tif"]


def test_write_map_stores_values_without_a_curve(tmp_path):
    import OpenImageIO as oiio  # noqa: N813

    values = np.array([[-0.5, 0.0, 0.5, 1.0, 2.0]])
    write_map(tmp_path / "a.png", values)
    source = oiio.ImageInput.open(str(tmp_path / "a.png"))
    assert_array_equal(source.read_image("uint8").ravel(), [0, 0, 128, 255, 255])
    source.close()
    write_map(tmp_path / "a.exr", values * 1e7, channel="Z")
    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert source.spec().channelnames == ("Z",)
    assert_array_equal(source.read_image("float").ravel(), (values * 1e7).astype(np.float32).ravel())
    source.close()


def test_check_writable_reports_the_reason_and_touches_nothing(tmp_path):
    for path, reason in (
        (tmp_path / "a.xyz", r"'\.xyz'.*\.png.*\.exr"),
        (tmp_path / "a", "unknown extension ''"),
        (tmp_path / "nowhere" / "a.png", "does not exist"),
        (tmp_path, "found a folder"),
    ):
        with pytest.raises(ImageFileError, match=reason):
            check_writable(path)
    check_writable(tmp_path / "A.PNG")
    assert os.listdir(tmp_path) == []


def test_wrong_arguments_of_writing_are_refused(tmp_path):
    image = np.zeros((2, 2, 3))
    path = tmp_path / "a.jpg"
    with pytest.raises(ShapeError):
        write_image(path, image[..., :2])
    with pytest.raises(ParameterError, match="NaN"):
        write_image(path, image * np.nan)
    with pytest.raises(ParameterError, match="quality"):
        write_image(path, image, quality=0)
    with pytest.raises(ParameterError, match="bits"):
        write_image(path, image, bits=16)
    with pytest.raises(ImageFileError, match=r"'\.jpg', expected one of \.png, \.exr"):
        write_map(path, image[..., 0])
    assert os.listdir(tmp_path) == []


def test_higher_quality_makes_a_closer_jpeg(tmp_path):
    image = np.random.default_rng(RNG_SEED).random((32, 32, 3))
    errors = []
    for quality in (10, 100):
        write_image(tmp_path / "a.jpg", image, quality=quality)
        errors.append(np.abs(read_image(tmp_path / "a.jpg") - image).mean())
    assert errors[1] < 0.25 * errors[0]


def test_names_with_odd_characters_are_names(tmp_path):
    for name in ("a?b.png", "a b.exr", "ü#.jpg", "a%04d.png"):
        write_image(tmp_path / name, np.ones((2, 2, 3)))
        assert_allclose(read_image(tmp_path / name), 1, atol=0.01)
    assert len(os.listdir(tmp_path)) == 4


def test_real_pictures_are_read(shared):
    """Oracle: the 8-bit sRGB version of the same render, so equal within half a level where not clipped."""
    linear = read_image(shared("cycles/s1_still_life/image.exr"))
    encoded = read_image(shared("cycles/s1_still_life/image.png"))
    levels = np.abs(linear_to_srgb(np.clip(linear, 0, 1)) - linear_to_srgb(encoded)) * 255
    assert levels.max() <= 0.6


def test_the_same_picture_gives_the_same_exr_file(tmp_path):
    """capDate, which OpenEXR keeps for the time of writing, is left out."""
    write_image(tmp_path / "a.exr", np.ones((3, 4, 3)))
    assert b"capDate" not in (tmp_path / "a.exr").read_bytes()
