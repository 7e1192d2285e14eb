"""Videos rendered: no frame lost or doubled, all else of the file kept, whenever it is stopped."""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

from bokehnet.cli.app import run
from bokehnet.errors import BokehnetError
from bokehnet.inference.monocular import DepthEstimator
from bokehnet.io.image import write_map
from bokehnet.io.video.display_matrix import DisplayMatrix
from bokehnet.io.video.frames import choose_codec, join_segments, read_video, video_info, write_segment
from bokehnet.render.renderer import BokehRenderer
from bokehnet.sequence import video as video_module
from bokehnet.sequence.filtered_shot import FilteredShot
from bokehnet.sequence.sequence import Pull
from bokehnet.sequence.video import VideoJob
from bokehnet.settings.settings import RenderSettings

av = pytest.importorskip("av")

BASE = Fraction(1, 24000)
SIZE = 96, 64


def picture(number):
    """A frame with its number in eight squares of black and white."""
    width, height = SIZE
    colors = np.full((height, width, 3), 90, np.uint8)
    colors[20:44, 30:60] = (40 + number, 120, 160)
    for bit in range(8):
        colors[:12, 12 * bit : 12 * bit + 12] = 235 * (number >> bit & 1)
    return colors


def numbers(path):
    """The numbers that the frames of a video tell."""
    results = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            grey = frame.to_ndarray(format="gray")
            results.append(
                sum(int(grey[3:9, 12 * bit + 3 : 12 * bit + 9].mean() > 128) << bit for bit in range(8))
            )
    return results


def sound(path):
    with av.open(str(path)) as container:
        return [
            (packet.pts * packet.time_base, bytes(packet))
            for packet in container.demux(audio=0)
            if packet.size
        ]


