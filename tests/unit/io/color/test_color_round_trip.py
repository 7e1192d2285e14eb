"""Photographs in wide colours, read and written back, as LittleCMS shows them."""

import io
import sys

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError, MissingExtraError, ParameterError
from bokehnet.io.color.color_space import COLOR_SPACES
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.containers.png import png_chunks, write_png
from bokehnet.io.formats.output_format import OutputFormat
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import read_image, write_image
from bokehnet.io.info import image_info
from tests.unit.io.color import profiles

Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")
ImageCms = pytest.importorskip("PIL.ImageCms", reason="writes test files with Pillow")


@pytest.fixture
def photo():
    """A photograph whose values use all of their space, (96, 128, 3), 0 to 255."""
    from skimage.data import coffee

    levels = coffee()[60:252:2, 100:356:2].astype(float)
    vivid = levels.mean(axis=-1, keepdims=True) + 1.8 * (levels - levels.mean(axis=-1, keepdims=True))
    return np.clip(vivid, 0, 255).astype(np.uint8)


def lab(stored, profile):
    """CIE Lab of 8-bit values, as LittleCMS shows them."""
    original = ImageCms.ImageCmsProfile(io.BytesIO(profile))
    transform = ImageCms.buildTransform(
        original,
        ImageCms.createProfile("LAB"),
        "RGB",
        "LAB",
        ImageCms.Intent.RELATIVE_COLORIMETRIC,
        ImageCms.Flags.NOOPTIMIZE,
    )
    result = np.asarray(ImageCms.applyTransform(Image.fromarray(stored), transform))
    return np.dstack([result[..., 0] * (100 / 255), result[..., 1:].view(np.int8)]).astype(float)


def difference(first, first_profile, second, second_profile):
    from skimage.color import deltaE_ciede2000

    return deltaE_ciede2000(lab(first, first_profile), lab(second, second_profile))


def stored_values(path, kind="uint8"):
    file = oiio.ImageInput.open(str(path))
    values = file.read_image(kind)
    file.close()
    return values


@pytest.mark.parametrize("name", profiles.KNOWN)
@pytest.mark.parametrize("extension", ["png", "tif", "jpg", "webp"])
def test_profile_and_colours_are_kept(tmp_path, photo, name, extension):
    """JPEG and WebP are coded twice; their own loss is below one unit of CIEDE2000 in the mean."""
    profile = profiles.KNOWN[name]
    options = {"jpg": {"quality": 98, "subsampling": 0}, "webp": {"lossless": True}}.get(extension, {})
    Image.fromarray(photo).save(tmp_path / f"in.{extension}", icc_profile=profile, **options)
    frame = read_frame(tmp_path / f"in.{extension}")
    out = tmp_path / f"out.{extension}"
    write_frame(out, frame, frame.image, output_format=OutputFormat(quality=98))
    written = Image.open(out)
    assert written.info["icc_profile"] == profile
    before = np.asarray(Image.open(tmp_path / f"in.{extension}").convert("RGB"))
    after = np.asarray(written.convert("RGB"))
    if extension in ("png", "tif"):
        assert_array_equal(after, before)
    else:
        limit = 0.5 if extension == "jpg" else 3.0  # WebP halves the resolution of colours
        assert difference(before, profile, after, profile).mean() <= limit


@pytest.mark.parametrize(("name", "extension"), [("p3", "jpg"), ("adobe", "jpg"), ("prophoto", "tif")])
def test_real_photographs_come_back(shared, tmp_path, name, extension):
    """As a colour-managed viewer shows them, below half a unit of CIEDE2000 in the mean."""
    import tifffile

    stored = np.asarray(Image.open(shared("real/21.jpg")).convert("RGB"))[::2, ::2]
    path, profile = tmp_path / f"in.{extension}", profiles.KNOWN[name]
    if extension == "tif":
        deep = stored.astype(np.uint16) * 257
        tifffile.imwrite(path, deep, photometric="rgb", iccprofile=profile)
    else:
        Image.fromarray(stored).save(path, icc_profile=profile, quality=95, subsampling=0)
    frame = read_frame(path)
    write_frame(tmp_path / f"out.{extension}", frame, frame.image)
    before, after = (stored_values(tmp_path / f"{which}.{extension}") for which in ("in", "out"))
    assert difference(before, profile, after, profile).mean() <= 0.5
    assert read_frame(tmp_path / f"out.{extension}").space.icc == profile


