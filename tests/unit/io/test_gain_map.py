"""Gain maps in JPEG and HEIC files: written by these tests after the specifications, read back, and used."""

import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.containers.heif_items import tone_map_item
from bokehnet.io.frame import read_frame
from bokehnet.io.info import image_info
from bokehnet.io.metadata.gain_map import APPLE_ITEM, jpeg_gain_map
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import RelativeDisparity
from bokehnet.scene.scene import read_scene
from bokehnet.settings.settings import RenderSettings
from tests.unit.io.depth.phone_files import heic_with_auxiliary, heic_with_tone_map

HEIGHT, WIDTH = 64, 96
BRIGHT = 200  # stored value of the map where the window is
ISO = b"urn:iso:std:iso:ts:21496:-1\0"
LOW, HIGH, OFFSET = 0.0, 3.0, 1 / 64


def encoded(tmp_path, array, **attributes):
    path = tmp_path / "encoded.jpg"
    spec = oiio.ImageSpec(array.shape[1], array.shape[0], array.shape[2], "uint8")
    spec.attribute("Compression", "jpeg:100")
    for name, value in attributes.items():
        spec.attribute(name, value)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(array), output.geterror()
    assert output.close()
    return path.read_bytes()


def with_segment(jpeg, marker, payload):
    return jpeg[:2] + bytes([0xFF, marker]) + struct.pack(">H", len(payload) + 2) + payload + jpeg[2:]


def picture():
    """A dark room with a white window, 8-bit."""
    array = np.full((HEIGHT, WIDTH, 3), 60, np.uint8)
    array[16:48, 32:64] = 255
    return array


def stored_map(channels=1):
    """Map of half the size: 0 in the room, ``BRIGHT`` in the window."""
    array = np.zeros((HEIGHT // 2, WIDTH // 2, channels), np.uint8)
    array[8:24, 16:32] = BRIGHT
    return array


def ultra_hdr(high=HIGH, more=""):
    text = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:hdrgm="http://ns.adobe.com/hdr-gain-map/1.0/" hdrgm:Version="1.0" '
        f'hdrgm:GainMapMax="{high}" hdrgm:HDRCapacityMax="{high}" {more}/></rdf:RDF></x:xmpmeta>'
    )
    return 0xE1, b"http://ns.adobe.com/xap/1.0/\0" + text.encode()


def iso(high=HIGH, common=False, minimum=0, swapped=False):
    """Segment of ISO 21496-1, annex C.2: fractions over 64."""
    rows = [round(value * 64) for value in (LOW, high, 1, OFFSET, OFFSET)]
    headrooms = (192, 0) if swapped else (0, 192)
    head = struct.pack(">HHB", minimum, 0, 0x40 | (0x08 if common else 0))
    if common:
        return 0xE2, ISO + head + struct.pack(">III iiIii", 64, *headrooms, *rows)
    pairs = [number for row in rows for number in (row, 64)]
    heads = [number for headroom in headrooms for number in (headroom, 64)]
    return 0xE2, ISO + head + struct.pack(">IIII iIiIIIiIiI", *heads, *pairs)


def apple(headroom=None):
    named = f'HDRGainMap:HDRGainMapHeadroom="{headroom}"' if headroom is not None else ""
    text = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        '<rdf:Description xmlns:HDRGainMap="http://ns.apple.com/HDRGainMap/1.0/" '
        f'HDRGainMap:HDRGainMapVersion="65536" {named}/></rdf:RDF></x:xmpmeta>'
    )
    return 0xE1, b"http://ns.adobe.com/xap/1.0/\0" + text.encode()


