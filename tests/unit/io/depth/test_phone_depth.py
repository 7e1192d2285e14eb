import base64
import struct
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError, MissingExtraError
from bokehnet.io.color.color_space import convert
from bokehnet.io.color.icc import read_profile
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.formats.heif import is_heif
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import read_image
from bokehnet.io.phone_depth import read_phone_depth
from tests.unit.io.color import profiles
from tests.unit.io.depth import phone_files as files
from tests.unit.io.metadata.test_photo_metadata import exif

Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")

# A map of depths, mm; 16 bits, so that rounding is below 1e-4 of its range.
DEPTH = np.tile(np.geomspace(400, 6000, 16), (12, 1))
NEAR, FAR = 0.4, 6.0  # m
TOLERANCE = 2e-5  # of 1/mm over the range: half a step of 65535

MAP = np.tile(np.linspace(0, 255, 16).astype(np.uint8), (12, 1))
PNG = files.encode(MAP, "PNG")


def stored(depth_mm, form="RangeInverse"):
    """Google, Depth Map Metadata, "Encoding": d_n = far (d - near) / (d (far - near)), or linear in d."""
    depth, near, far = depth_mm / 1000, NEAR, FAR
    inverse = form == "RangeInverse"
    normal = far * (depth - near) / (depth * (far - near)) if inverse else (depth - near) / (far - near)
    return files.encode(np.rint(65535 * normal).astype(np.uint16), "PNG")


@pytest.fixture
def save(tmp_path):
    def write(content, name="photo.jpg"):
        (tmp_path / name).write_bytes(content)
        return tmp_path / name

    return write


@pytest.mark.parametrize("form", ["RangeInverse", "RangeLinear"])
@pytest.mark.parametrize(("units", "scale"), [("m", 1), ("mm", 1000)])
def test_gdepth_with_units_gives_inverse_millimetres(save, form, units, scale):
    photo = files.gdepth_photo(
        stored(DEPTH, form), near=NEAR * scale, far=FAR * scale, units=units, form=form, focus=1.5 * scale
    )
    depth = read_phone_depth(save(photo))
    assert depth.metric
    assert_allclose(depth.disparity, 1 / DEPTH, rtol=2e-4, atol=TOLERANCE / 400)
    assert depth.focus_distance == pytest.approx(1500)
    assert depth.all_in_focus is None


def test_gdepth_without_units_is_relative_and_near_is_large(save):
    """Photos of Lens Blur: near 11.9 and far 51.4 of an unknown unit, in focus at 18.5."""
    depth = read_phone_depth(save(files.gdepth_photo(PNG, near=11.851094, far=51.396980, focus=18.49026)))
    assert not depth.metric
    assert depth.focus_distance is None
    assert_allclose(depth.disparity, 1 - MAP / 255, atol=1e-6)
    inverse = 1 / np.array([18.49026, 51.396980, 11.851094])
    assert depth.focus_disparity == pytest.approx((inverse[0] - inverse[1]) / (inverse[2] - inverse[1]))


def test_relative_linear_depth_becomes_disparity_between_its_ends(save):
    result = read_phone_depth(save(files.gdepth_photo(PNG, near=1, far=4, form="RangeLinear")))
    depth = 1 + 3 * (MAP / 255)
    assert_allclose(result.disparity, (1 / depth - 0.25) / 0.75, atol=1e-6)


def test_gdepth_in_pieces_of_an_extended_packet_in_any_order(save):
    rng = np.random.default_rng(0)
    values = rng.integers(0, 65535, (300, 400), np.uint16)
    picture = files.encode(values, "PNG")
    assert len(picture) > 3 * 65535  # more than one segment
    for shuffle in (False, True):
        photo = files.extended_gdepth_photo(picture, shuffle=shuffle, near=NEAR, far=FAR, units="m")
        expected = 1 / (1000 * NEAR) + (1 / FAR - 1 / NEAR) / 1000 * values / 65535
        assert_allclose(read_phone_depth(save(photo)).disparity, expected, rtol=1e-5)


def test_base64_may_come_in_lines_and_without_padding(save):
    text = base64.encodebytes(PNG).decode().rstrip("\n=")
    body = (
        f'<rdf:Description {files.GDEPTH} GDepth:Format="RangeInverse" GDepth:Near="1" GDepth:Far="2">'
        f"<GDepth:Data>\n{text}\n</GDepth:Data></rdf:Description>"
    )
    photo = files.with_segments(files.photo(), files.STANDARD + files.packet(body))
    assert_allclose(read_phone_depth(save(photo)).disparity, 1 - MAP / 255, atol=1e-6)