def make_clip(path, frames=10, codec="libx264", pixels="yuv420p", codes=(1, 1, 1), timecode="01:02:03:04"):
    """A video of uneven times with a tone; returns its times."""
    times, now = [], 0
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=24, options={"crf": "8", "x265-params": "log-level=error"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, pixels
        context = stream.codec_context
        context.time_base, context.color_range = BASE, 1
        context.color_primaries, context.color_trc, context.colorspace = codes
        stream.time_base = BASE
        stream.metadata["timecode"] = timecode
        tone = container.add_stream("aac", rate=48000)
        for number in range(frames):
            frame = av.VideoFrame.from_ndarray(picture(number), "rgb24").reformat(format=pixels)
            frame.pts, frame.time_base = now, BASE
            times.append(now)
            now += 1000 if number % 3 else 1700
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
        wave = (9000 * np.sin(np.arange(int(48000 * now * BASE)) / 17)).astype(np.int16)
        for start in range(0, len(wave) - 1024, 1024):
            frame = av.AudioFrame.from_ndarray(wave[None, start : start + 1024], format="s16", layout="mono")
            frame.sample_rate, frame.pts, frame.time_base = 48000, start, Fraction(1, 48000)
            container.mux(tone.encode(frame))
        container.mux(tone.encode(None))
    return tuple(times)


def job(clip, output, codec="h264", **options):
    reports = {"input": {"constant_disparity": 0.5}, "camera": {"blur": 4}, "focus": {"value": 0.25}}
    settings = RenderSettings().updated(reports | {"engine": {"name": "scatter"}})
    return VideoJob(info=video_info(clip), output=output, settings=settings, codec=codec, **options)


def test_times_sound_and_timecode_are_kept(tmp_path):
    times = make_clip(tmp_path / "clip.mp4")
    job(tmp_path / "clip.mp4", tmp_path / "out.mp4").run(BokehRenderer("scatter"))
    info = video_info(tmp_path / "out.mp4")
    assert info.times == times
    assert info.timecode == "01:02:03:04"
    assert numbers(tmp_path / "out.mp4") == list(range(10))
    assert sound(tmp_path / "out.mp4") == sound(tmp_path / "clip.mp4")
    assert not (tmp_path / ".bokehnet-video-out.mp4").exists()


@pytest.mark.parametrize(
    ("name", "codec", "pixels"),
    [
        ("out.mp4", "h265", "yuv420p10le"),
        ("out.mov", "prores", "yuv422p10le"),
        ("out.mkv", "ffv1", "yuv420p10le"),
    ],
)
@pytest.mark.parametrize("transfer", [16, 18])
def test_ten_bits_and_the_tags_of_hdr_are_kept(tmp_path, name, codec, pixels, transfer):
    make_clip(tmp_path / "clip.mov", 3, "libx265", "yuv420p10le", (9, transfer, 9))
    job(tmp_path / "clip.mov", tmp_path / name, codec).run(BokehRenderer("scatter"))
    info = video_info(tmp_path / name)
    assert (info.pixels, info.codes, info.full) == (pixels, (9, transfer, 9), False)


@pytest.mark.parametrize(("codes", "least"), [((1, 1, 1), 60), ((9, 16, 9), 60), ((9, 18, 9), 60)])
def test_light_survives_a_file_without_loss(tmp_path, codes, least):
    """FFV1 stores numbers as they are: what is left is rounding to 10 bits and chroma's halves."""
    make_clip(tmp_path / "clip.mov", 3, "libx265", "yuv420p10le", codes)
    info = video_info(tmp_path / "clip.mov")
    frames = list(read_video(info))
    write_segment(tmp_path / "0.npz", info, zip(info.times, frames, strict=True), "ffv1")
    join_segments(tmp_path / "out.mkv", info, [tmp_path / "0.npz"], "ffv1")
    again = list(read_video(video_info(tmp_path / "out.mkv")))
    for before, after in zip(frames, again, strict=True):
        difference = info.space.encode(before) - info.space.encode(after)
        inner = difference[24:40, 34:56]  # where chroma has no edges
        assert -10 * np.log10(np.mean(inner**2)) > least


def test_a_run_that_is_stopped_goes_on_without_rendering_again(tmp_path, monkeypatch):
    monkeypatch.setattr(video_module, "SEGMENT_FRAMES", 4)
    make_clip(tmp_path / "clip.mp4", 14)
    whole, parts = tmp_path / "whole.mp4", tmp_path / "parts.mp4"
    job(tmp_path / "clip.mp4", whole).run(BokehRenderer("scatter"))

    class Stopping(BokehRenderer):
        left = 6

        def render(self, *arguments, **options):
            self.left -= 1
            if self.left < 0:
                raise KeyboardInterrupt
            return super().render(*arguments, **options)

    renderer = Stopping("scatter")
    for _ in range(2):
        renderer.left = 6
        with pytest.raises(KeyboardInterrupt):
            job(tmp_path / "clip.mp4", parts).run(renderer)
        assert not parts.exists()
    renderer.left = 99
    report = job(tmp_path / "clip.mp4", parts).run(renderer)
    assert (report.frames, report.rendered) == (14, 6)
    assert numbers(parts) == list(range(14))
    assert parts.read_bytes() == whole.read_bytes()


def test_segments_of_other_settings_are_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(video_module, "join_segments", lambda *arguments: None)
    monkeypatch.setattr(video_module.shutil, "rmtree", lambda *arguments, **options: None)
    make_clip(tmp_path / "clip.mp4", 3)
    first = job(tmp_path / "clip.mp4", tmp_path / "out.mp4")
    first.run(BokehRenderer("scatter"))
    assert first.run(BokehRenderer("scatter")).rendered == 0
    monkeypatch.undo()
    other = job(tmp_path / "clip.mp4", tmp_path / "out.mp4", pull=Pull(keys={}), steady=False)
    assert other.run(BokehRenderer("scatter")).rendered == 3


def test_a_pull_moves_the_focus_from_the_first_frame_to_the_last(tmp_path):
    make_clip(tmp_path / "clip.mp4", 5)
    words = ["render", str(tmp_path / "clip.mp4"), "-o", str(tmp_path / "out.mkv"), "-q"]
    words += ["--constant-disparity", "0.5", "--blur", "20", "--focus-from", "0.5", "--focus-to", "0.9"]
    assert run([*words, "--engine", "scatter"]) == 0
    sharp = [
        np.abs(np.diff(frame[20:44], axis=1)).max() for frame in read_video(video_info(tmp_path / "out.mkv"))
    ]
    assert all(before > after for before, after in pairwise(sharp))


def test_maps_of_a_folder_are_taken_by_name_and_made_steady(tmp_path, capsys):
    make_clip(tmp_path / "clip.mp4", 4)
    maps, rng = tmp_path / "maps", np.random.default_rng(0)
    maps.mkdir()
    for number in range(4):
        values = 0.3 + 0.4 * np.tile(np.linspace(0, 1, 96, dtype=np.float32), (64, 1))
        write_map(maps / f"{number}.png", values + 0.01 * rng.standard_normal((64, 96)).astype(np.float32))
    words = ["render", str(tmp_path / "clip.mp4"), "-o", str(tmp_path / "out.mp4"), "--disparity", str(maps)]
    words += ["--blur", "8", "--focus", "0.5", "--engine", "scatter"]
    assert run(words) == 0
    assert "4 frames of 96x64, h264, maps smoothed in time" in capsys.readouterr().err
    (maps / "3.png").unlink()
    assert run([*words[:3], str(tmp_path / "less.mp4"), *words[4:]]) == 1
    assert "a map for each of 4 frames, got 3 in" in capsys.readouterr().err
    assert not (tmp_path / "less.mp4").exists()


def write_video(path, frames):
    """A video without loss but rounding, of pictures (H, W, 3) or maps (H, W) of 8 bits."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt, context = "yuv444p", stream.codec_context
        context.color_range = context.color_primaries = context.color_trc = context.colorspace = 1
        for values in frames:
            colors = values if values.ndim == 3 else np.repeat(values[..., None], 3, 2)
            one = av.VideoFrame.from_ndarray(np.ascontiguousarray(colors), "rgb24")
            container.mux(stream.encode(one.reformat(format="yuv444p", dst_colorspace="ITU709")))
        container.mux(stream.encode(None))


def two_shots(count=4):
    """A clip that is cut in its middle, and its depth with noise: values (count, H, W), 8 bits."""
    rng = np.random.default_rng(3)
    texture = rng.integers(0, 60, (64, 96, 1)).astype(np.uint8)
    pictures = [np.repeat(texture + (20 if t < count // 2 else 150), 3, 2) for t in range(count)]
    right, below = np.arange(96) >= 48, np.arange(64)[:, None] >= 32
    near = [np.broadcast_to(right if t < count // 2 else below, (64, 96)) for t in range(count)]
    maps = [np.where(one, 200, 50) + rng.integers(-4, 5, (64, 96)) for one in near]
    return pictures, [one.astype(np.uint8) for one in maps], near


SEEN = ["--blur", "8", "--focus", "0.5", "--engine", "scatter", "--repair-disparity", "off"]


def test_a_video_of_depth_is_disparity_as_it_is_stored(tmp_path):
    """Authority: the same maps as files, 8 bits of one channel, in a folder."""
    pictures, maps, _ = two_shots(5)
    write_video(tmp_path / "clip.mkv", pictures)
    write_video(tmp_path / "depth.mkv", maps)
    (tmp_path / "maps").mkdir()
    for number, values in enumerate(maps):
        write_map(tmp_path / "maps" / f"{number}.png", (values / 255).astype(np.float32))
    for depth, output in (("depth.mkv", "video.mkv"), ("maps", "folder.mkv")):
        words = ["render", str(tmp_path / "clip.mkv"), "--disparity", str(tmp_path / depth), *SEEN]
        assert run([*words, "--steady", "off", "-o", str(tmp_path / output)]) == 0
    result, expected = (list(read_video(video_info(tmp_path / name))) for name in ("video.mkv", "folder.mkv"))
    assert len(result) == len(expected) == 5
    np.testing.assert_allclose(result, expected, atol=0.02)  # 219 levels of 255


def test_a_video_of_depth_is_made_steady_and_a_cut_ends_a_shot(tmp_path, monkeypatch):
    """Authority: the depth without its noise, which is another one before and after the cut."""
    pictures, maps, near = two_shots(12)
    write_video(tmp_path / "clip.mkv", pictures)
    write_video(tmp_path / "depth.mkv", maps)
    words = ["render", str(tmp_path / "clip.mkv"), "--disparity", str(tmp_path / "depth.mkv"), *SEEN]
    kept = {}

    def keep(path, *arguments, **options):
        steady = FilteredShot(path / "maps")
        if steady.is_done:
            kept.update({t: steady.read(t) for t in range(12)})

    monkeypatch.setattr(video_module.shutil, "rmtree", keep)
    assert run([*words, "-o", str(tmp_path / "out.mkv")]) == 0
    truth = [np.where(one, 200, 50) / 255 for one in near]
    before = np.std([values / 255 - right for values, right in zip(maps, truth, strict=True)])
    for t in range(12):
        away = kept[t] - truth[t]
        assert away.std() < 0.6 * before  # six draws, not twelve
        assert np.abs(away).max() < 4.5 / 255  # nothing of the other shot
    assert np.std([kept[t + 1] - kept[t] for t in (*range(5), *range(6, 11))]) < 0.2 * before


def test_a_video_of_depth_of_another_length_is_reported(tmp_path, capsys):
    pictures, maps, _ = two_shots(4)
    write_video(tmp_path / "clip.mkv", pictures)
    write_video(tmp_path / "depth.mkv", maps[:3])
    words = ["render", str(tmp_path / "clip.mkv"), "--disparity", str(tmp_path / "depth.mkv"), *SEEN]
    for steady in ("on", "off"):
        assert run([*words, "--steady", steady, "-o", str(tmp_path / "out.mkv")]) == 1
        assert "as many frames as" in capsys.readouterr().err
    assert not (tmp_path / "out.mkv").exists()


def write_network(path):
    """A depth network whose disparity is its picture's red."""
    onnx = pytest.importorskip("onnx", reason="makes networks with the extra train")
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    ends = [onnx.numpy_helper.from_array(np.array([n], np.int64), f"n{n}") for n in (0, 1)]
    graph = helper.make_graph(
        [helper.make_node("Slice", ["image", "n0", "n1", "n1"], ["depth"])],
        "red",
        [helper.make_tensor_value_info("image", kind, (1, 3, "h", "w"))],
        [helper.make_tensor_value_info("depth", kind, None)],
        ends,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(model.SerializeToString())


@pytest.mark.parametrize("steady", ["on", "off"])
def test_a_network_looks_at_each_frame_and_is_opened_once_a_pass(tmp_path, monkeypatch, steady):
    """Authority: the same clip with red as a video of depth. The network runs once per frame if steady."""
    pytest.importorskip("onnx", reason="makes networks with the extra train")
    rng = np.random.default_rng(0)
    red = np.broadcast_to(np.where(np.arange(96) < 40, 0, 255), (64, 96)).astype(np.uint8)
    rest = rng.integers(0, 255, (64, 96)).astype(np.uint8)
    pictures = [np.stack([red, rest, rest], 2) for _ in range(5)]
    write_video(tmp_path / "clip.mkv", pictures)
    write_video(tmp_path / "depth.mkv", [red] * 5)
    write_network(tmp_path / "red.onnx")
    opened, requested = [], []
    make, look = DepthEstimator.__init__, DepthEstimator.__call__
    monkeypatch.setattr(DepthEstimator, "__init__", lambda *x, **y: (opened.append(1), make(*x, **y))[1])
    monkeypatch.setattr(DepthEstimator, "__call__", lambda *x: (requested.append(1), look(*x))[1])
    words = ["render", str(tmp_path / "clip.mkv"), *SEEN, "--steady", steady]
    model = ["--depth-model", str(tmp_path / "red.onnx"), "--depth-convention", str(tmp_path / "own.toml")]
    (tmp_path / "own.toml").write_text('size = 96\nfit = "stretch"\noutput = "disparity"\n')
    assert run([*words, *model, "-o", str(tmp_path / "model.mkv")]) == 0
    assert (len(opened), len(requested)) == (1, 5)
    assert run([*words, "--disparity", str(tmp_path / "depth.mkv"), "-o", str(tmp_path / "red.mkv")]) == 0
    result, expected = (list(read_video(video_info(tmp_path / name))) for name in ("model.mkv", "red.mkv"))
    assert len(result) == 5
    away = np.abs(np.subtract(result, expected))
    assert away.mean() < 0.005  # half a level of 219 moves blur by 0.02 pixels


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "out.png"], "--output"),
        (["-o", "clip.mp4"], "another file than the video"),
        (["-o", "out.mp4", "--video-codec", "prores"], "h264 or h265 in MP4"),
        (["-o", "out.mp4", "--frames", "1-2"], "--frames: expected no such option for a video"),
        (["-o", "out.mp4", "--save-maps", "maps"], "--save-maps: expected none for a video"),
    ],
)
def test_options_that_do_not_fit_a_video_are_reported_in_one_line(
    tmp_path, capsys, monkeypatch, words, message
):
    monkeypatch.chdir(tmp_path)
    make_clip(tmp_path / "clip.mp4", 2)
    before = (tmp_path / "clip.mp4").read_bytes()
    flat = ["--constant-disparity", "0.5", "--blur", "2", "--focus", "0.5"]
    assert run(["render", "clip.mp4", *flat, *words]) == 1
    error = capsys.readouterr().err.strip()
    assert message in error
    assert "\n" not in error
    assert [path.name for path in tmp_path.iterdir()] == ["clip.mp4"]
    assert (tmp_path / "clip.mp4").read_bytes() == before