def photo(tmp_path, segment, channels=1, primary=None):
    """A JPEG whose second picture is a gain map with a segment of metadata."""
    path = tmp_path / "photo.jpg"
    second = with_segment(encoded(tmp_path, stored_map(channels)), *segment)
    path.write_bytes((primary or encoded(tmp_path, picture())) + second)
    return path


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("segment", [ultra_hdr(), iso(), iso(common=True)], ids=["XMP", "ISO", "common"])
def test_light_follows_the_formula_of_the_specification(tmp_path, segment, channels):
    """Authority: (SDR + offset) 2^(low + (high - low) m) - offset, ISO 21496-1, 5.2."""
    frame = read_frame(photo(tmp_path, segment, channels))
    light = frame.gain_map.light(frame.image)
    expected = (1 + OFFSET) * 2 ** (HIGH * BRIGHT / 255) - OFFSET
    assert_allclose(light[30, 48], expected, rtol=0.01)
    assert_allclose(light[2, 2], frame.image[2, 2], rtol=0.01)


def test_gamma_and_values_of_channels_are_read(tmp_path):
    """Authority: as above, with m^(1 / gamma) and three maxima in an rdf:Seq."""
    items = "".join(f"<rdf:li>{value}</rdf:li>" for value in (1, 2, 3))
    text = ultra_hdr()[1].replace(f'hdrgm:GainMapMax="{HIGH}" '.encode(), b'hdrgm:Gamma="2" ')
    body = f"><hdrgm:GainMapMax><rdf:Seq>{items}</rdf:Seq></hdrgm:GainMapMax></rdf:Description>".encode()
    text = text.replace(b"/></rdf:RDF>", body + b"</rdf:RDF>")
    frame = read_frame(photo(tmp_path, (0xE1, text)))
    expected = (1 + OFFSET) * 2 ** (np.array([1, 2, 3]) * (BRIGHT / 255) ** 0.5) - OFFSET
    assert_allclose(frame.gain_map.light(frame.image)[30, 48], expected, rtol=0.01)


def maker_note(bright, dark):
    """Apple's maker note with tags 33 and 48, fractions over 1000; offsets count from its start."""
    start = 14 + 2 + 2 * 12 + 4
    entries = b"".join(
        struct.pack(">HHII", tag, 10, 1, start + 8 * number) for number, tag in enumerate((33, 48))
    )
    values = struct.pack(">iiii", round(bright * 1000), 1000, round(dark * 1000), 1000)
    return b"Apple iOS\0\0\1MM" + struct.pack(">H", 2) + entries + bytes(4) + values


def exif(note):
    """EXIF with a maker note, big-endian."""
    sub = 8 + 2 + 12 + 4
    inside = sub + 2 + 12 + 4
    directory = struct.pack(">HHHIII", 1, 0x8769, 4, 1, sub, 0)
    return (
        b"MM\0*" + struct.pack(">I", 8) + directory
        + struct.pack(">HHHIII", 1, 0x927C, 7, len(note), inside, 0) + note
    )  # fmt: skip


@pytest.mark.parametrize(
    ("bright", "dark", "stops"),
    [(0.5, 0.005, 1.7), (0.5, 0.1, 1.5909), (1.5, 0.005, 2.65), (1.5, 1.0, 2.0), (0.5, 20.0, 0.0)],
)
def test_headroom_of_apple_comes_from_the_maker_note(tmp_path, bright, dark, stops):
    """Authority: Apple, "Applying Apple HDR effect to your photos", worked out by hand."""
    primary = with_segment(encoded(tmp_path, picture()), 0xE1, b"Exif\0\0" + exif(maker_note(bright, dark)))
    frame = read_frame(photo(tmp_path, apple(), primary=primary))
    assert frame.gain_map.largest == pytest.approx(2**stops, rel=1e-6)
    expected = 1 + (2**stops - 1) * float(srgb_to_linear(np.float32(BRIGHT / 255)))
    assert_allclose(frame.gain_map.light(frame.image)[30, 48], expected, rtol=0.01)


