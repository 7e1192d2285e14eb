"""Display matrices against NumPy's rotations, through files that FFmpeg writes and reads."""

from fractions import Fraction

import numpy as np
import pytest

from bokehnet.errors import BokehnetError
from bokehnet.io.video.display_matrix import IDENTITY, DisplayMatrix
from bokehnet.io.video.frames import choose_codec, read_luma, read_video, target_pixels, video_info

av = pytest.importorskip("av", reason="videos need the extra video")

PICTURE = np.random.default_rng(0).integers(16, 240, (32, 48, 3)).astype(np.uint8)
GREY = np.repeat(PICTURE[..., :1], 3, 2)


def write(path, picture=PICTURE, pixels="yuv444p", codec="ffv1", frames=2, aspect=None, start=0, **display):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=24)
        stream.height, stream.width = picture.shape[:2]
        stream.pix_fmt, context = pixels, stream.codec_context
        context.color_range = context.color_primaries = context.color_trc = context.colorspace = 1
        if aspect is not None:
            context.sample_aspect_ratio = aspect
        if "matrix" in display:
            stream.set_display_matrix(display["matrix"])
        elif display:
            stream.set_display_rotation(display.pop("degrees"), **display)
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(picture, "rgb24")
            frame = frame.reformat(format=pixels, dst_colorspace="ITU709")
            frame.pts, frame.time_base = start + number, Fraction(1, 24)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