def dynamic_photo(depth, packets, *appended):
    return files.with_segments(files.photo(), *packets) + b"".join([*appended[:-1], depth, *appended[-1:]])


def test_dynamic_depth_with_its_map_behind_the_picture(save):
    """Dynamic Depth 1.0: items in the order of the directory, padding behind each of them."""
    depth = stored(DEPTH)
    items = [
        {"Mime": "image/jpeg", "Length": 0, "Padding": 5, "DataURI": "primary_image"},
        {"Mime": "image/jpeg", "Length": 7, "Padding": 3, "DataURI": "other"},
        {"Mime": "image/png", "Length": len(depth), "DataURI": "android/depthmap"},
    ]
    xmp = files.packet(files.directory(items) + files.cameras(NEAR, FAR))
    photo = dynamic_photo(depth, [files.STANDARD + xmp], bytes(5), b"seven77", bytes(3), b"trailer")
    result = read_phone_depth(save(photo))
    assert result.metric
    assert result.focus_disparity is None
    assert_allclose(result.disparity, 1 / DEPTH, rtol=2e-4, atol=TOLERANCE / 400)


def test_dynamic_depth_of_newer_phones_with_the_unblurred_picture(save):
    """Items by semantic in the standard packet, cameras in the extended one."""
    depth = stored(DEPTH)
    original = files.photo(np.full((24, 32, 3), 200, np.uint8))
    items = [
        {"Mime": "image/jpeg", "Length": 0, "Semantic": "Primary"},
        {"Mime": "image/jpeg", "Length": len(original), "Semantic": "Original"},
        {"Mime": "image/png", "Length": len(depth), "Semantic": "Depth"},
        {"Mime": "image/png", "Length": 4, "Semantic": "Confidence"},
    ]
    guid, pieces = files.extended_payloads(files.packet(files.cameras(NEAR, FAR)), 300)
    note = f'<rdf:Description {files.NOTE} xmpNote:HasExtendedXMP="{guid}"/>'
    xmp = files.packet(files.directory(items, prefix="1.0/") + note)
    photo = dynamic_photo(depth, [files.STANDARD + xmp, *pieces], original, b"abcd")
    result = read_phone_depth(save(photo))
    assert_allclose(result.disparity, 1 / DEPTH, rtol=2e-4, atol=TOLERANCE / 400)
    assert_allclose(result.all_in_focus, np.full((24, 32, 3), srgb_to_linear(200 / 255)), atol=0.01)


@pytest.mark.parametrize(
    ("units", "form", "expected"),
    [
        ("Diopters", "RangeLinear", lambda s: (4 + (0.5 - 4) * s) / 1000),
        ("Diopters", "RangeInverse", lambda s: 1 / ((1 - s) / 4 + s / 0.5) / 1000),
        ("None", "RangeInverse", lambda s: 1 - s),
    ],
)
def test_dynamic_depth_in_dioptres_and_without_unit(save, units, form, expected):
    items = [{"Length": 0}, {"Length": len(PNG), "DataURI": "android/depthmap"}]
    xmp = files.packet(files.directory(items) + files.cameras(4, 0.5, units, form))
    depth = read_phone_depth(save(dynamic_photo(PNG, [files.STANDARD + xmp])))
    assert depth.metric == (units != "None")
    assert_allclose(depth.disparity, expected(MAP / 255), rtol=1e-5)


def test_lens_blur_keeps_the_unblurred_picture(save):
    original = files.photo(np.full((24, 32, 3), 60, np.uint8))
    depth = read_phone_depth(save(files.gdepth_photo(PNG, near=1, far=2, original=original)))
    assert_allclose(depth.all_in_focus, np.full((24, 32, 3), srgb_to_linear(60 / 255)), atol=0.01)


@pytest.mark.parametrize("orientation", [1, 2, 3, 4, 5, 6, 7, 8])
def test_the_map_is_turned_as_the_photo(save, orientation):
    """EXIF orientation, CIPA DC-008: one pixel of the map and of the photo, upright at the same place."""
    from bokehnet.io.image import read_image

    grey = np.zeros((12, 16), np.uint8)
    grey[0, 0] = 255  # far, stored upper left
    colour = np.zeros((96, 128, 3), np.uint8)
    colour[:8, :8] = 255
    jpeg = files.photo(colour, orientation)
    path = save(files.gdepth_photo(files.encode(grey, "PNG"), near=1, far=2, jpeg=jpeg, original=jpeg))
    depth = read_phone_depth(path)
    blocks = read_image(path)[4::8, 4::8, 0]
    assert_array_equal(depth.disparity < 0.5, blocks > 0.5)
    assert_array_equal(depth.all_in_focus, read_image(path))