@pytest.mark.parametrize("extension", ["png", "tif"])
def test_sixteen_bits_stay_sixteen(tmp_path, store, extension):
    import tifffile

    stored = np.random.default_rng(0).integers(0, 2**16, (40, 50, 3)).astype(np.uint16)
    profile = profiles.KNOWN["prophoto"]
    tifffile.imwrite(tmp_path / "in.tif", stored, photometric="rgb", iccprofile=profile)
    frame = read_frame(tmp_path / "in.tif")
    write_frame(tmp_path / f"out.{extension}", frame, frame.image)
    assert_array_equal(stored_values(tmp_path / f"out.{extension}", "uint16"), stored)
    assert read_frame(tmp_path / f"out.{extension}").space.icc == profile
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    assert read_frame(tmp_path / "out.jpg").bits == 8


@pytest.mark.parametrize("expected", ["srgb", "display-p3", "adobe-rgb", "prophoto"])
def test_other_colour_spaces_look_the_same(tmp_path, photo, expected):
    """From Adobe RGB colours: out of gamut they differ, so these stay near grey."""
    muted = (128 + 0.4 * (photo.astype(float) - 128)).astype(np.uint8)
    profile = profiles.KNOWN["adobe"]
    Image.fromarray(muted).save(tmp_path / "in.png", icc_profile=profile)
    frame = read_frame(tmp_path / "in.png")
    write_frame(
        tmp_path / "out.png",
        frame,
        frame.image,
        output_format=OutputFormat(color_space=expected, dither=False),
    )
    written = Image.open(tmp_path / "out.png")
    result = difference(muted, profile, np.asarray(written), written.info["icc_profile"])
    assert result.mean() <= 0.5
    assert read_frame(tmp_path / "out.png").space.name == COLOR_SPACES[expected].name


def test_read_image_gives_rec709_light(tmp_path, photo):
    """Against LittleCMS, where its 8 bits are not clipped."""
    profile = profiles.KNOWN["p3"]
    Image.fromarray(photo).save(tmp_path / "in.png", icc_profile=profile)
    light = read_image(tmp_path / "in.png")
    assert light.min() < -0.01  # colours that Rec.709 does not have
    transform = ImageCms.buildTransform(
        ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB"), "RGB", "RGB", 1
    )
    shown = np.asarray(ImageCms.applyTransform(Image.fromarray(photo), transform))
    inside = (light >= 0).all(axis=-1) & (light <= 1).all(axis=-1)
    assert_allclose(255 * linear_to_srgb(light[inside]), shown[inside], atol=1.5)


def test_a_frame_is_in_its_own_primaries_and_never_negative(tmp_path, photo):
    Image.fromarray(photo).save(tmp_path / "in.png", icc_profile=profiles.KNOWN["prophoto"])
    assert read_frame(tmp_path / "in.png").image.min() >= 0


def test_a_grey_profile_stays_grey_until_there_is_colour(tmp_path, photo):
    profile = profiles.grey_profile(profiles.gamma(1.8))
    for extension in ("png", "tif", "jpg"):
        Image.fromarray(photo[..., 0]).save(tmp_path / f"in.{extension}", icc_profile=profile)
        frame = read_frame(tmp_path / f"in.{extension}")
        write_frame(tmp_path / f"out.{extension}", frame, frame.image)
        written = Image.open(tmp_path / f"out.{extension}")
        assert (written.mode, written.info["icc_profile"]) == ("L", profile)
        before = np.asarray(Image.open(tmp_path / f"in.{extension}"))
        assert np.abs(np.asarray(written).astype(int) - before).mean() <= (1 if extension == "jpg" else 0)
    write_frame(tmp_path / "tinted.png", frame, frame.image * np.array([1, 0.9, 0.8], np.float32))
    tinted = read_frame(tmp_path / "tinted.png")
    assert_allclose(tinted.image, frame.image * [1, 0.9, 0.8], atol=0.01)


def test_hdr_code_points_come_back(tmp_path):
    """PQ in a PNG, W3C PNG third edition, 11.3.2.6: nothing is clipped on the way."""
    stored = np.random.default_rng(0).integers(0, 2**16, (20, 30, 3)).astype(np.uint16)
    code = [(b"cICP", bytes([9, 16, 0, 1]))]
    write_png(tmp_path / "in.png", stored.shape, np.uint16, stored.__getitem__, code)
    frame = read_frame(tmp_path / "in.png")
    assert frame.image.max() > 20  # white is 203 cd/m^2, the peak 10 000
    write_frame(tmp_path / "out.png", frame, frame.image)
    assert png_chunks(tmp_path / "out.png", (b"cICP", b"iCCP", b"sRGB")) == code
    assert_array_equal(stored_values(tmp_path / "out.png", "uint16"), stored)
    with pytest.raises(
        ImageFileError, match=r"\.jpg files cannot store colours of Rec\. 2020 PQ; write \.png"
    ):
        write_frame(tmp_path / "out.jpg", frame, frame.image)
    output_format = OutputFormat(color_space="display-p3")
    write_frame(tmp_path / "out.jpg", frame, frame.image, output_format=output_format)
    assert read_frame(tmp_path / "out.jpg").space.name == "Display P3"


