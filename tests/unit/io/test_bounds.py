"""Upper bounds of what a file claims, held before memory and time are spent.

Authority: the documented bounds of SECURITY.md. The files claim far more than they hold, so that a test whose
bound fails runs out of its memory or time limit.
"""

import os
import signal
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from bokehnet.errors import ImageFileError
from bokehnet.io.containers.jpeg import jpeg_segments
from bokehnet.io.containers.tiff_extent import tiff_end
from bokehnet.io.exr.deep import flatten
from bokehnet.io.exr.deep_chunks import DeepSamples
from bokehnet.io.formats.heif import _packets
from bokehnet.io.info import image_info
from bokehnet.io.metadata.exif import read_directory
from bokehnet.io.metadata.xmp import parse_xmp
from bokehnet.io.pixels import ImageFile

resource = pytest.importorskip("resource", reason="needs resource limits of the system")

MAX_SECONDS, MAX_BYTES = 20, 2**30


@pytest.fixture(autouse=True)
def limited():
    """At most 20 s of processor time, and 1 GiB more address space, for each test."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * os.sysconf("SC_PAGE_SIZE") + MAX_BYTES, before[1]))

    def too_long(*_):
        raise AssertionError(f"took over {MAX_SECONDS} s")

    earlier = signal.signal(signal.SIGVTALRM, too_long)
    signal.setitimer(signal.ITIMER_VIRTUAL, MAX_SECONDS)
    yield
    signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    signal.signal(signal.SIGVTALRM, earlier)
    resource.setrlimit(resource.RLIMIT_AS, before)


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width, height, *chunks, pixels=b""):
    """A PNG file, 8 bits RGB."""
    header = struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)
    body = b"".join(chunk(kind, content) for kind, content in chunks)
    data = pixels or zlib.compress(bytes(height * (1 + 3 * width)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def attribute(name, kind, content):
    return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(content)) + content


def channel(name, kind=2):
    return name + b"\0" + struct.pack("<iB3xii", kind, 0, 1, 1)


def exr(channels, width=1, height=1, extra=b"", flags=2):
    """Header of an EXR file."""
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    return (
        b"\x76\x2f\x31\x01"
        + struct.pack("<I", flags)
        + attribute("channels", "chlist", b"".join(map(channel, channels)) + b"\0")
        + attribute("compression", "compression", b"\2")
        + attribute("dataWindow", "box2i", box)
        + attribute("displayWindow", "box2i", box)
        + attribute("lineOrder", "lineOrder", b"\0")
        + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
        + attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
        + attribute("screenWindowWidth", "float", struct.pack("<f", 1))
        + extra
        + b"\0"
    )


def deep_exr(samples, rows=1, names=(b"A", b"B", b"G", b"R", b"Z")):
    """A deep file of one column with so many samples of zeros in each pixel."""
    extra = attribute("type", "string", b"deepscanline") + attribute("version", "int", struct.pack("<i", 1))
    extra += attribute("maxSamplesPerPixel", "int", struct.pack("<i", samples))
    extra += attribute("chunkCount", "int", struct.pack("<i", rows))
    header = exr(names, 1, rows, extra, 2 | 0x800)
    size = samples * len(names) * 4
    packer = zlib.compressobj(9)
    packed = packer.compress(b"\0" + b"\x80" * min(size - 1, 2**20 - 1))
    for start in range(2**20, size, 2**20):
        packed += packer.compress(b"\x80" * min(2**20, size - start))
    packed += packer.flush()
    counts = struct.pack("<i", samples)
    start, body, offsets = len(header) + 8 * rows, b"", []
    for row in range(rows):
        offsets.append(start + len(body))
        body += struct.pack("<i3Q", row, len(counts), len(packed), size) + counts + packed
    return header + struct.pack(f"<{rows}Q", *offsets) + body


def refused(tmp_path, name, content, match):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ImageFileError, match=match) as caught:
        image_info(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("samples", "rows"), [(20_000_000, 1), (3_000_000, 8), (60_000, 500)])
def test_deep_samples_in_proportion_to_the_file(tmp_path, samples, rows):
    refused(tmp_path, "a.exr", deep_exr(samples, rows), r"expected at most \d+ deep samples")


def test_deep_samples_of_a_pixel(tmp_path):
    refused(tmp_path, "a.exr", deep_exr(2**16 + 1), "65536 deep samples in a pixel")


def test_overlaps_take_time_in_proportion_to_the_samples():
    """Sixty thousand volumes of one pixel that all overlap; coverage is 1 - (1 - a)^n by Beer-Lambert."""
    count, alpha = 60_000, 1e-5
    rng = np.random.default_rng(0)
    values = {"Z": 1 + rng.random(count), "ZBack": 3 + rng.random(count), "A": np.full(count, alpha)}
    values["R"] = 0.5 * values["A"]
    values = {name: array.astype(np.float32) for name, array in values.items()}
    flat = flatten(DeepSamples(counts=np.array([[count]]), values=values), ["R"])
    expected = 1 - (1 - float(np.float32(alpha))) ** count
    np.testing.assert_allclose(flat.coverage[0, 0], expected, rtol=1e-5)
    np.testing.assert_allclose(flat.light[0, 0, 0], 0.5 * expected, rtol=1e-4)


@pytest.mark.parametrize("count", [5000, 200_000])
def test_channels(tmp_path, count):
    names = [b"c%06d" % number for number in range(count)]
    refused(tmp_path, "a.exr", exr(names) + bytes(1000), "expected at most 4096 channels")


def test_attributes_and_parts(tmp_path):
    many = b"".join(attribute(f"a{number}", "int", bytes(4)) for number in range(100_000))
    refused(tmp_path, "a.exr", exr([b"R", b"G", b"B"], extra=many), "expected at most 8192 attributes")
    part = b"".join([attribute("name", "string", b"x"), attribute("type", "string", b"scanlineimage"), b"\0"])
    content = b"\x76\x2f\x31\x01" + struct.pack("<I", 2 | 0x1000) + part * 600 + b"\0"
    refused(tmp_path, "b.exr", content, "expected at most 512 parts")


@pytest.mark.parametrize("kind", [b"zTXt", b"iCCP", b"iTXt"])
@pytest.mark.parametrize("count", [1, 40])
def test_packed_texts_of_png(tmp_path, kind, count):
    packed = zlib.compress(bytes(2**27 // count), 9)
    head = b"XML:com.adobe.xmp\0" + (b"\1\0\0\0" if kind == b"iTXt" else b"\0")
    content = png(8, 8, *[(kind, head + packed)] * count)
    refused(tmp_path, "a.png", content, "of texts and profile once unpacked")


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"<x>" + b"<a/>" * 3_000_000 + b"</x>", "tags"),
        (b"<x " + b" ".join(b'a%d="1"' % number for number in range(300_000)) + b"/>", "attributes"),
        (b"<x " + b" ".join(b'xmlns:a%d="u"' % number for number in range(50_000)) + b"/>", "namespaces"),
        (b"<a>" * 10_000, "nested"),
        (b" " * (2**27 + 1), "bytes of XMP"),
    ],
)
def test_xmp(content, match):
    with pytest.raises(ImageFileError, match=match):
        parse_xmp("a.png", content)


def test_packets_are_found_in_one_pass():
    starts = b"<x:xmpmeta" * 400_000
    assert list(_packets(starts)) == []
    assert list(_packets(starts + b"</x:xmpmeta>" + b"<x:xmpmeta></x:xmpmeta>")) == [
        starts + b"</x:xmpmeta>",
        b"<x:xmpmeta></x:xmpmeta>",
    ]


def test_segments_and_fill_bytes_of_jpeg(tmp_path):
    path = tmp_path / "a.jpg"
    path.write_bytes(b"\xff\xd8" + b"\xff" * 20_000_000 + b"\xe1\0\4ab" + b"\xff\xda\0\2")
    assert jpeg_segments(path) == [(0xE1, b"ab")]
    path.write_bytes(b"\xff\xd8" + b"\xff\xe1\0\2" * 5_000_000)
    assert len(jpeg_segments(path)) == 10_000


def test_directories_of_exif():
    """Two thousand pointers to the same directory, three levels deep, and values that share their bytes."""
    pointer = struct.pack("<HHII", 0x8769, 4, 1, 8)
    data = b"II*\0" + struct.pack("<IH", 8, 2000) + pointer * 2000 + bytes(4)
    directory, _ = read_directory(data)
    assert list(directory) == [0x8769]
    large = struct.pack("<HHII", 0x010E, 2, 2**20, 8)
    data = b"II*\0" + struct.pack("<IH", 8, 2000) + large * 2000 + bytes(2**21)
    with pytest.raises(ValueError, match="bytes"):
        read_directory(data)


def test_overlapping_pages_of_tiff(tmp_path):
    """Each page begins two bytes after the previous one and has 4096 fields."""
    path = tmp_path / "a.tif"
    content = bytearray(2**20)
    content[:8] = struct.pack("<2sHI", b"II", 42, 8)
    for page in range(2000):
        start = 8 + 2 * page
        content[start : start + 2] = struct.pack("<H", 4096)
        content[start + 2 + 12 * 4096 : start + 6 + 12 * 4096] = struct.pack("<I", start + 2)
    path.write_bytes(content)
    assert tiff_end(path) >= 0


@pytest.mark.parametrize(
    ("width", "height"), [(14000, 14000), (9000, 9000), (100_000_000, 1), (2**31 - 1, 2)]
)
def test_pixels_in_proportion_to_the_file(tmp_path, width, height):
    refused(
        tmp_path, "a.png", png(width, height, pixels=zlib.compress(bytes(1000))), "PNG|more than the limit"
    )


def test_an_empty_mask_of_many_pixels_is_read(tmp_path):
    """24 million pixels in a few kilobytes, as masks have."""
    content = png(6000, 4000)
    assert len(content) < 200_000
    (tmp_path / "a.png").write_bytes(content)
    with ImageFile(tmp_path / "a.png") as file:
        assert file.parts[0].width == 6000


def test_the_environment_lifts_the_bound_of_small_files(tmp_path, monkeypatch):
    monkeypatch.setenv("BOKEHNET_MAX_PIXELS", "3e8")
    (tmp_path / "a.png").write_bytes(png(14000, 14000, pixels=zlib.compress(bytes(1000))))
    with ImageFile(tmp_path / "a.png") as file:
        assert file.parts[0].height == 14000
