"""AVIF and HEIC as Pillow and libheif read them back, and JPEG XL's metadata, by hand from its boxes."""

import struct
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ImageFileError, MissingExtraError
from bokehnet.io.containers.jxl import jxl_boxes, jxl_with
from bokehnet.io.formats import whole_picture
from bokehnet.io.formats.heif import read_heif
from bokehnet.io.formats.output_format import OutputFormat
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import check_writable, read_image, write_image
from bokehnet.io.info import image_info
from bokehnet.io.metadata.exif import read_directory
from tests.unit.io.color import profiles
from tests.unit.io.metadata.test_photo_metadata import exif, packet

Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")
ImageOps = pytest.importorskip("PIL.ImageOps")

HEIGHT, WIDTH = 40, 56

pytest.importorskip("pillow_heif", reason="the extra heif is not installed")
if not (whole_picture._writes_avif() and whole_picture._writes_heic()):
    pytest.skip("the encoders are not built in", allow_module_level=True)


@pytest.fixture
def slope():
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([x / WIDTH, y / HEIGHT, (x + y) / (WIDTH + HEIGHT)], -1).astype(np.float32)


@pytest.fixture
def photo(tmp_path, slope):
    """A JPEG in Display P3, with EXIF and XMP."""
    path = tmp_path / "photo.jpg"
    levels = np.rint(255 * slope).astype(np.uint8)
    Image.fromarray(levels).save(
        path,
        quality=100,
        subsampling=0,
        icc_profile=profiles.KNOWN["p3"],
        exif=b"Exif\0\0" + exif(),
        xmp=packet(),
    )
    return path


def decoded(path):
    """Levels from 0 to 1, as stored, and the file's metadata, by a reader that is not ours."""
    if path.suffix == ".avif":
        with Image.open(path) as picture:
            return np.asarray(picture) / 255, picture.info
    import pillow_heif

    picture = pillow_heif.open_heif(path, convert_hdr_to_8bit=False)
    return np.asarray(picture) / (255 if picture.info["bit_depth"] == 8 else 1023 * 64), picture.info


@pytest.mark.parametrize("extension", [".avif", ".heic"])
def test_profile_and_metadata_go_along(photo, extension):
    frame = read_frame(photo)
    path = photo.with_name(f"out{extension}")
    write_frame(path, frame, frame.image)
    values, info = decoded(path)
    with Image.open(photo) as original:
        inputs = np.asarray(original) / 255
        upright = np.rot90(inputs, -1)  # orientation 6
    assert_allclose(values, upright, atol=0.02)
    assert info["icc_profile"] == profiles.KNOWN["p3"]
    directory, _ = read_directory(info["exif"].removeprefix(b"Exif\0\0"))
    assert directory[0x010F].values == b"Maker\0"
    assert 0x0112 not in directory or directory[0x0112].values == (1,)
    assert b"Rating" in info["xmp"]


@pytest.mark.parametrize(("extension", "bits"), [(".avif", 8), (".heic", 8), (".heic", 10)])
def test_values_are_those_of_the_picture(tmp_path, slope, extension, bits):
    path = tmp_path / f"a{extension}"
    write_image(path, slope**2.2, bits=bits, dither=False, quality=100)
    values, info = decoded(path)
    assert_allclose(values, _srgb(slope**2.2), atol=0.012)
    assert info.get("bit_depth", 8) == bits
    if extension == ".heic":
        assert read_heif(path).bits == bits
        assert_allclose(read_image(path), slope**2.2, atol=0.03)


def _srgb(light):
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("extension", [".avif", ".heic"])
def test_alpha_stays_straight(tmp_path, slope, extension):
    alpha = np.linspace(1, 0.25, WIDTH, dtype=np.float32) * np.ones((HEIGHT, 1), np.float32)
    write_image(tmp_path / f"a{extension}", slope * alpha[..., None], alpha=alpha, quality=100)
    values, _ = decoded(tmp_path / f"a{extension}")
    assert_allclose(values[..., 3], alpha, atol=0.02)
    assert_allclose(values[..., :3], _srgb(slope), atol=0.03)


@pytest.mark.parametrize("extension", [".avif", ".heic"])
def test_quality_and_subsampling_are_heard(tmp_path, extension):
    image = np.random.default_rng(0).random((64, 64, 3)).astype(np.float32)
    sizes = {}
    for quality, subsampling in ((95, "4:4:4"), (95, "4:2:0"), (40, "4:4:4")):
        path = tmp_path / f"{quality}{subsampling[-1]}{extension}"
        write_image(path, image, quality=quality, subsampling=subsampling)
        sizes[quality, subsampling] = path.stat().st_size
    assert sizes[95, "4:2:0"] < 0.8 * sizes[95, "4:4:4"]
    assert sizes[40, "4:4:4"] < 0.8 * sizes[95, "4:4:4"]


