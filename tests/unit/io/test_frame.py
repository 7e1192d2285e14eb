"""The authority is what OpenImageIO reads of both files, and for whole parts and headers their bytes."""

import os
import struct

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ImageFileError, ParameterError, ShapeError
from bokehnet.io.exr.header import Attribute, ExrHeaders, read_headers
from bokehnet.io.formats.output_format import OutputFormat
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.image import write_image
from tests.unit.io.exr.exr_files import read_channels, read_spec, write_exr

RNG = np.random.default_rng(0)
SIZE = (70, 90)


def values(scale=1.0):
    return (scale * RNG.uniform(0.1, 1, SIZE)).astype(np.float16).astype(np.float32)


def beauty(alpha=True, **more):
    """A part as a renderer writes it: half colours, float depth, a half normal, Cryptomatte in float."""
    depth = values(50)
    depth[0, :5] = np.inf
    crypto = RNG.integers(0, 2**32, SIZE, dtype=np.uint32).view(np.float32)
    channels = {
        **{name: ("half", values(3)) for name in ("RGBA" if alpha else "RGB")},
        "Z": ("float", depth),
        "N.X": ("half", values()),
        "ViewLayer.CryptoObject00.r": ("float", np.nan_to_num(crypto, posinf=1, neginf=1)),
    }
    attributes = {
        "compression": "zip",
        "cryptomatte/f834d0a/name": "ViewLayer.CryptoObject",
        "cryptomatte/f834d0a/manifest": '{"ball":"3b2a9c1e"}',
        "nominalFocalLength": 35.0,
        "chromaticities": (oiio.TypeDesc("float[8]"), [0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32, 0.34]),
        **more.pop("attributes", {}),
    }
    return {"channels": channels, "attributes": attributes, **more}


def assert_only_picture_changed(source, target, bokeh, changed="RGB"):
    old, new = read_channels(source), read_channels(target)
    assert list(old) == list(new)
    for name, (kind, array) in old.items():
        assert new[name][0] == kind
        if name in changed:
            assert_array_equal(new[name][1], bokeh["RGBA".index(name)])
        else:
            assert_array_equal(new[name][1], array)


@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"tile_width": 32, "tile_height": 16},
        {"x": -5, "y": -7, "full_x": 0, "full_y": 0, "full_width": 80, "full_height": 60},
    ],
    ids=["whole", "tiles", "overscan"],
)
@pytest.mark.parametrize("compression", ["none", "rle", "zips", "zip", "piz"])
def test_only_the_picture_changes(tmp_path, layout, compression):
    part = beauty(attributes={"compression": compression}, **layout)
    source = write_exr(tmp_path / "in.exr", part)
    frame = read_frame(source)
    bokeh, alpha = frame.image * 2, frame.alpha * 0.5
    write_frame(tmp_path / "out.exr", frame, bokeh, alpha)
    assert_only_picture_changed(
        source, tmp_path / "out.exr", [*np.moveaxis(bokeh, 2, 0), alpha], changed="RGBA"
    )
    old, new = read_headers(source), read_headers(tmp_path / "out.exr")
    assert old == new  # bytes of all attributes: metadata, windows, colour space, compression, tiles
    assert_array_equal(read_frame(tmp_path / "out.exr").image, bokeh)
    assert sorted(os.listdir(tmp_path)) == ["in.exr", "out.exr"]


@pytest.mark.parametrize(("compression", "exact"), [("pxr24", True), ("b44", False), ("dwaa:45", False)])
def test_lossy_compression_is_kept(tmp_path, compression, exact):
    """Depth and mattes are float, which only PXR24 shortens, and that only once."""
    source = write_exr(tmp_path / "in.exr", beauty(attributes={"compression": compression}))
    frame = read_frame(source)
    write_frame(tmp_path / "out.exr", frame, frame.image)
    old, new = read_channels(source), read_channels(tmp_path / "out.exr")
    for name in ("Z", "ViewLayer.CryptoObject00.r"):
        assert_array_equal(new[name][1], old[name][1])
    assert read_headers(source) == read_headers(tmp_path / "out.exr")
    if exact:
        assert_array_equal(read_frame(tmp_path / "out.exr").image, frame.image)
    else:
        assert np.abs(read_frame(tmp_path / "out.exr").image - frame.image).max() < 0.1