@pytest.mark.parametrize(("accuracy", "metric"), [("absolute", True), ("relative", False)])
def test_apple_jpeg_has_its_disparity_in_a_second_picture(save, accuracy, metric):
    """AVDepthData: disparity in 1/m, near is bright."""
    grey = files.encode(np.full((16, 16), 51, np.uint8), "JPEG", quality=100)
    matte = files.with_segments(files.photo(), files.STANDARD + files.apple_xmp(0, 1, "portraiteffectsmatte"))
    second = files.with_segments(grey, files.STANDARD + files.apple_xmp(0.5, 3, accuracy=accuracy))
    depth = read_phone_depth(save(files.photo() + bytes(2) + matte + second))
    assert depth.metric is metric
    expected = (0.5 + 2.5 * 0.2) / 1000 if metric else 0.2
    assert_allclose(depth.disparity, np.full((16, 16), expected), rtol=0.02)


def test_apple_depth_is_inverted(save):
    grey = files.encode(np.full((16, 16), 51, np.uint8), "JPEG", quality=100)
    second = files.with_segments(grey, files.STANDARD + files.apple_xmp(1, 6, "depth", "absolute"))
    depth = read_phone_depth(save(files.photo() + second))
    assert_allclose(depth.disparity, np.full((16, 16), 1 / 2000), rtol=0.02)


@pytest.mark.parametrize(
    "content",
    [
        files.photo(),
        files.with_segments(files.photo(), files.STANDARD + files.packet("")),
        files.with_segments(files.photo(), b"Exif\0\0nonsense"),
        files.encode(MAP, "PNG"),
        files.photo() + files.photo(),
        files.with_segments(
            files.photo(),
            files.STANDARD
            + files.packet(files.directory([{"Length": 0}, {"Length": 9, "Semantic": "GainMap"}])),
        ),
    ],
    ids=["plain", "empty packet", "other segment", "png", "two pictures", "gain map alone"],
)
def test_a_photo_without_a_map_returns_none(save, content):
    assert read_phone_depth(save(content)) is None


def gdepth_with(attributes):
    body = f"<rdf:Description {files.GDEPTH} {attributes}/>"
    return files.with_segments(files.photo(), files.STANDARD + files.packet(body))


def raw_xmp(text):
    return files.with_segments(files.photo(), files.STANDARD + text)


def container(**fields):
    items = [{"Length": 0}, {"DataURI": "android/depthmap", **fields}]
    xmp = files.packet(files.directory(items) + files.cameras(NEAR, FAR))
    return dynamic_photo(PNG, [files.STANDARD + xmp])


GOOD = 'GDepth:Near="1" GDepth:Far="2" GDepth:Units="m" '
BOMB = b'<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;&x;">]><a>&y;</a>'
DAMAGED = {
    "not well-formed": (raw_xmp(b"<x:xmpmeta><broken></x:xmpmeta>"), "damaged"),
    "not XML": (raw_xmp(b"\x00\x01\x02 nonsense"), "damaged"),
    "empty": (raw_xmp(b""), "damaged"),
    "unknown encoding": (raw_xmp(b'<?xml version="1.0" encoding="moon"?><a/>'), "damaged"),
    "entities": (raw_xmp(BOMB), "document type"),
    "deep": (raw_xmp(b"<a>" * 5000 + b"</a>" * 5000), "nested"),
    "not base64": (gdepth_with(GOOD + 'GDepth:Data="@@@@"'), "base64"),
    "odd base64": (gdepth_with(GOOD + 'GDepth:Data="AAAAA"'), "base64"),
    "no data": (gdepth_with(GOOD + 'GDepth:Data=""'), "neither"),
    "not a picture": (gdepth_with(GOOD + 'GDepth:Data="aGVsbG8="'), "neither"),
    "truncated map": (files.gdepth_photo(PNG[:-30], near=1, far=2), "the depth map inside"),
    "colours": (
        files.gdepth_photo(files.encode(np.full((4, 4, 3), (255, 0, 0), np.uint8), "PNG"), near=1, far=2),
        "colours",
    ),
    "near beyond far": (files.gdepth_photo(PNG, near=3, far=2, units="m"), "0 < Near < Far"),
    "no range": (files.gdepth_photo(PNG, units="m"), "0 < Near < Far"),
    "no range, linear": (files.gdepth_photo(PNG, form="RangeLinear"), "0 < Near < Far"),
    "infinite, linear": (files.gdepth_photo(PNG, near=1, far="inf", form="RangeLinear"), "0 < Near < Far"),
    "near is no number": (files.gdepth_photo(PNG, near="close", far=2), "Near"),
    "near is NaN": (files.gdepth_photo(PNG, near="nan", far=2), "Near"),
    "format": (files.gdepth_photo(PNG, near=1, far=2, form="Sideways"), "Sideways"),
    "piece missing": (
        files.extended_gdepth_photo(PNG, size=50, drop=1, near=1, far=2),
        "gap",
    ),
    "last piece missing": (
        files.extended_gdepth_photo(PNG, size=50, drop=-1, near=1, far=2),
        "extended XMP",
    ),
    "beyond the end": (container(Length=len(PNG) + 1), "end of the file"),
    "far beyond the end": (container(Length=10**14), "end of the file"),
    "length is no number": (container(Length="many"), "Item:Length"),
    "negative length": (container(Length=-4), "Item:Length"),
    "endless length": (container(Length="9" * 5000), "Item:Length"),
    "apple range": (
        files.photo() + files.with_segments(files.photo(), files.STANDARD + files.apple_xmp("x", 1)),
        "FloatMinValue",
    ),
}