def test_a_file_without_video_is_reported_by_name(tmp_path):
    (tmp_path / "no.mp4").write_bytes(b"nothing of the kind")
    with pytest.raises(BokehnetError, match=r"no\.mp4: expected a video"):
        video_info(tmp_path / "no.mp4")


def test_maps_of_a_turned_clip_may_be_as_stored_or_as_shown(tmp_path):
    """Authority: the clip without its display matrix, rendered with the map as stored; the matrix is kept."""
    rng = np.random.default_rng(1)
    pictures = [np.repeat(rng.integers(0, 200, (64, 96, 1)).astype(np.uint8), 3, 2)] * 2
    ramp = np.tile(np.linspace(0, 1, 96, dtype=np.float32), (64, 1))
    write_video(tmp_path / "plain.mkv", pictures)
    write_map(tmp_path / "stored.png", ramp)
    write_map(tmp_path / "shown.png", np.rot90(ramp, -1))
    with av.open(str(tmp_path / "plain.mkv")) as source, av.open(str(tmp_path / "turned.mkv"), "w") as target:
        stream = target.add_stream_from_template(source.streams.video[0])
        stream.set_display_rotation(-90)
        for packet in source.demux(video=0):
            if packet.size:
                packet.stream = stream
                target.mux(packet)

    def rendered(clip, depth, output):
        words = ["render", str(tmp_path / clip), "--disparity", str(tmp_path / depth), *SEEN]
        assert run([*words, "-o", str(tmp_path / output)]) == 0
        return video_info(tmp_path / output)

    plain = rendered("plain.mkv", "stored.png", "0.mkv")
    expected = [np.rot90(frame, -1) for frame in read_video(plain)]
    for number, depth in enumerate(("stored.png", "shown.png"), 1):
        info = rendered("turned.mkv", depth, f"{number}.mkv")
        assert (info.width, info.height, info.stored_size) == (64, 96, (96, 64))
        np.testing.assert_allclose(list(read_video(info)), expected, atol=0.02)