@pytest.mark.parametrize("degrees", [0, 90, 180, -90])
@pytest.mark.parametrize("flips", [(False, False), (True, False), (False, True)])
def test_frames_are_read_as_shown(tmp_path, degrees, flips):
    """Authority: PyAV's rotation, counter-clockwise, then mirrored; NumPy's of the stored picture."""
    write(tmp_path / "stored.mkv")
    write(tmp_path / "turned.mkv", degrees=degrees, hflip=flips[0], vflip=flips[1])
    stored = next(read_video(video_info(tmp_path / "stored.mkv")))
    expected = np.rot90(stored, degrees // 90)
    expected = expected[:, ::-1] if flips[0] else expected
    expected = expected[::-1] if flips[1] else expected
    info = video_info(tmp_path / "turned.mkv")
    assert (info.height, info.width) == expected.shape[:2]
    assert info.stored_size == (48, 32)
    np.testing.assert_array_equal(next(read_video(info)), expected)
    np.testing.assert_array_equal(info.display.stored(expected), stored)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("rows", [False, True])
@pytest.mark.parametrize("columns", [False, True])
def test_written_numbers_are_read_as_the_same_transformation(turned, rows, columns):
    display = DisplayMatrix(transposed=turned, flipped_rows=rows, flipped_columns=columns)
    assert DisplayMatrix.parsed(tuple(display.numbers)) == display
    values = np.arange(6).reshape(2, 3)
    np.testing.assert_array_equal(display.stored(display.shown(values)), values)


def test_other_matrices_are_refused_by_name(tmp_path):
    half = int(65536 * np.sqrt(0.5))
    write(tmp_path / "tilted.mp4", codec="libx264", matrix=[half, half, 0, -half, half, 0, 0, 0, 1 << 30])
    with pytest.raises(BokehnetError, match=r"tilted\.mp4: expected a display matrix of quarter turns"):
        video_info(tmp_path / "tilted.mp4")


def test_a_video_of_false_colours_is_no_disparity(tmp_path):
    write(tmp_path / "grey.mkv", GREY)
    write(tmp_path / "colours.mkv")
    assert next(read_luma(video_info(tmp_path / "grey.mkv"))).shape == (32, 48)
    with pytest.raises(BokehnetError, match="expected a grey video of disparity, found colours in frame 1"):
        next(read_luma(video_info(tmp_path / "colours.mkv")))


@pytest.mark.parametrize(
    ("pixels", "encoder", "codec", "kept"),
    [
        ("yuv420p", "libx264", "h264", "yuv420p"),
        ("yuv422p", "libx264", "h264", "yuv422p"),
        ("yuv444p", "libx264", "h264", "yuv444p"),
        ("yuv422p10le", "libx265", "h265", "yuv422p10le"),
        ("yuv422p10le", "ffv1", "prores", "yuv422p10le"),
        ("yuv444p10le", "ffv1", "prores", "yuv444p10le"),
        ("yuv422p10le", "ffv1", "ffv1", "yuv422p10le"),
    ],
)
def test_chroma_and_bits_are_kept(tmp_path, pixels, encoder, codec, kept):
    wide = np.tile(PICTURE, (1, 2, 1))  # x265 itself needs 49 columns: test_frames.py
    write(tmp_path / "clip.mkv", wide, pixels=pixels, codec=encoder)
    assert target_pixels(video_info(tmp_path / "clip.mkv"), codec) == kept


def test_what_a_codec_cannot_keep_is_refused_by_name(tmp_path):
    write(tmp_path / "odd.mkv", PICTURE[:31, :47], pixels="yuv420p")
    write(tmp_path / "deep.mkv", pixels="yuv420p10le")
    write(tmp_path / "alpha.mkv", pixels="yuva420p")
    odd, deep = video_info(tmp_path / "odd.mkv"), video_info(tmp_path / "deep.mkv")
    assert choose_codec(tmp_path / "out.mkv", odd, None) == "ffv1"
    with pytest.raises(BokehnetError, match="for the odd size 47x31"):
        choose_codec(tmp_path / "out.mp4", odd, None)
    with pytest.raises(BokehnetError, match="for 10 bits"):
        choose_codec(tmp_path / "out.mp4", deep, "h264")
    with pytest.raises(BokehnetError, match=r"alpha\.mkv: expected .* yuva420p, which have alpha"):
        video_info(tmp_path / "alpha.mkv")


@pytest.mark.parametrize("pixels", ["gray", "gray10le", "gray12le", "gray16le"])
def test_grey_videos_of_any_depth_are_disparity(tmp_path, pixels):
    """Authority: the values that were stored, full range, as FFmpeg defines its grey formats."""
    levels = np.tile(np.linspace(0, 255, 47).astype(np.uint8)[None, :, None], (31, 1, 3))
    with av.open(str(tmp_path / "map.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.width, stream.height, stream.pix_fmt = 47, 31, pixels
        container.mux(stream.encode(av.VideoFrame.from_ndarray(levels, "rgb24").reformat(format=pixels)))
        container.mux(stream.encode(None))
    info = video_info(tmp_path / "map.mkv")
    assert info.full
    np.testing.assert_allclose(next(read_luma(info))[7], levels[7, :, 0] / 255, atol=6e-4)
    assert target_pixels(info, "ffv1").startswith("yuv444p")


def test_a_file_that_was_cut_off_is_noted(tmp_path):
    """Authority: the duration that the muxer wrote into the header of the whole file."""
    write(tmp_path / "whole.mkv", frames=24)
    data = (tmp_path / "whole.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(data[: len(data) // 2])
    assert video_info(tmp_path / "whole.mkv").notes == ()
    (note,) = video_info(tmp_path / "cut.mkv").notes
    assert "before the duration in its header; it may be cut off" in note


def test_a_late_start_is_no_missing_end(tmp_path):
    """Authority: the muxer, which wrote the whole file; Matroska's duration counts from time zero."""
    write(tmp_path / "late.mkv", frames=3, start=120)
    write(tmp_path / "late.mp4", codec="libx264", pixels="yuv420p", frames=3, start=120)
    assert [video_info(tmp_path / name).notes for name in ("late.mkv", "late.mp4")] == [(), ()]


def test_a_still_video_has_no_transformation(tmp_path):
    write(tmp_path / "clip.mkv")
    assert video_info(tmp_path / "clip.mkv").display == IDENTITY


def test_pictures_before_an_edit_list_are_left_out_and_a_late_start_is_kept(tmp_path):
    """Authority: FFmpeg's decoder, which drops three pictures before time zero; the shift of the times."""
    write(tmp_path / "whole.mp4", codec="libx264", pixels="yuv420p", frames=12)
    write(tmp_path / "late.mkv", frames=3, start=120)
    with (
        av.open(str(tmp_path / "whole.mp4")) as source,
        av.open(str(tmp_path / "cut.mp4"), "w", options={"avoid_negative_ts": "disabled"}) as target,
    ):
        stream = target.add_stream_from_template(source.streams.video[0])
        shift = int(Fraction(3, 24) / source.streams.video[0].time_base)
        for packet in source.demux(video=0):
            if packet.size:
                packet.pts, packet.dts, packet.stream = packet.pts - shift, packet.dts - shift, stream
                target.mux(packet)
    info, late = video_info(tmp_path / "cut.mp4"), video_info(tmp_path / "late.mkv")
    assert (len(info.times), len(list(read_video(info))), info.times[0]) == (9, 9, 0)
    assert late.times[0] * late.time_base == 5