@pytest.mark.parametrize(("content", "words"), DAMAGED.values(), ids=DAMAGED.keys())
def test_damage_is_reported_in_one_line_that_names_the_photo(save, content, words):
    path = save(content)
    with pytest.raises(ImageFileError, match=words) as caught:
        read_phone_depth(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert "embedded" not in message  # the temporary file is nobody's business


def test_a_map_of_a_huge_declared_size_is_refused_before_it_is_decoded(save):
    """ITU-T T.81, B.2.2: height and width stand five bytes behind the marker of the frame."""
    grey = files.encode(MAP, "JPEG")
    at = grey.index(b"\xff\xc0") + 5
    bomb = grey[:at] + struct.pack(">HH", 60000, 60000) + grey[at + 4 :]
    with pytest.raises(ImageFileError, match=r"photo\.jpg: the depth map inside: .*60000|claims"):
        read_phone_depth(save(files.gdepth_photo(bomb, near=1, far=2, mime="image/jpeg")))


@pytest.mark.parametrize("name", ["missing.jpg", "folder"])
def test_a_missing_file_is_reported(tmp_path, name):
    (tmp_path / "folder").mkdir()
    with pytest.raises(ImageFileError, match=name):
        read_phone_depth(tmp_path / name)


def test_any_cut_of_a_photo_gives_a_map_or_a_clean_error(save):
    whole = container(Length=len(PNG))
    result = set()
    for length in range(1, len(whole), 37):
        try:
            read_phone_depth(save(whole[:length]))
        except ImageFileError as error:
            result.add(str(error))
    assert any("end of the file" in text for text in result)
    assert not any("\n" in text for text in result)


def mutated(content, rng):
    """Change, drop and insert bytes at a few random places."""
    content = bytearray(content)
    for _ in range(rng.integers(1, 6)):
        at, kind = int(rng.integers(len(content))), rng.integers(3)
        if kind == 0:
            content[at] = rng.integers(256)
        elif kind == 1:
            del content[at : at + int(rng.integers(1, 40))]
        else:
            content[at:at] = rng.bytes(int(rng.integers(1, 20)))
    return bytes(content)


def test_damaged_bytes_give_a_map_or_a_clean_error(save):
    seeds = [
        files.gdepth_photo(PNG, near=1, far=2, units="m"),
        files.extended_gdepth_photo(PNG, size=120, near=1, far=2),
        container(Length=len(PNG)),
        files.photo() + files.with_segments(files.photo(), files.STANDARD + files.apple_xmp(0.5, 3)),
    ]
    rng = np.random.default_rng(0)
    maps, result = 0, set()
    for index in range(600):
        try:
            depth = read_phone_depth(save(mutated(seeds[index % len(seeds)], rng)))
        except ImageFileError as error:
            result.add(str(error))
        else:
            maps += depth is not None
            assert depth is None or np.isfinite(depth.disparity).all()
    assert maps > 20
    assert len(result) > 20
    assert not any("\n" in text for text in result)


PICTURE = np.full((48, 64, 3), (200, 100, 50), np.uint8)
GREY = np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1))


@pytest.fixture(scope="module")
def heic():
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    return files.heic_with_auxiliary