@pytest.mark.parametrize("compression", ["none", "zip", "piz", "pxr24", "b44", "dwaa:45"])
def test_whole_numbers_stay_to_the_bit(tmp_path, compression):
    part = beauty(attributes={"compression": compression})
    part["channels"]["id"] = ("uint", RNG.random(SIZE))
    source = write_exr(tmp_path / "in.exr", part)
    frame = read_frame(source)
    write_frame(tmp_path / "out.exr", frame, frame.image)

    def identities(path):
        file = oiio.ImageInput.open(str(path))
        index = file.spec().channelnames.index("id")
        return file.read_image(0, 0, index, index + 1, "uint")

    assert identities(source).max() > 2**24  # so that a float could not hold them
    assert_array_equal(identities(tmp_path / "out.exr"), identities(source))
    assert read_channels(tmp_path / "out.exr")["id"][0] == "uint"


def test_other_parts_are_copied_byte_by_byte(tmp_path):
    """Deep data and all: the chunks of other parts are looked up in both files and compared."""
    shared = {"chromaticities": beauty()["attributes"]["chromaticities"]}
    parts = [
        {"channels": {"Z": ("float", values(9))}, "attributes": {"compression": "dwab:20", **shared}},
        beauty(),
        {"channels": {"P.X": ("float", values())}, "attributes": shared},
    ]
    source = write_exr(tmp_path / "in.exr", *parts)
    frame = read_frame(source)
    write_frame(tmp_path / "out.exr", frame, frame.image * 2)
    assert read_headers(source) == read_headers(tmp_path / "out.exr")
    assert [read_spec(source, i)["name"] for i in range(3)] == ["part0", "part1", "part2"]
    for index in (0, 2):
        assert chunks(tmp_path / "out.exr")[index] == chunks(source)[index]
        for name, (_, array) in read_channels(source, index).items():
            assert_array_equal(read_channels(tmp_path / "out.exr", index)[name][1], array)
    assert_array_equal(read_frame(tmp_path / "out.exr").image, frame.image * 2)
    for name in ("Z", "A", "N.X"):
        assert_array_equal(read_channels(tmp_path / "out.exr", 1)[name][1], read_channels(source, 1)[name][1])


def test_a_chunk_beyond_every_file_is_reported(tmp_path):
    source = write_exr(tmp_path / "in.exr", beauty(), {"channels": {"P.X": ("float", values())}})
    headers, data = read_headers(source), bytearray(source.read_bytes())
    first = struct.unpack("<i", headers.parts[0]["chunkCount"].data)[0]
    struct.pack_into("<Q", data, headers.end + 8 * first, 2**64 - 2)
    source.write_bytes(data)
    frame = read_frame(source)
    with pytest.raises(ImageFileError, match="the source ends before its chunk"):
        write_frame(tmp_path / "out.exr", frame, frame.image)
    assert not (tmp_path / "out.exr").exists()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"chunkCount", b"chunkCounx", "has no chunk count"),
        (b"scanlineimage", b"sc\xffnlineimage", "expected a part of the type scanlineimage"),
        (b"N.X", b"N\xffX", "expected names of channels in UTF-8"),
    ],
)
def test_a_damaged_header_is_reported_before_the_file_is_written(old, new, message, tmp_path):
    source = write_exr(tmp_path / "in.exr", beauty(), {"channels": {"N.X": ("float", values())}})
    data = source.read_bytes()
    at = data.index(old) if old == b"N.X" else data.rindex(old)
    source.write_bytes(data[:at] + new.ljust(len(old), b"_") + data[at + len(old) :])
    frame = read_frame(source)
    with pytest.raises(ImageFileError, match=message):
        write_frame(tmp_path / "out.exr", frame, frame.image)
    assert not (tmp_path / "out.exr").exists()


def test_a_negative_number_of_chunks_is_reported(tmp_path):
    source = write_exr(tmp_path / "in.exr", beauty(), {"channels": {"N.X": ("float", values())}})
    data = source.read_bytes()
    at = data.rindex(b"chunkCount\0int\0") + len(b"chunkCount\0int\0") + 4
    source.write_bytes(data[:at] + struct.pack("<i", -5) + data[at + 4 :])
    frame = read_frame(source)
    with pytest.raises(ImageFileError, match="negative chunk count"):
        write_frame(tmp_path / "out.exr", frame, frame.image)
    assert not (tmp_path / "out.exr").exists()