def grey_clip(path, frames, aspect=None, size=(48, 32)):
    """Write grey frames (H, W), 0 to 255, without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.width, stream.height, stream.pix_fmt = *size, "yuv444p"
        context = stream.codec_context
        context.color_range = 2
        context.color_primaries = context.color_trc = context.colorspace = 1
        if aspect is not None:
            context.sample_aspect_ratio = aspect
        for number, frame in enumerate(frames):
            colors = np.repeat(np.asarray(frame, np.uint8)[..., None], 3, 2)
            picture_frame = av.VideoFrame.from_ndarray(colors, "rgb24")
            picture_frame = picture_frame.reformat(
                format="yuv444p", dst_colorspace="ITU709", dst_color_range="JPEG"
            )
            picture_frame.pts, picture_frame.time_base = number, Fraction(1, 24)
            container.mux(stream.encode(picture_frame))
        container.mux(stream.encode(None))


@pytest.mark.parametrize("turned", [False, True])
def test_wide_pixels_of_a_video_narrow_the_disc(tmp_path, turned):
    """Authority: a disc is round as displayed: with pixels twice as wide, half as many columns."""
    lamp = np.zeros((64, 96))
    lamp[31:33, 47:49] = 255
    grey_clip(tmp_path / "clip.mp4", [lamp], Fraction(2), (96, 64))
    info = video_info(tmp_path / "clip.mp4")
    with pytest.raises(BokehnetError, match="pixels of 2 times"):
        choose_codec(tmp_path / "out.mkv", info, "ffv1")
    assert info.window.pixel_aspect == 2
    if turned:
        info = replace(info, width=64, height=96, display=DisplayMatrix(transposed=True))
        assert info.window.pixel_aspect == 0.5
    one = job(tmp_path / "clip.mp4", tmp_path / "out.mov", "prores")
    settings = one.settings.updated({"camera": {"blur": 24}, "focus": {"value": 0.0}})
    one = replace(one, info=info, settings=settings)
    one.run(BokehRenderer("scatter"))
    written = video_info(tmp_path / "out.mov")
    assert written.window.pixel_aspect == info.window.pixel_aspect
    light = next(read_video(written)).mean(-1)
    disc = light > light.max() / 2
    rows, columns = (12, 24) if turned else (24, 12)
    assert (disc.any(1).sum(), disc.any(0).sum()) == (
        pytest.approx(rows, abs=3),
        pytest.approx(columns, abs=3),
    )


def map_words(tmp_path, *words):
    grey_clip(tmp_path / "clip.mkv", [np.full((32, 48), 90)] * 3)
    clip, maps, output = (str(tmp_path / name) for name in ("clip.mkv", "maps.mkv", "out.mkv"))
    fixed = ["--blur", "6", "--engine", "scatter", "--repair-disparity", "off", "--steady", "off"]
    return ["render", clip, "--disparity", maps, "-o", output, *fixed, *words]


def test_values_without_depth_in_a_video_map_are_filled_and_reported_or_refused(tmp_path, capsys):
    """Authority: the same checks as for maps of pictures."""
    depth_map = np.full((32, 48), 120)
    depth_map[8:20, 10:24] = 0
    grey_clip(tmp_path / "maps.mkv", [depth_map] * 3)
    assert run(map_words(tmp_path, "--no-data", "0", "--focus", "0.2", "--holes", "error")) == 1
    error = capsys.readouterr().err
    assert error.count("bokehnet: error") == 1
    assert "168" in error
    assert run(map_words(tmp_path, "--no-data", "0", "--focus", "0.2", "--holes", "fill")) == 0
    assert "168" in capsys.readouterr().err


def test_an_inverted_video_map_is_nearest_where_it_is_dark(tmp_path):
    """Authority: the defocus of the complementary map."""
    ramp = np.tile(np.linspace(20, 230, 48), (32, 1)).round()
    pictures = []
    for maps, words in ((ramp, ["--invert"]), (255 - ramp, [])):
        grey_clip(tmp_path / "maps.mkv", [maps] * 3)
        texture = np.random.default_rng(0).integers(20, 200, (32, 48))
        words = map_words(tmp_path, "--focus", "0.3", *words)
        grey_clip(tmp_path / "clip.mkv", [texture] * 3)
        assert run(words) == 0
        pictures.append(next(read_video(video_info(tmp_path / "out.mkv"))))
        (tmp_path / "out.mkv").unlink()
    np.testing.assert_allclose(*pictures, atol=2e-3)


def test_what_was_filled_before_the_filter_over_time_stands_in_the_summary(tmp_path, capsys):
    """Authority: the number of marked pixels, 12 x 14 of 32 x 48, and the message of a still map."""
    texture = np.random.default_rng(0).integers(20, 200, (32, 48))
    depth_map = np.full((32, 48), 120)
    depth_map[8:20, 10:24] = 255
    grey_clip(tmp_path / "maps.mkv", [depth_map] * 3)
    words = [*map_words(tmp_path, "--no-data", "255", "--focus", "0.2"), "--steady", "on"]
    grey_clip(tmp_path / "clip.mkv", [texture] * 3)
    assert run(words) == 0
    error = capsys.readouterr().err
    assert "maps.mkv: frame 1: no data at 168 pixels" in error
    assert "assumed: bright is near (--invert if not); 11 % of the map without data filled" in error
    (tmp_path / "out.mkv").unlink()
    assert run([*words, "--holes", "error"]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"bokehnet: error: {tmp_path / 'maps.mkv'}: frame 1: no data at 168 pixels")