def test_unknown_code_points_are_reported(tmp_path):
    write_png(
        tmp_path / "in.png", (1, 1, 3), np.uint8, np.zeros((1, 1, 3)).__getitem__, [(b"cICP", b"\7\1\0\1")]
    )
    with pytest.raises(ImageFileError, match=r"the code points 7 and 1 of ITU-T H\.273; convert"):
        read_image(tmp_path / "in.png")


@pytest.mark.parametrize(
    ("chunks", "exponent"),
    [
        ([(b"gAMA", (45455).to_bytes(4, "big"))], None),
        ([(b"gAMA", (100000).to_bytes(4, "big"))], 1),
        ([(b"gAMA", (55556).to_bytes(4, "big"))], 1.8),
        ([(b"gAMA", (100000).to_bytes(4, "big")), (b"sRGB", b"\0")], None),
    ],
)
def test_the_gamma_of_a_png_counts(tmp_path, chunks, exponent):
    """W3C PNG third edition, 11.3.2.2: gAMA is the exponent from light to samples; sRGB overrides it."""
    write_png(tmp_path / "a.png", (1, 1, 3), np.uint8, lambda rows: np.full((1, 1, 3), 128), chunks)
    light = read_image(tmp_path / "a.png")[0, 0, 0]
    assert_allclose(light, 0.21586 if exponent is None else (128 / 255) ** exponent, rtol=1e-3)


def test_the_primaries_of_a_png_count(tmp_path):
    xy = (0.3127, 0.3290, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06)  # P3, white first
    primaries = (b"cHRM", b"".join(round(100000 * value).to_bytes(4, "big") for value in xy))
    write_png(tmp_path / "a.png", (1, 1, 3), np.uint8, lambda rows: np.full((1, 1, 3), 128), [primaries])
    frame = read_frame(tmp_path / "a.png")
    assert frame.space.shares_primaries(COLOR_SPACES["display-p3"])
    write_frame(tmp_path / "b.png", frame, frame.image)
    assert read_frame(tmp_path / "b.png").space.shares_primaries(COLOR_SPACES["display-p3"])


def test_adobe_rgb_of_exif_is_used(tmp_path, photo):
    """JEITA CP-3461 (DCF): uncalibrated, and interoperability R03."""
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA001] = 65535
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    Image.fromarray(photo).save(tmp_path / "in.jpg", exif=exif)
    frame = read_frame(tmp_path / "in.jpg")
    assert frame.space is COLOR_SPACES["adobe-rgb"]
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    assert ImageCms.getProfileDescription(
        ImageCms.ImageCmsProfile(io.BytesIO(Image.open(tmp_path / "out.jpg").info["icc_profile"]))
    ).startswith("Adobe RGB")


def test_exr_of_a_p3_photograph_names_its_primaries(tmp_path, photo):
    Image.fromarray(photo).save(tmp_path / "in.png", icc_profile=profiles.KNOWN["p3"])
    frame = read_frame(tmp_path / "in.png")
    write_frame(tmp_path / "out.exr", frame, frame.image)
    file = oiio.ImageInput.open(str(tmp_path / "out.exr"))
    value = file.spec().getattribute("chromaticities")
    file.close()
    assert_allclose(value, [0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290], atol=5e-4)
    assert_allclose(read_frame(tmp_path / "out.exr").image, frame.image, rtol=1e-3, atol=1e-6)
    colors = read_image(tmp_path / "in.png")
    assert_allclose(read_image(tmp_path / "out.exr"), colors, rtol=1e-3, atol=2e-3)
    write_frame(tmp_path / "out.pfm", frame, frame.image)  # cannot tell primaries: Rec.709
    assert_array_equal(read_image(tmp_path / "out.pfm"), read_image(tmp_path / "in.png"))


def test_floating_point_tiff_is_linear_and_keeps_light_above_white(tmp_path):
    image = np.random.default_rng(0).uniform(-0.2, 5, (9, 8, 3)).astype(np.float32)
    write_image(tmp_path / "a.tif", image, bits="float")
    assert_array_equal(read_image(tmp_path / "a.tif"), image)
    frame = read_frame(tmp_path / "a.tif")
    write_frame(tmp_path / "b.tif", frame, frame.image)
    assert_array_equal(read_image(tmp_path / "b.tif"), image)
    write_image(tmp_path / "wide.tif", image, bits="float", color_space="prophoto")
    assert_allclose(read_image(tmp_path / "wide.tif"), image, atol=1e-3)
    assert read_frame(tmp_path / "wide.tif").space.is_linear