def chunks(path):
    """Return the bytes of all chunks of a multi-part file by part, after "OpenEXR File Layout"."""
    headers, data = read_headers(path), path.read_bytes()
    counts = [struct.unpack("<i", part["chunkCount"].data)[0] for part in headers.parts]
    offsets = struct.unpack_from(f"<{sum(counts)}Q", data, headers.end)
    results = [[] for _ in counts]
    for begin, end in zip(sorted(offsets), [*sorted(offsets)[1:], len(data)], strict=True):
        results[struct.unpack_from("<i", data, begin)[0]].append(data[begin:end])
    return results


def test_deep_parts_pass_through(tmp_path):
    deep = oiio.ImageSpec(4, 3, 2, "float")
    deep.channelnames, deep.deep = ("Z", "A"), True
    data = oiio.DeepData()
    data.init(12, 2, oiio.TypeFloat, ("Z", "A"))
    for pixel in range(12):
        data.set_samples(pixel, pixel % 3)
        for sample in range(pixel % 3):
            data.set_deep_value(pixel, 0, sample, pixel + 0.5 * sample)
    path = str(tmp_path / "deep.exr")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, deep), output.geterror()
    assert output.write_deep_image(data), output.geterror()
    assert output.close()
    flat = write_exr(tmp_path / "flat.exr", {"channels": {c: ("half", np.full((3, 4), 0.25)) for c in "RGB"}})
    source = join_parts(
        tmp_path / "in.exr", [(tmp_path / "deep.exr", "deepscanline"), (flat, "scanlineimage")]
    )
    frame = read_frame(source)
    write_frame(tmp_path / "out.exr", frame, frame.image * 2)
    assert chunks(tmp_path / "out.exr")[0] == chunks(source)[0]
    assert (read_frame(tmp_path / "out.exr").image == 0.5).all()
    again = oiio.ImageInput.open(str(tmp_path / "out.exr")).read_native_deep_image(0, 0)
    assert [again.samples(pixel) for pixel in range(12)] == [pixel % 3 for pixel in range(12)]
    depth = [again.channelname(i) for i in range(again.channels)].index("Z")
    assert again.deep_value(11, depth, 1) == 11.5


def join_parts(target, files):
    """Make one file of single-part files, which OpenImageIO cannot do where some are deep."""
    parts, bodies = [], []
    for number, (path, kind) in enumerate(files):
        headers, data = read_headers(path), path.read_bytes()
        (begin,) = struct.unpack_from("<Q", data, headers.end)
        count = (begin - headers.end) // 8
        offsets = struct.unpack_from(f"<{count}Q", data, headers.end)
        ends = [*offsets[1:], len(data)]
        bodies += [struct.pack("<i", number) + data[a:b] for a, b in zip(offsets, ends, strict=True)]
        named = {"name": Attribute("string", kind.encode()), "type": Attribute("string", kind.encode())}
        parts.append({**headers.parts[0], **named, "chunkCount": Attribute("int", struct.pack("<i", count))})
    flags = 2 | 0x1000 | 0x800  # version 2, several parts, some of them deep
    head = ExrHeaders(flags=flags, parts=tuple(parts), end=0).pack()
    first = len(head) + 8 * len(bodies)
    starts = first + np.cumsum([0, *map(len, bodies[:-1])])
    target.write_bytes(head + struct.pack(f"<{len(bodies)}Q", *starts) + b"".join(bodies))
    return target


def test_the_frames_own_file_may_be_written(tmp_path):
    path = write_exr(tmp_path / "a.exr", beauty())
    old, frame = read_channels(path), read_frame(path)
    write_frame(path, frame, frame.image * 2)
    assert_array_equal(read_frame(path).image, frame.image * 2)
    assert_array_equal(read_channels(path)["Z"][1], old["Z"][1])
    with pytest.raises(ImageFileError, match="has changed since it was read"):
        write_frame(tmp_path / "b.exr", frame, frame.image)
    assert os.listdir(tmp_path) == ["a.exr"]


def test_values_beyond_half_are_clipped_in_half_channels_only(tmp_path):
    for kind, largest in (("half", 65504), ("float", 1e9)):
        part = {"channels": {name: (kind, values()) for name in "RGB"}}
        frame = read_frame(write_exr(tmp_path / "in.exr", part))
        write_frame(tmp_path / "out.exr", frame, np.full((*SIZE, 3), 1e9))
        assert (read_frame(tmp_path / "out.exr").image == largest).all()