@pytest.mark.parametrize(
    ("xmp", "metric", "low", "high"),
    [
        (files.apple_xmp(0.5, 3, accuracy="absolute"), True, 0.0005, 0.003),
        (files.apple_xmp(0.5, 3), False, 0, 1),
        (b"", False, 0, 1),
    ],
    ids=["absolute", "relative", "untold"],
)
def test_heic_disparity_is_near_bright(save, heic, xmp, metric, low, high):
    matte = files.apple_xmp(0, 1, "urn:com:apple:photo:2020:aux:hdrgainmap")
    depth = read_phone_depth(save(heic(PICTURE, GREY, xmp=matte + xmp), "a.heic"))
    assert depth.metric is metric
    assert_allclose(depth.disparity, low + (high - low) * GREY / 255, rtol=1e-5, atol=1e-9)


def test_an_hdr_gain_map_is_no_depth(save, heic):
    photo = heic(PICTURE, GREY, "urn:com:apple:photo:2020:aux:hdrgainmap")
    assert read_phone_depth(save(photo, "a.heic")) is None


def test_a_heic_picture_is_read_as_scene_linear_light(save, heic):
    path = save(heic(PICTURE, GREY), "a.heic")
    assert is_heif(path)
    image = read_image(path)
    assert image.dtype == np.float32
    expected = srgb_to_linear(np.array([200, 100, 50]) / 255)
    assert_allclose(image, np.broadcast_to(expected, (48, 64, 3)), atol=0.01)


def test_a_heic_picture_is_read_through_its_profile_and_keeps_its_metadata(tmp_path, heic):
    """An iPhone's colours: the values are those of Display P3."""
    pillow_heif = pytest.importorskip("pillow_heif")
    image = Image.fromarray(PICTURE)
    image.info["icc_profile"] = profiles.KNOWN["p3"]
    image.info["exif"] = b"Exif\0\0" + exif(orientation=1)
    pillow_heif.from_pillow(image).save(tmp_path / "a.heic", quality=-1, chroma=444)
    frame = read_frame(tmp_path / "a.heic")
    assert (frame.space.name, frame.bits) == ("Display P3", 8)
    assert_allclose(frame.image, srgb_to_linear(PICTURE / 255.0), atol=0.01)
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    written = Image.open(tmp_path / "out.jpg")
    assert written.info["icc_profile"] == profiles.KNOWN["p3"]
    assert written.getexif()[0x010F] == "Maker"


def test_a_heic_of_ten_bits_in_pq_is_light_above_white(tmp_path):
    """ITU-R BT.2100-2: the highest of 1024 levels is 10 000 cd/m^2, 49 times white."""
    pillow_heif = pytest.importorskip("pillow_heif")
    ramp = np.tile(np.linspace(0, 65535, 64).astype(np.uint16)[None, :, None], (48, 1, 3))
    pictures = pillow_heif.from_bytes(mode="RGB;16", size=(64, 48), data=ramp.tobytes())
    code = {"color_primaries": 9, "transfer_characteristics": 16, "matrix_coefficients": 9}
    pictures.save(tmp_path / "a.heic", quality=-1, chroma=444, full_range_flag=1, **code)
    frame = read_frame(tmp_path / "a.heic")
    assert (frame.space.name, frame.bits) == ("Rec. 2020 PQ", 16)
    assert_allclose(frame.image.max(), 10000 / 203, rtol=0.02)


@pytest.mark.parametrize("own", [True, False])
def test_the_original_comes_in_the_primaries_of_its_photo(save, own):
    """With a profile it is converted; without one it has that of the photo."""
    red = np.tile(np.array([200, 60, 50], np.uint8), (24, 32, 1))
    p3 = profiles.KNOWN["p3"]
    jpeg = files.encode(red, "JPEG", quality=95, icc_profile=p3)
    original = files.encode(
        red, "JPEG", quality=95, **({"icc_profile": profiles.KNOWN["adobe"]} if own else {})
    )
    depth = read_phone_depth(save(files.gdepth_photo(PNG, near=1, far=2, jpeg=jpeg, original=original)))
    space = read_profile(profiles.KNOWN["adobe"] if own else p3, "")
    light = space.decode(np.broadcast_to(red / np.float32(255), red.shape))
    expected = convert(light, space, read_profile(p3, ""))
    assert_allclose(depth.all_in_focus, expected, atol=0.015)


def test_a_damaged_heic_is_reported(save, heic):
    whole = heic(PICTURE, GREY)
    for length in [20, 200, 500, 700]:
        path = save(whole[:length], "a.heic")
        for read in (read_image, read_phone_depth):
            with pytest.raises(ImageFileError, match=r"a\.heic: [^\n]*$"):
                read(path)


def test_heic_without_the_extra_names_it(save, heic, monkeypatch):
    path = save(heic(PICTURE, GREY), "a.heic")
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(MissingExtraError, match=r"bokehnet\[heif\]"):
        read_phone_depth(path)