@pytest.mark.parametrize(("extension", "module"), [(".avif", "PIL"), (".heic", "pillow_heif")])
def test_without_the_encoder_one_line_names_the_way_out(tmp_path, monkeypatch, extension, module):
    monkeypatch.setattr(whole_picture, "_writes_avif", lambda: False)
    monkeypatch.setattr(whole_picture, "_writes_heic", lambda: False)
    with pytest.raises(ImageFileError, match=rf"the installed {module} has no encoder.*or write \.jxl"):
        check_writable(tmp_path / f"a{extension}")
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"pip install 'bokehnet\[.*or write \.jxl"):
        check_writable(tmp_path / f"a{extension}")


def test_jpeg_xl_carries_exif_and_xmp(photo):
    frame = read_frame(photo)
    path = photo.with_name("out.jxl")
    try:
        write_frame(path, frame, frame.image, output_format=OutputFormat(quality=100))
    except ImageFileError as error:
        pytest.skip(str(error))
    data, content = path.read_bytes(), {}
    position = 0
    while position < len(data):  # boxes: their length, their name
        length, name = struct.unpack_from(">I4s", data, position)
        content[name] = data[position + 8 : position + length]
        position += length or len(data)
    assert content[b"Exif"][:8] in (b"\0\0\0\0II*\0", b"\0\0\0\0MM\0*")
    assert b"Rating" in content[b"xml "]
    again = read_frame(path)
    assert_allclose(again.space.encode(again.image), frame.space.encode(frame.image), atol=0.03)
    assert_allclose(read_image(path), read_image(photo), atol=0.05)
    assert jxl_boxes(path) == {b"Exif": content[b"Exif"][4:], b"xml ": content[b"xml "]}


def test_bare_pixels_get_boxes_around_them(tmp_path):
    result = jxl_with(b"\xff\x0apixels", exif=b"II*\0", xmp=b"<x/>")
    (tmp_path / "a.jxl").write_bytes(result)
    assert jxl_boxes(tmp_path / "a.jxl") == {b"Exif": b"II*\0", b"xml ": b"<x/>"}
    assert result.endswith(b"\0\0\0\x10jxlc\xff\x0apixels")
    (tmp_path / "cut.jxl").write_bytes(result[:40])
    assert jxl_boxes(tmp_path / "cut.jxl") == {}


def test_an_encoder_that_fails_is_one_line(tmp_path, slope, monkeypatch):
    def fail(*arguments, **named):
        raise RuntimeError("no\nroom")

    monkeypatch.setattr(whole_picture, "_heic", fail)
    with pytest.raises(ImageFileError, match="cannot be written, any older file is kept: no room"):
        write_image(tmp_path / "a.heic", slope)
    assert not list(tmp_path.glob("*.heic"))


def test_photographs_in_avif_are_read(tmp_path, photo):
    """Authority: Pillow's decoder and ``exif_transpose``; ICC.1 profile of Display P3."""
    path = tmp_path / "a.avif"
    with Image.open(photo) as picture:
        picture.save(path, quality=90, **{k: picture.info[k] for k in ("exif", "icc_profile", "xmp")})
    frame = read_frame(path)
    with Image.open(path) as picture:
        upright = ImageOps.exif_transpose(picture)
    assert_allclose(frame.space.encode(frame.image), np.asarray(upright) / 255, atol=1e-3)
    assert "P3" in frame.space.name
    directory, _ = read_directory(frame.metadata.exif.removeprefix(b"Exif\0\0"))
    assert directory[0x010F].values == b"Maker\0"
    info = image_info(path)
    assert (info.file_format, info.pixel_type, info.height) == ("avif", "8 bits", frame.image.shape[0])
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(ImageFileError, match=r"damaged"):
        read_frame(path)


def test_pq_in_avif_is_decoded_by_its_code_points(tmp_path, slope):
    """Authority: ITU-T H.273, transfer 16 is PQ; SMPTE ST 2084: a code of .58 is 203 cd/m2, white."""
    path = tmp_path / "a.avif"
    Image.new("RGB", (16, 16), (148,) * 3).save(path, quality=100, subsampling="4:4:4")
    data = path.read_bytes()
    at = data.index(b"colrnclx") + 8
    path.write_bytes(data[:at] + b"\0\x09\0\x10" + data[at + 4 :])
    assert_allclose(read_image(path), 1, rtol=0.06)