def test_a_grey_picture_and_a_layer_are_written_back(tmp_path):
    frame = read_frame(write_exr(tmp_path / "in.exr", {"channels": {"Y": ("float", values())}}))
    write_frame(tmp_path / "out.exr", frame, frame.image * 2)
    assert_array_equal(read_channels(tmp_path / "out.exr")["Y"][1], frame.image[..., 0] * 2)
    channels = {f"{layer}.{c}": ("half", values()) for layer in ("beauty", "spec") for c in "RGBA"}
    frame = read_frame(write_exr(tmp_path / "in.exr", {"channels": channels}))
    write_frame(tmp_path / "out.exr", frame, frame.image * 2, frame.alpha / 2)
    new = read_channels(tmp_path / "out.exr")
    assert_array_equal(new["beauty.G"][1], channels["beauty.G"][1] * 2)
    assert_array_equal(new["beauty.A"][1], channels["beauty.A"][1] / 2)
    for c in "RGBA":
        assert_array_equal(new[f"spec.{c}"][1], channels[f"spec.{c}"][1])


@pytest.mark.parametrize("compression", ["none", "zip", "piz", "dwaa:45"])
@pytest.mark.parametrize("layout", [{}, {"tile_width": 32, "tile_height": 16}], ids=["whole", "tiles"])
def test_channels_are_added_to_the_picture(tmp_path, compression, layout):
    """In the middle of the names, where decoders seek them; written again they take their own place."""
    part = beauty(attributes={"compression": compression}, **layout)
    source = write_exr(tmp_path / "in.exr", part)
    frame, doubt = read_frame(source), values(30)
    write_frame(tmp_path / "out.exr", frame, frame.image * 2, extra_channels={"doubt": doubt})
    old, new = read_channels(source), read_channels(tmp_path / "out.exr")
    assert set(new) - set(old) == {"doubt"}
    assert new["doubt"][0] == "float"
    for name in ("Z", "ViewLayer.CryptoObject00.r"):
        assert_array_equal(new[name][1], old[name][1])
    if compression != "dwaa:45":
        assert_array_equal(read_frame(tmp_path / "out.exr").image, frame.image * 2)
        assert_array_equal(new["doubt"][1], doubt)
    again = read_frame(tmp_path / "out.exr")
    write_frame(tmp_path / "out.exr", again, again.image, extra_channels={"doubt": 2 * doubt})
    assert list(read_channels(tmp_path / "out.exr")) == list(new)
    if compression != "dwaa:45":
        assert_array_equal(read_channels(tmp_path / "out.exr")["doubt"][1], 2 * doubt)


def test_channels_are_added_to_their_layer_and_other_parts_stay(tmp_path):
    layer = {f"beauty.{c}": ("half", values()) for c in "RGB"}
    parts = [{"channels": {"Z": ("float", values(9))}}, {"channels": layer}]
    frame = read_frame(write_exr(tmp_path / "in.exr", *parts))
    write_frame(tmp_path / "out.exr", frame, frame.image, extra_channels={"doubt": values(3)})
    assert set(read_spec(tmp_path / "out.exr", 1).channelnames) == {*layer, "beauty.doubt"}
    assert set(read_spec(tmp_path / "out.exr", 0).channelnames) == {"Z"}


def test_the_part_that_is_called_beauty_is_the_picture(tmp_path):
    parts = [{"channels": {c: ("half", np.full(SIZE, level)) for c in "RGB"}} for level in (0.25, 0.5)]
    parts[1]["attributes"] = {"oiio:subimagename": "beauty"}
    assert (read_frame(write_exr(tmp_path / "a.exr", *parts)).image == 0.5).all()


def test_alpha_of_one_is_no_alpha(tmp_path, store):
    solid = beauty()
    solid["channels"]["A"] = ("half", np.ones(SIZE))
    assert read_frame(write_exr(tmp_path / "a.exr", solid)).alpha is None
    assert read_frame(write_exr(tmp_path / "b.exr", beauty(alpha=False))).alpha is None
    assert read_frame(store("a.png", np.full((2, 2, 3), 7, np.uint8))).alpha is None