@pytest.mark.parametrize("bits", [8, 16, "half", "float"])
@pytest.mark.parametrize("expected", ["srgb", "display-p3"])
def test_jpeg_xl_where_it_is_there(tmp_path, bits, expected):
    if "jpegxl" not in oiio.get_string_attribute("format_list"):
        with pytest.raises(ImageFileError, match="JPEG XL is not written by the installed OpenImageIO"):
            write_image(tmp_path / "a.jxl", np.zeros((4, 4, 3)))
        return
    image = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    write_image(
        tmp_path / "a.jxl",
        image,
        alpha=image[..., 0],
        bits=bits,
        color_space=expected,
        quality=100,
        dither=False,
    )
    assert_allclose(read_image(tmp_path / "a.jxl"), image, atol=0.01 if bits == 8 else 1e-3)


def test_what_a_format_cannot_be_is_refused_in_one_line(tmp_path, monkeypatch):
    image = np.zeros((4, 4, 3))
    for name, options, reason in (
        ("a.jpg", {"bits": 16}, r"bits: expected 8 for \.jpg, got 16; write \.png or \.tif"),
        ("a.png", {"bits": 10}, r"bits: expected 8 or 16 for \.png, got 10; write \.heic"),
        ("a.avif", {"bits": 10}, r"bits: expected 8 for \.avif, got 10; write \.heic"),
        ("a.tif", {"bits": "half"}, r"expected 8 or 16 or float for \.tif, got half; write \.exr"),
        ("a.hdr", {"bits": 16}, "the format has its own"),
        ("a.hdr", {"color_space": "display-p3"}, "color_space: expected keep or srgb"),
        ("a.png", {"color_space": "cmyk"}, "color_space: expected one of"),
        ("a.jpg", {"subsampling": "1:1:1"}, "subsampling: expected one of"),
    ):
        with pytest.raises(ParameterError, match=reason):
            write_image(tmp_path / name, image, **options)
    for name, extra in (("a.avif", "avif"), ("a.heic", "heif")):
        monkeypatch.setitem(sys.modules, "PIL" if extra == "avif" else "pillow_heif", None)
        with pytest.raises(MissingExtraError, match=rf"{name}: to write .*'bokehnet\[{extra}\]', or write"):
            write_image(tmp_path / name, image)
    write_image(tmp_path / "a.exr", image)
    frame = read_frame(tmp_path / "a.exr")
    for expected in (OutputFormat(bits="float"), OutputFormat(color_space="srgb")):
        with pytest.raises(ParameterError, match="EXR from EXR, which keeps its own"):
            write_frame(tmp_path / "b.exr", frame, frame.image, output_format=expected)


def test_subsampling_is_that_of_the_file(tmp_path, photo):
    for target, expected in (("4:4:4", (1, 1)), ("4:2:2", (2, 1)), ("4:2:0", (2, 2))):
        write_image(tmp_path / "a.jpg", photo / 255.0, subsampling=target)
        layer = Image.open(tmp_path / "a.jpg").layer[0]
        assert layer[1:3] == expected


def test_the_same_picture_gives_the_same_bytes(tmp_path, photo):
    """Also where the time of writing could be stored."""
    for extension in ("tif", "jpg", "png", "webp"):
        for name in ("a", "b"):
            write_image(
                tmp_path / f"{name}.{extension}", photo / 300.0, dither=True, color_space="display-p3"
            )
        assert (tmp_path / f"a.{extension}").read_bytes() == (tmp_path / f"b.{extension}").read_bytes()


def test_info_names_the_colour_space(tmp_path, photo):
    Image.fromarray(photo).save(tmp_path / "a.png", icc_profile=profiles.KNOWN["p3"])
    assert image_info(tmp_path / "a.png").color_space == "Display P3"


def test_webp_of_the_best_quality_is_without_loss(tmp_path, photo):
    """At any other its colours have half the resolution, which costs more than a unit of CIEDE2000 here."""
    profile = profiles.KNOWN["p3"]
    Image.fromarray(photo).save(tmp_path / "a.png", icc_profile=profile)
    frame = read_frame(tmp_path / "a.png")
    differences = {}
    for quality in (95, 100):
        write_frame(tmp_path / "b.webp", frame, frame.image, output_format=OutputFormat(quality=quality))
        stored = stored_values(tmp_path / "b.webp")
        differences[quality] = difference(photo, profile, stored, profile).mean()
    assert differences[100] == 0
    assert differences[95] > 1