def test_apple_map_of_a_heic_file(tmp_path):
    """Authority: as above, in an auxiliary picture."""
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    grey = np.full((HEIGHT // 2, WIDTH // 2), BRIGHT, np.uint8)
    xmp = apple(4.5)[1].partition(b"\0")[2]
    path = tmp_path / "photo.heic"
    path.write_bytes(heic_with_auxiliary(picture(), grey, APPLE_ITEM, xmp=xmp))
    frame = read_frame(path)
    expected = 1 + 3.5 * float(srgb_to_linear(np.float32(BRIGHT / 255)))
    assert_allclose(frame.gain_map.light(frame.image)[30, 48], expected, rtol=0.02)
    assert image_info(path).gain_map == "Apple HDR, 48 x 32 pixels, up to 4.5x white"
    path.write_bytes(heic_with_auxiliary(picture(), grey, APPLE_ITEM))
    assert read_frame(path).gain_map is None
    assert any(note.startswith("the gain map is ignored: ") for note in read_frame(path).notes)


def tone_map(segment, inputs=(1, 2), version=b"\0"):
    """A HEIC file with the metadata of a segment in its tone map item."""
    grey = np.full((HEIGHT // 2, WIDTH // 2), BRIGHT, np.uint8)
    return heic_with_tone_map(picture(), grey, version + segment[1].removeprefix(ISO), inputs)


def test_tone_map_item_of_a_heic_file(tmp_path):
    """Authority: ISO 21496-1, 5.2, with the gain map as a hidden picture that an item of metadata names."""
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    path = tmp_path / "photo.heic"
    path.write_bytes(tone_map(iso()))
    frame = read_frame(path)
    light = frame.gain_map.light(frame.image)
    assert_allclose(light[30, 48], (1 + OFFSET) * 2 ** (HIGH * BRIGHT / 255) - OFFSET, rtol=0.02)
    assert image_info(path).gain_map == "ISO 21496-1, 48 x 32 pixels, up to 8x white"
    assert not any("ignored" in note for note in frame.notes)


def _renamed(data, old, new):
    assert old in data
    return data.replace(old, new)


DAMAGED_ITEMS = {
    "metadata cut": lambda: tone_map((0xE2, iso()[1][:-3])),
    "future version": lambda: tone_map(iso(), version=b"\1"),
    "HDR base": lambda: tone_map(iso(swapped=True)),
    "no metadata": lambda: tone_map((0xE2, ISO)),
    "no gain map": lambda: tone_map(iso(), inputs=(1,)),
    "unknown gain map": lambda: tone_map(iso(), inputs=(1, 9)),
    "no inputs": lambda: _renamed(tone_map(iso()), b"dimg", b"dimh"),
    "file cut": lambda: tone_map(iso())[:-20],
    "a box of the wrong size": lambda: _renamed(tone_map(iso()), b"\0\0\0\x10dimg", b"\0\0\1\x10dimg"),
}


@pytest.mark.parametrize("make", DAMAGED_ITEMS.values(), ids=DAMAGED_ITEMS)
def test_damaged_tone_map_items_are_ignored(tmp_path, make):
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    path = tmp_path / "photo.heic"
    path.write_bytes(make())
    frame = read_frame(path)
    assert frame.gain_map is None
    assert_allclose(frame.image[30, 48], 1, rtol=0.02)
    ignored = [note for note in frame.notes if note.startswith("the gain map is ignored: ")]
    assert len(ignored) == 1


@pytest.mark.parametrize("seed", range(60))
def test_boxes_with_wrong_bytes_raise_nothing_else(seed):
    """Hostile files: ten random bytes of the boxes of a file are replaced."""
    pytest.importorskip("pillow_heif", reason="needs the extra heif")
    rng = np.random.default_rng(seed)
    data = bytearray(tone_map(iso()))
    end = data.index(b"mdat")
    for place in rng.integers(0, end, 10):
        data[place] = rng.integers(256)
    try:
        item = tone_map_item(bytes(data[: rng.integers(end // 2, len(data))] if seed % 2 else data))
    except ValueError:
        return
    assert item is None or len(item.metadata) < len(data)


def test_headroom_of_apple_in_xmp_is_preferred(tmp_path):
    assert read_frame(photo(tmp_path, apple(4.5))).gain_map.largest == 4.5


def test_the_map_turns_with_its_picture(tmp_path):
    array = picture()
    array[:, 64:] = 255
    primary = encoded(tmp_path, array, Orientation=6)
    frame = read_frame(photo(tmp_path, ultra_hdr(), primary=primary))
    light = frame.gain_map.light(frame.image)
    assert light.shape == (WIDTH, HEIGHT, 3)
    assert_allclose(light[48, 30], (1 + OFFSET) * 2 ** (HIGH * BRIGHT / 255) - OFFSET, rtol=0.01)


DAMAGED = {
    "no maximum": (0xE1, ultra_hdr()[1].replace(b"GainMapMax", b"GainMapMix")),
    "no number": ultra_hdr(high="much"),
    "NaN": ultra_hdr(high="nan"),
    "17 stops": ultra_hdr(high=17),
    "negative gamma": ultra_hdr(more='hdrgm:Gamma="-1"'),
    "HDR base": ultra_hdr(more='hdrgm:BaseRenditionIsHDR="True"'),
    "ISO cut": (0xE2, iso()[1][:-3]),
    "ISO of the future": iso(minimum=1),
    "ISO of an HDR base": iso(swapped=True),
    "ISO over zero": (0xE2, iso()[1].replace(struct.pack(">I", 64), bytes(4))),
    "Apple without headroom": apple(),
    "Apple with a huge headroom": apple(1000000),
    "Apple with words": apple("high"),
    "XML cut": (0xE1, ultra_hdr()[1][:-20]),
}


@pytest.mark.parametrize("segment", DAMAGED.values(), ids=DAMAGED)
def test_damaged_maps_are_ignored_with_a_notice(tmp_path, segment):
    path = photo(tmp_path, segment)
    with pytest.raises(ImageFileError):
        jpeg_gain_map(path, None)
    frame = read_frame(path)
    assert frame.gain_map is None
    assert any(note.startswith("the gain map is ignored: ") for note in frame.notes)
    assert "damaged" in image_info(path).gain_map


def test_a_map_without_pixels_is_ignored_with_a_notice(tmp_path):
    path = tmp_path / "photo.jpg"
    empty = with_segment(b"\xff\xd8\xff\xd9", *ultra_hdr())
    path.write_bytes(encoded(tmp_path, picture()) + empty)
    frame = read_frame(path)
    assert frame.gain_map is None
    assert any(note.startswith("the gain map is ignored: ") for note in frame.notes)
    assert frame.image.shape == (HEIGHT, WIDTH, 3)


def test_pictures_without_a_map_have_none(tmp_path):
    path = tmp_path / "plain.jpg"
    path.write_bytes(encoded(tmp_path, picture()) + encoded(tmp_path, stored_map()))
    assert jpeg_gain_map(path, None) is None
    assert read_frame(path).gain_map is None
    assert image_info(path).gain_map == ""


def test_info_describes_the_map(tmp_path):
    assert image_info(photo(tmp_path, ultra_hdr())).gain_map == "Ultra HDR, 48 x 32 pixels, up to 8x white"
    assert image_info(photo(tmp_path, iso())).gain_map == "ISO 21496-1, 48 x 32 pixels, up to 8x white"


def test_a_render_uses_the_map_instead_of_the_estimate(tmp_path):
    """Truth: the render of the light itself. In focus the picture stays as the camera stored it."""
    path = photo(tmp_path, ultra_hdr())
    near = np.zeros((HEIGHT, WIDTH), np.float32)
    near[:, :16] = 1
    changes = {"camera": {"blur": 6}, "focus": {"value": 1.0}, "depth": {"repair": "off"}}
    settings = RenderSettings().updated(changes)
    scene = read_scene(path, settings, source=RelativeDisparity(map=near))
    renderer = BokehRenderer("scatter")
    focused = renderer.prepare(scene, settings)
    assert "by the Ultra HDR gain map" in focused.light
    light = scene.frame.gain_map.light(scene.frame.image)
    assert_allclose(focused.image[30, 48], light[30, 48], rtol=1e-4)
    assert_array_equal(focused.image[:, :16], scene.image[:, :16])
    off = renderer.prepare(scene, settings.updated({"highlights": {"threshold": "off"}}))
    assert_array_equal(off.image, scene.image)