@pytest.mark.parametrize("extension", [".png", ".tif", ".webp"])
def test_straight_alpha_survives_reading_and_writing(tmp_path, store, extension):
    """Porter and Duff, "Compositing digital images", 1984; 8 bit and lossy WebP bound the error."""
    stored = np.empty((16, 16, 4), np.uint8)
    stored[..., :3] = [200, 100, 50]
    stored[..., 3] = np.linspace(40, 255, 16)
    frame = read_frame(store("in.png", stored, "RGBA"))
    assert_allclose(frame.alpha, stored[..., 3] / 255, atol=1e-6)
    assert_allclose(frame.image, read_frame(tmp_path / "in.png").image, atol=0)
    target = tmp_path / f"out{extension}"
    write_frame(target, frame, frame.image, output_format=OutputFormat(quality=100))
    file = oiio.ImageInput.open(str(target), oiio.ImageSpec())
    assert file.spec().nchannels == 4
    again = read_frame(target)
    tolerance = 0.05 if extension == ".webp" else 1e-5
    assert_allclose(again.alpha, frame.alpha, atol=tolerance)
    assert_allclose(again.image, frame.image, atol=tolerance)


def test_formats_without_alpha_show_the_picture_over_black(tmp_path, store):
    stored = np.array([[[200, 100, 50, 128]] * 16] * 16, np.uint8)
    frame = read_frame(store("in.png", stored, "RGBA"))
    for name, tolerance in (("a.jpg", 0.01), ("a.hdr", 0.01)):
        write_frame(tmp_path / name, frame, frame.image)
        assert_allclose(read_frame(tmp_path / name).image, frame.image, atol=tolerance)


def test_a_png_becomes_a_premultiplied_exr(tmp_path, store):
    frame = read_frame(store("in.png", np.array([[[255, 255, 255, 51]]], np.uint8), "RGBA"))
    write_frame(tmp_path / "a.exr", frame, frame.image)
    stored = read_channels(tmp_path / "a.exr")
    assert [stored[name][1].item() for name in "RGBA"] == [np.float16(0.2)] * 4


@pytest.mark.parametrize(
    ("position", "display", "is_part"),
    [
        ((0, 0), (90, 70), False),
        ((-5, -3), (80, 60), False),
        ((30, 20), (200, 120), True),
        ((0, 0), (90, 71), True),
    ],
)
def test_a_crop_is_noted(tmp_path, position, display, is_part):
    """Authority: the data window covers the display window, or not."""
    image = np.full((*SIZE, 3), 0.5, np.float32)
    spec = oiio.ImageSpec(SIZE[1], SIZE[0], 3, "float")
    spec.x, spec.y = position
    spec.full_width, spec.full_height = display
    output = oiio.ImageOutput.create("crop.exr")
    assert output.open(str(tmp_path / "crop.exr"), spec)
    output.write_image(image)
    output.close()
    notes = [
        note for note in read_frame(tmp_path / "crop.exr").choices if note.startswith("only 90x70 pixels")
    ]
    assert len(notes) == is_part


def test_other_formats_show_the_display_window(tmp_path):
    part = {"channels": {c: ("float", np.ones(SIZE)) for c in "RGBA"}}
    window = {"x": 10, "y": -5, "full_x": 0, "full_y": 0, "full_width": 120, "full_height": 60}
    frame = read_frame(write_exr(tmp_path / "in.exr", {**part, **window}))
    assert frame.image.shape == (*SIZE, 3)
    assert (frame.window.x, frame.window.y, frame.window.display_width) == (10, -5, 120)
    write_frame(tmp_path / "a.png", frame, frame.image)
    shown = read_frame(tmp_path / "a.png").image
    assert shown.shape == (60, 120, 3)
    expected = np.zeros((60, 120))
    expected[:, 10:100] = 1
    assert_array_equal(shown[..., 0], expected)


def test_wrong_arguments_are_refused_before_anything_is_written(tmp_path):
    frame = read_frame(write_exr(tmp_path / "in.exr", beauty(alpha=False)))
    out = tmp_path / "out.exr"
    with pytest.raises(ShapeError):
        write_frame(out, frame, frame.image[1:])
    with pytest.raises(ShapeError):
        write_frame(out, frame, frame.image, np.ones((3, 3)))
    with pytest.raises(ParameterError, match="NaN"):
        write_frame(out, frame, frame.image * np.nan)
    with pytest.raises(ParameterError, match="no alpha channel"):
        write_frame(out, frame, frame.image, np.ones(SIZE))
    with pytest.raises(ImageFileError, match=r"unknown extension '\.bmp'"):
        write_frame(tmp_path / "out.bmp", frame, frame.image)
    assert os.listdir(tmp_path) == ["in.exr"]


