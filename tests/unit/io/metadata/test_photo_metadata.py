"""EXIF and XMP on their way from a photograph to its blurred twin, read back by Pillow."""

import io
import struct
from xml.etree import ElementTree

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_array_equal

from bokehnet.io.containers.jpeg import APP1, insert_segments
from bokehnet.io.formats.output_format import OutputFormat
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import write_image
from bokehnet.io.metadata.exif import read_directory, refreshed_exif
from bokehnet.io.metadata.xmp import STANDARD_XMP
from tests.unit.io.color import profiles

Image = pytest.importorskip("PIL.Image", reason="writes test files with Pillow")
PngImagePlugin = pytest.importorskip("PIL.PngImagePlugin", reason="writes test files with Pillow")

HEIGHT, WIDTH = 24, 32
EXIF, GPS = 0x8769, 0x8825

GAIN_MAP = "http://ns.adobe.com/hdr-gain-map/1.0/"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
DEPTH = "http://ns.google.com/photos/1.0/depthmap/"


def packet(inside="", attributes=""):
    return (
        '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        'xmlns:tiff="http://ns.adobe.com/tiff/1.0/" xmlns:dc="http://purl.org/dc/elements/1.1/" '
        f'xmlns:xmp="http://ns.adobe.com/xap/1.0/" {attributes} tiff:Orientation="6" xmp:Rating="4">'
        f"<dc:creator><rdf:Seq><rdf:li>A &amp; Ü</rdf:li></rdf:Seq></dc:creator>{inside}</rdf:Description>"
        '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    ).encode()


def exif(order="<", orientation=6, thumbnail=b""):
    """EXIF of a camera, by hand, in either order of bytes: a note of the maker, GPS, a thumbnail."""
    data = bytearray((b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8))

    def directory(entries, following=0):
        """Append entries (tag, kind, count, content or number); return where their numbers lie."""
        start, places = len(data), {}
        body_start = start + 2 + 12 * len(entries) + 4
        table, body = struct.pack(f"{order}H", len(entries)), b""
        for tag, kind, count, content in entries:
            if isinstance(content, int):
                content = struct.pack(f"{order}{'H' if kind == 3 else 'I'}", content)
            places[tag] = start + len(table) + 8
            table += struct.pack(f"{order}HHI", tag, kind, count)
            if len(content) <= 4:
                table += content.ljust(4, b"\0")
            else:
                table += struct.pack(f"{order}I", body_start + len(body))
                body += content + bytes(len(content) % 2)
        places["next"] = start + len(table)
        data.extend(table + struct.pack(f"{order}I", following) + body)
        return places

    main = directory(
        [
            (0x010F, 2, 6, b"Maker\0"),
            (0x0112, 3, 1, orientation),
            (EXIF, 4, 1, 0),
            (GPS, 4, 1, 0),
        ]
    )
    struct.pack_into(f"{order}I", data, main[EXIF], len(data))
    directory(
        [
            (0x829A, 5, 1, struct.pack(f"{order}2I", 1, 125)),
            (0x927C, 7, 12, b"maker's note"),
            (0xA001, 3, 1, 65535),
            (0xA002, 4, 1, 4000),
            (0xA003, 4, 1, 3000),
        ]
    )
    struct.pack_into(f"{order}I", data, main[GPS], len(data))
    directory([(1, 2, 2, b"N\0"), (2, 5, 3, struct.pack(f"{order}6I", 48, 1, 30, 1, 0, 1))])
    if thumbnail:
        struct.pack_into(f"{order}I", data, main["next"], len(data))
        places = directory([(0x0201, 4, 1, 0), (0x0202, 4, 1, len(thumbnail))])
        struct.pack_into(f"{order}I", data, places[0x0201], len(data))
        data.extend(thumbnail)
    return bytes(data)


@pytest.fixture
def photo(tmp_path):
    """Write a photograph (HEIGHT, WIDTH) with these metadata."""

    def write(extension, xmp=None, **about):
        levels = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
        options = {"lossless": True} if extension == "webp" else {}
        if xmp is not None and extension == "png":
            options["pnginfo"] = PngImagePlugin.PngInfo()
            options["pnginfo"].add_itxt("XML:com.adobe.xmp", xmp.decode())
        elif xmp is not None:
            options["xmp"] = xmp
        path = tmp_path / f"in.{extension}"
        start = b"" if extension == "png" else b"Exif\0\0"
        Image.fromarray(levels).save(path, exif=start + exif(**about), **options)
        return path

    return write


def read_by_pillow(path):
    """Return the fields of EXIF, the packet of XMP, and the size."""
    image = Image.open(path)
    tags = image.getexif()
    fields, place = tags.get_ifd(EXIF), tags.get_ifd(GPS)
    results = {
        "orientation": tags.get(0x0112, 1),
        "maker": tags.get(0x010F),
        "exposure": float(fields[0x829A]),
        "latitude": [float(value) for value in place[2]],
        "width": fields.get(0xA002),
        "height": fields.get(0xA003),
        "space": fields.get(0xA001),
        "note": fields.get(0x927C),
    }
    xmp = image.info.get("xmp") or image.info.get("XML:com.adobe.xmp") or ""
    return results, xmp.encode() if isinstance(xmp, str) else xmp, image.size


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("source", ["jpg", "png", "webp"])
@pytest.mark.parametrize("target", ["jpg", "png", "webp", "tif"])
def test_exif_goes_along_upright(photo, tmp_path, order, source, target):
    frame = read_frame(photo(source, order=order))
    assert frame.image.shape == (WIDTH, HEIGHT, 3)  # orientation 6 is a quarter turn
    write_frame(tmp_path / f"out.{target}", frame, frame.image)
    result, _, size = read_by_pillow(tmp_path / f"out.{target}")
    assert size == (HEIGHT, WIDTH)
    note = result.pop("note")
    assert result == {
        "orientation": 1,
        "maker": "Maker",
        "exposure": 1 / 125,
        "latitude": [48, 30, 0],
        "width": HEIGHT,
        "height": WIDTH,
        "space": 65535,
    }
    assert note == (None if target == "tif" else b"maker's note")
    assert_array_equal(read_frame(tmp_path / f"out.{target}").image.shape, frame.image.shape)


@pytest.mark.parametrize("target", ["jpg", "png", "webp", "tif"])
def test_exif_of_a_tiff_goes_along(photo, tmp_path, target):
    frame = read_frame(photo("jpg"))
    write_frame(tmp_path / "middle.tif", frame, frame.image)
    frame = read_frame(tmp_path / "middle.tif")
    write_frame(tmp_path / f"out.{target}", frame, frame.image)
    result, _, _ = read_by_pillow(tmp_path / f"out.{target}")
    assert (result["maker"], result["exposure"], result["latitude"]) == ("Maker", 1 / 125, [48, 30, 0])


def test_a_tiff_written_with_metadata_is_a_tiff_to_others(photo, tmp_path):
    import tifffile

    frame = read_frame(photo("jpg", xmp=packet()))
    write_frame(tmp_path / "out.tif", frame, frame.image)
    with tifffile.TiffFile(tmp_path / "out.tif") as file:
        page = file.pages[0]
        assert page.tags["Make"].value == "Maker"
        assert page.tags["ExifTag"].value["ExposureTime"] == (1, 125)
        assert "DateTime" not in page.tags
        stored = page.asarray()
    other = oiio.ImageInput.open(str(tmp_path / "out.tif"))
    assert_array_equal(other.read_image("uint8"), stored)
    other.close()


def test_the_colour_space_of_exif_is_that_of_the_result(photo, tmp_path):
    """Kept colours keep their description, such as Adobe RGB in the EXIF of a camera."""
    path = photo("jpg")
    Image.open(path).save(path, exif=b"Exif\0\0" + exif(), icc_profile=profiles.KNOWN["adobe"])
    frame = read_frame(path)
    for expected, message in (("keep", 65535), ("srgb", 1), ("display-p3", 65535)):
        write_frame(
            tmp_path / "out.jpg", frame, frame.image, output_format=OutputFormat(color_space=expected)
        )
        assert read_by_pillow(tmp_path / "out.jpg")[0]["space"] == message


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_thumbnail_goes(photo, tmp_path, order):
    """It shows the picture as it was."""
    small = io.BytesIO()
    Image.new("RGB", (16, 12), (9, 99, 199)).save(small, "JPEG")
    before = exif(order, thumbnail=small.getvalue())
    after = refreshed_exif(before, 10, 20, is_srgb=False)
    assert read_directory(before)[1] > 0
    assert read_directory(after)[1] == 0
    assert small.getvalue() not in after
    assert len(after) <= len(before) - len(small.getvalue())


@pytest.mark.parametrize("source", ["jpg", "png", "webp"])
@pytest.mark.parametrize("target", ["jpg", "png", "webp", "tif"])
def test_xmp_goes_along_as_it_is_but_upright(photo, tmp_path, source, target):
    frame = read_frame(photo(source, xmp=packet()))
    assert frame.notes == ()
    write_frame(tmp_path / f"out.{target}", frame, frame.image)
    assert read_frame(tmp_path / f"out.{target}").metadata.xmp == packet().replace(
        b'Orientation="6"', b'Orientation="1"'
    )
    assert b"A &amp; \xc3\x9c" in read_by_pillow(tmp_path / f"out.{target}")[1]


@pytest.mark.parametrize(
    ("inside", "attributes"),
    [
        ("", f'xmlns:hdrgm="{GAIN_MAP}" hdrgm:Version="1.0" xmlns:GDepth="{DEPTH}" GDepth:Near="1"'),
        (f'<GDepth:Data xmlns:GDepth="{DEPTH}">AAAA</GDepth:Data>', ""),
        (f'<hdrgm:Max xmlns:hdrgm="{GAIN_MAP}"><rdf:Seq><rdf:li>1</rdf:li></rdf:Seq></hdrgm:Max>', ""),
    ],
)
def test_maps_that_no_longer_fit_go_and_are_reported(photo, tmp_path, inside, attributes):
    frame = read_frame(photo("jpg", xmp=packet(inside, attributes)))
    assert len(frame.notes) == 1
    assert frame.notes[0].startswith("its depth maps, gain maps and additional pictures do not match")
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    again = read_frame(tmp_path / "out.jpg")
    assert again.notes == ()
    for gone in (b"GDepth", b"hdrgm", GAIN_MAP.encode(), DEPTH.encode(), b"Data"):
        assert gone not in again.metadata.xmp
    root = ElementTree.fromstring(read_by_pillow(tmp_path / "out.jpg")[1])
    assert [item.text for item in root.iter(f"{{{RDF}}}li")] == ["A & Ü"]
    response = next(root.iter(f"{{{RDF}}}Description")).attrib
    assert response["{http://ns.adobe.com/xap/1.0/}Rating"] == "4"


def test_thumbnails_in_xmp_go(photo, tmp_path):
    small = "<xmp:Thumbnails><rdf:Alt><rdf:li>AAAA</rdf:li></rdf:Alt></xmp:Thumbnails>"
    frame = read_frame(photo("jpg", xmp=packet(small)))
    assert frame.notes == ()
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    assert b"AAAA" not in read_frame(tmp_path / "out.jpg").metadata.xmp


@pytest.mark.parametrize("damage", ["exif", "xmp"])
def test_damaged_metadata_are_skipped_with_a_notice(tmp_path, damage):
    write_image(tmp_path / "in.jpg", np.full((8, 8, 3), 0.5))
    segments = {
        "exif": b"Exif\0\0II*\0\xff\xff\0\0",
        "xmp": STANDARD_XMP + f'<x:xmpmeta xmlns:x="adobe:ns:meta/" xmlns:g="{GAIN_MAP}">'.encode(),
    }
    path = tmp_path / "in.jpg"
    path.write_bytes(insert_segments(path.read_bytes(), [(APP1, segments[damage])]))
    frame = read_frame(path)
    assert frame.notes == (f"its {damage.upper()} is damaged and omitted",)
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    assert read_frame(tmp_path / "out.jpg").metadata.exif is None


def test_the_picture_with_metadata_is_the_one_without(photo, tmp_path):
    """Pixels of a WebP with alpha and of all others are untouched by what is put beside them."""
    image = np.random.default_rng(1).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    alpha = np.linspace(0.2, 1, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH)
    frame = read_frame(photo("webp", xmp=packet(), orientation=1))
    for extension in ("webp", "png", "tif", "jpg"):
        write_frame(tmp_path / f"with.{extension}", frame, image * alpha[..., None], alpha)
        write_image(tmp_path / f"without.{extension}", image * alpha[..., None], alpha=alpha, dither=True)
        first, second = (read_frame(tmp_path / f"{name}.{extension}") for name in ("with", "without"))
        assert_array_equal(first.image, second.image)
        assert extension == "jpg" or np.array_equal(first.alpha, second.alpha)


def test_a_profile_of_many_segments_is_whole(tmp_path):
    """ICC.1:2022, annex B.4: pieces of 64 KB."""
    large = profiles.matrix_profile(profiles.P3, [profiles.table(np.linspace(0, 1, 30000))] * 3, "large")
    Image.new("RGB", (8, 8), (200, 100, 50)).save(tmp_path / "in.png", icc_profile=large)
    frame = read_frame(tmp_path / "in.png")
    write_frame(tmp_path / "out.jpg", frame, frame.image)
    assert Image.open(tmp_path / "out.jpg").info["icc_profile"] == large