def test_only_exr_has_additional_channels(tmp_path, store):
    frame = read_frame(store("in.png", np.full((*SIZE, 3), 99, np.uint8)))
    with pytest.raises(ParameterError, match=r"extra_channels: expected nothing, as only EXR .* an \.exr"):
        write_frame(tmp_path / "out.tif", frame, frame.image, extra_channels={"doubt": values()})
    write_frame(tmp_path / "out.exr", frame, frame.image, extra_channels={"doubt": values()})
    assert set(read_channels(tmp_path / "out.exr")) == {"R", "G", "B", "doubt"}
    with pytest.raises(ShapeError):
        write_frame(tmp_path / "out.exr", frame, frame.image, extra_channels={"doubt": values()[1:]})


def test_colours_in_whole_numbers_cannot_hold_light(tmp_path):
    part = {"channels": {c: ("uint", RNG.random(SIZE)) for c in "RGB"}}
    frame = read_frame(write_exr(tmp_path / "in.exr", part))
    with pytest.raises(ImageFileError, match="integers in R, G, B"):
        write_frame(tmp_path / "out.exr", frame, frame.image)
    write_frame(tmp_path / "out.png", frame, frame.image)


@pytest.mark.parametrize("channel", ["R", "A"])
def test_values_that_are_not_finite_count_only_in_the_picture(tmp_path, channel):
    part = beauty()
    part["channels"]["N.X"][1][:] = np.nan
    read_frame(write_exr(tmp_path / "good.exr", part))
    part["channels"][channel][1][3, 4] = np.nan
    with pytest.raises(ImageFileError, match=": 1 pixels are NaN"):
        read_frame(write_exr(tmp_path / "bad.exr", part))


def test_a_full_disk_keeps_the_older_file(tmp_path, python_process):
    source = write_exr(tmp_path / "in.exr", beauty())
    target = tmp_path / "out.exr"
    target.write_bytes(b"old")
    outcome = python_process(
        """
import resource, sys
from bokehnet.errors import ImageFileError
from bokehnet.io.frame import read_frame, write_frame
frame = read_frame(sys.argv[1])
for limit in (0, 1000, 50000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        write_frame(sys.argv[2], frame, frame.image)
    except ImageFileError as error:
        sys.stdout.write(f"{error}\\n")
""",
        source,
        target,
        timeout=60,
    )
    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.count("cannot be written") == 3
    assert target.read_bytes() == b"old"
    assert sorted(os.listdir(tmp_path)) == ["in.exr", "out.exr"]


def test_a_failure_on_the_way_leaves_nothing_behind(tmp_path, monkeypatch):
    import bokehnet.io.exr_splice as module

    source = write_exr(tmp_path / "in.exr", beauty())
    frame = read_frame(source)

    def fail(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "_splice", fail)
    with pytest.raises(KeyboardInterrupt):
        write_frame(source, frame, frame.image * 2)
    assert os.listdir(tmp_path) == ["in.exr"]
    assert_array_equal(read_frame(source).image, frame.image)


def test_earlier_names_of_keywords_still_work(tmp_path, store):
    """Oracle: the file with the present names."""
    frame = read_frame(store("in.png", np.full((*SIZE, 3), 99, np.uint8)))
    extra, space = {"doubt": values()}, OutputFormat(bits="float")
    write_frame(tmp_path / "now.exr", frame, frame.image, output_format=space, extra_channels=extra)
    with pytest.warns(DeprecationWarning, match="use (extra_channels|output_format)= instead"):
        write_frame(tmp_path / "before.exr", frame, frame.image, wanted=space, beside=extra)
    with pytest.warns(DeprecationWarning, match="use extra_channels= instead of beside="):
        write_image(tmp_path / "image.exr", frame.image, bits="float", beside=extra)
    expected = read_channels(tmp_path / "now.exr")
    assert set(expected) == {"R", "G", "B", "doubt"}
    for name in ("before.exr", "image.exr"):
        channels = read_channels(tmp_path / name)
        assert all(np.array_equal(channels[key][1], expected[key][1]) for key in expected)
