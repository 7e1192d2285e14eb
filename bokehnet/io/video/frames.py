"""Read the frames of videos as light, and write videos with other frames, with PyAV (extra ``video``)."""

import contextlib
import heapq
import importlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.checks import require_extra
from bokehnet.errors import BokehnetError, ImageFileError, ParameterError, errors_of_file
from bokehnet.io.color.camera_spaces import INPUT_COLOR_SPACES
from bokehnet.io.color.color_space import SRGB, ColorSpace
from bokehnet.io.color.file_color import coded_space
from bokehnet.io.containers.input_checks import check_name, check_pixel_count
from bokehnet.io.files.atomic import write_atomic
from bokehnet.io.video.chroma import PixelFormat
from bokehnet.io.video.display_matrix import IDENTITY, DisplayMatrix
from bokehnet.io.window import Window, plausible_aspect

__all__ = [
    "CODECS",
    "VIDEO_EXTENSIONS",
    "VideoInfo",
    "choose_codec",
    "is_video",
    "join_segments",
    "read_luma",
    "read_video",
    "video_info",
    "write_segment",
]

Array = npt.NDArray[np.float32]

# Mean difference of the channels of a video of disparity above which it has false colours, and the stride at
# which it is measured.
_MAX_TINT, _TINT_STRIDE_PX = 0.05, 4

# Width from which x265's "cutree" is safe. Build 216 works on rows of blocks of 16 columns, and its AVX2 code
# writes four blocks before it compares their number: past the end of shorter rows, into other memory.
_MIN_CUTREE_WIDTH_PX = 49

# FFmpeg's unit of durations; difference of durations, in frames, that rounding and pauses do not explain.
_MICROSECONDS, _MAX_MISSING_FRAMES = 1e6, 2.0

VIDEO_EXTENSIONS = (".mp4", ".m4v", ".mov", ".mkv")

# FFmpeg's encoder and its options by name. Without B-frames, time stamps rise in the order of writing, and
# segments can be concatenated.
CODECS: dict[str, tuple[str, dict[str, str]]] = {
    "h264": ("libx264", {"crf": "16", "preset": "medium", "bf": "0"}),
    "h265": ("libx265", {"crf": "16", "preset": "medium", "x265-params": "bframes=0:log-level=error"}),
    "prores": ("prores_ks", {"profile": "3"}),
    "ffv1": ("ffv1", {"level": "3", "slicecrc": "1"}),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class VideoInfo:
    """Header data of a video.

    Attributes:
        path: Video file.
        width: Width of the shown picture, pixels.
        height: Height of the shown picture, pixels.
        times: Rising times of its frames, in units of ``time_base``.
        time_base: Unit of time, seconds.
        rate: Average frames per second, for encoders; ``times`` are authoritative.
        pixels: FFmpeg's name of the pixel format.
        codes: Primaries, transfer and matrix of ITU-T H.273; 2 if unspecified.
        full: True if values use their full range.
        space: Colour space.
        timecode: Timecode of the first frame; empty if absent.
        aspect: Width of a stored pixel over its height.
        display: Transformation from the stored to the shown picture.
        notes: Warnings about the file, one line each.
    """

    path: Path
    width: int
    height: int
    times: tuple[int, ...]
    time_base: Fraction
    rate: Fraction
    pixels: str
    codes: tuple[int, int, int]
    full: bool
    space: ColorSpace
    timecode: str = ""
    aspect: Fraction = Fraction(1)
    display: DisplayMatrix = IDENTITY
    notes: tuple[str, ...] = ()

    @property
    def stored_size(self) -> tuple[int, int]:
        """Width and height of the stored picture, pixels."""
        return (self.height, self.width) if self.display.transposed else (self.width, self.height)

    @property
    def window(self) -> Window:
        """Size of the shown picture and shape of its pixels; square if the file's ratio is implausible."""
        aspect = plausible_aspect(float(self.aspect))
        return replace(
            Window.whole(self.width, self.height),
            pixel_aspect=1 / aspect if self.display.transposed else aspect,
        )

    @property
    def bits(self) -> int:
        """Bits per value of its pixels."""
        return PixelFormat.named(_planar(self.pixels), self.codes[2], self.full).bits


def is_video(path: Path | str) -> bool:
    """Return whether the extension of a file is that of a video."""
    return Path(path).suffix.lower() in VIDEO_EXTENSIONS


def video_info(path: Path | str, color_space: str = "auto") -> VideoInfo:
    """Read the header of a video and the times of its frames.

    Args:
        path: Video file.
        color_space: ``"auto"`` for the space of its code points, or one of ``INPUT_COLOR_SPACES``.

    Raises:
        ImageFileError: The file cannot be read, holds no pictures, or its colour space is unsupported.
        MissingExtraError: PyAV is not installed.
    """
    with _open(path) as container:
        stream = _video_stream(path, container)
        context = stream.codec_context
        if context is None or not context.pix_fmt:
            raise ImageFileError(f"{path}: expected a video with a known codec, found another one")
        check_pixel_count(path, context.width, context.height)
        tags = (context.color_primaries, context.color_trc, context.colorspace)
        primaries, transfer, matrix = (int(tag or 0) or 2 for tag in tags)
        # An edit list makes packets before its start invisible.
        packets = [packet for packet in container.demux() if packet.size and packet.pts is not None]
        times = sorted(
            packet.pts for packet in packets if packet.stream_index == stream.index and not packet.is_discard
        )
        if not times:
            raise ImageFileError(f"{path}: expected a video, found no pictures in it")
        display = _display_matrix(path)
        turned = display.transposed
        timecodes = [stream.metadata.get("timecode"), container.metadata.get("timecode")]
        timecodes += [other.metadata.get("timecode") for other in container.streams]
        timecodes += [container.metadata.get("TIMECODE")]
        value_range = int(context.color_range or 0)
        info = VideoInfo(
            path=Path(path),
            width=context.height if turned else context.width,
            height=context.width if turned else context.height,
            display=display,
            times=tuple(times),
            time_base=stream.time_base,
            rate=stream.average_rate or Fraction(25),
            pixels=context.pix_fmt,
            codes=(primaries, transfer, matrix),
            # FFmpeg's grey has the full range unless it is marked as limited.
            full=value_range == 2 or (value_range == 0 and context.pix_fmt.startswith("gray")),
            space=INPUT_COLOR_SPACES.get(color_space) or coded_space(path, primaries, transfer) or SRGB,
            timecode=next(filter(None, timecodes), "") or "",
            aspect=stream.sample_aspect_ratio or context.sample_aspect_ratio or Fraction(1),
            notes=_end_note(path, container, packets, stream),
        )
    try:
        _ = info.bits
    except ImageFileError as error:
        raise ImageFileError(f"{path}: {error}") from error
    return info


def _end_note(path: Path | str, container: Any, packets: list[Any], stream: Any) -> tuple[str, ...]:
    """Return a warning if the streams end before the duration in the header, as those of a file cut off."""
    if container.duration is None:
        return ()
    end = max(float((packet.pts + (packet.duration or 0)) * packet.time_base) for packet in packets)
    # Matroska's header holds the time of the end, that of others the time between start and end.
    start = 0 if container.format.name.startswith("matroska") else container.start_time or 0
    missing = (start + container.duration) / _MICROSECONDS - end
    if missing < _MAX_MISSING_FRAMES / float(stream.average_rate or 25):
        return ()
    return (f"{path}: ends {missing:.2f} s before the duration in its header; it may be cut off",)


def read_video(info: VideoInfo, first: int = 0) -> Iterator[Array]:
    """Yield the frames from ``first`` on, scene-linear in the video's primaries, (H, W, 3).

    Raises:
        ImageFileError: The file is damaged.
    """
    for colors in _encoded_frames(info, first):
        yield info.display.shown(info.space.decode(colors))


def read_luma(info: VideoInfo, first: int = 0) -> Iterator[Array]:
    """Yield the mean of the stored colours of the frames from ``first`` on, (H, W), 0 to 1, as disparity.

    Raises:
        ImageFileError: The file is damaged, or has colours, as a map in false colours.
    """
    for number, colors in enumerate(_encoded_frames(info, first), first + 1):
        tint = float(np.mean(np.ptp(colors[::_TINT_STRIDE_PX, ::_TINT_STRIDE_PX], 2)))
        if tint > _MAX_TINT:
            raise ImageFileError(
                f"{info.path}: expected a grey video of disparity, found colours in frame {number}, "
                f"{tint:.2g} apart on average; write grey, or decode false colours with a folder of maps"
            )
        yield info.display.shown(np.clip(colors.mean(2), 0, 1))


def write_segment(path: Path, info: VideoInfo, frames: Iterable[tuple[int, Array]], codec: str) -> None:
    """Write some frames of a video, atomically.

    Args:
        path: File to write.
        info: Source video: its size, colours and range are kept.
        frames: Times in the video's units, and scene-linear light, (H, W, 3).
        codec: One of ``CODECS``.
    """
    av = _import_av()
    name = target_pixels(info, codec)
    pixels = PixelFormat.named(name, info.codes[2], info.full)
    context = av.CodecContext.create(CODECS[codec][0], "w")
    context.options = dict(CODECS[codec][1])
    _configure(av, context, info, codec)
    packets = []
    for time, light in frames:
        colors = info.space.encode(np.clip(info.display.stored(light), 0, None))
        frame = _make_frame(av, name, pixels.planes(colors))
        frame.pts, frame.time_base = time, info.time_base
        packets += context.encode(frame)
    packets += context.encode(None)
    kept = {
        "data": np.frombuffer(b"".join(map(bytes, packets)), np.uint8),
        "sizes": np.array([packet.size for packet in packets]),
        "times": np.array([packet.pts for packet in packets]),
        "keys": np.array([packet.is_keyframe for packet in packets]),
    }

    def fill(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **kept)

    write_atomic(path, fill)


def join_segments(path: Path, info: VideoInfo, segments: list[Path], codec: str) -> None:
    """Write a video from segments, with the sound and the timecode of the source video, atomically.

    Raises:
        ImageFileError: The format cannot hold the sound, or segments are missing.
    """
    av = _import_av()

    def fill(temporary: Path) -> None:
        with (
            av.open(str(info.path), metadata_errors="replace") as source,
            av.open(str(temporary), "w") as target,
        ):
            encoder, options = CODECS[codec]
            stream = target.add_stream(encoder, rate=info.rate, options=dict(options))
            _configure(av, stream.codec_context, info, codec)
            stream.time_base = info.time_base
            if info.display != IDENTITY:
                stream.set_display_matrix(info.display.numbers)
            if info.timecode:
                stream.metadata["timecode"] = target.metadata["timecode"] = info.timecode
            sounds = {one.index: target.add_stream_from_template(one) for one in source.streams.audio}
            pictures = _video_packets(av, segments, stream, info)
            for _, packet in heapq.merge(
                pictures, _audio_packets(source, sounds), key=lambda timed: timed[0]
            ):
                target.mux(packet)

    try:
        write_atomic(path, fill)
    except (av.error.FFmpegError, ValueError) as error:
        raise ImageFileError(
            f"{path}: this format cannot hold the streams of {info.path} ({_reason(error)}); "
            "write to .mov or .mkv"
        ) from error


def target_pixels(info: VideoInfo, codec: str) -> str:
    """Return FFmpeg's name of the pixel format that a codec stores for a video.

    The resolution of chroma is kept, except that ProRes has 4:2:2 at least; so are up to 10 bits.
    """
    planar = _planar(info.pixels).replace("yuvj", "yuv").replace("gray", "yuv444p")
    if codec == "ffv1":
        return planar
    chroma = planar.removeprefix("yuv")[:3]
    if codec == "prores":
        return "yuv444p10le" if chroma == "444" and not info.pixels.startswith("gray") else "yuv422p10le"
    if info.pixels.startswith("gray"):
        chroma = "420"
    return f"yuv{chroma}p10le" if info.bits > 8 and codec == "h265" else f"yuv{chroma}p"


def choose_codec(path: Path, info: VideoInfo, requested: str | None) -> str:
    """Return the codec of a result: the requested one, otherwise by its extension and the bits of the video.

    Raises:
        ParameterError: The codec cannot keep the transfer function, or the format does not support it.
    """
    extension = path.suffix.lower()
    default = {".mov": "prores", ".mkv": "ffv1"}.get(extension, "h264" if info.bits == 8 else "h265")
    codec = requested or default
    if extension in (".mp4", ".m4v") and codec in ("prores", "ffv1"):
        raise ParameterError("--video-codec", "h264 or h265 in MP4", codec, "write to .mov or .mkv")
    if extension == ".mkv" and codec in ("prores", "ffv1") and info.aspect != 1:
        raise ParameterError(
            "--video-codec",
            f"h264 or h265 in MKV for pixels of {info.aspect} times their height, which only they keep there",
            codec,
            "write to .mov",
        )
    if codec in ("h264", "h265") and any(
        side % 2 and halved for side, halved in zip(info.stored_size, _halved(info, codec), strict=True)
    ):
        raise ParameterError(
            "--video-codec",
            f"ffv1 or prores for the odd size {info.width}x{info.height} with chroma at half of it",
            codec,
            "write to .mkv or .mov",
        )
    if codec == "h264" and info.bits > 8:
        raise ParameterError("--video-codec", f"h265, prores or ffv1 for {info.bits} bits", codec)
    if codec == "h264" and info.codes[1] in (16, 18):
        raise ParameterError("--video-codec", "h265, prores or ffv1 for PQ and HLG", codec)
    return codec


def _import_av() -> Any:
    require_extra("av", "video")
    return importlib.import_module("av")


def _encoded_frames(info: VideoInfo, first: int) -> Iterator[Array]:
    name = _planar(info.pixels)
    pixels = PixelFormat.named(name, info.codes[2], info.full)
    with _open(info.path) as container:
        stream = _video_stream(info.path, container)
        stream.thread_type = "AUTO"
        count = 0
        for frame in container.decode(stream):
            count += 1
            if count > first:
                frame = frame if frame.format.name == name else frame.reformat(format=name)
                yield pixels.colors(_planes(frame, pixels))
    if count != len(info.times):
        raise ImageFileError(
            f"{info.path}: expected {len(info.times)} frames, found {count} that can be read"
        )


def _planes(frame: Any, pixels: PixelFormat) -> list[npt.NDArray[np.unsignedinteger]]:
    kind: Any = np.uint8 if pixels.bits == 8 else "<u2"
    planes = []
    for plane in frame.planes:
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[: plane.height]
        planes.append(np.ascontiguousarray(rows).view(kind)[:, : plane.width])
    return planes


def _make_frame(av: Any, name: str, planes: list[npt.NDArray[np.uint16]]) -> Any:
    height, width = planes[0].shape
    frame = av.VideoFrame(width, height, name)
    for plane, values in zip(frame.planes, planes, strict=True):
        rows = values.astype(np.uint8 if frame.format.components[0].bits == 8 else "<u2")
        padded = np.zeros((plane.buffer_size // plane.line_size, plane.line_size), np.uint8)
        stored = np.ascontiguousarray(rows).view(np.uint8)
        padded[: len(stored), : stored.shape[1]] = stored
        plane.update(padded.tobytes())
    return frame


def _configure(av: Any, context: Any, info: VideoInfo, codec: str) -> None:
    """Set size, times, colours and range of an encoder to those of a video."""
    context.width, context.height = info.stored_size
    context.pix_fmt = target_pixels(info, codec)
    if codec == "prores" and context.pix_fmt.startswith("yuv444"):
        context.options = {**context.options, "profile": "4"}
    if codec == "h265" and context.width < _MIN_CUTREE_WIDTH_PX:
        parameters = context.options["x265-params"] + ":cutree=0"
        context.options = {**context.options, "x265-params": parameters}
    context.time_base, context.framerate, context.gop_size = info.time_base, info.rate, 24
    context.color_primaries, context.color_trc, context.colorspace = info.codes
    context.color_range = 2 if info.full else 1
    context.sample_aspect_ratio = info.aspect
    context.flags |= int(av.codec.context.Flags.global_header)


def _video_packets(
    av: Any, segments: list[Path], stream: Any, info: VideoInfo
) -> Iterator[tuple[float, Any]]:
    """Yield the pictures of all segments with their times in seconds; each lasts until the next one."""
    ends = dict(zip(info.times, info.times[1:], strict=False))
    written = []
    for segment in segments:
        with np.load(segment) as kept:
            data, first = kept["data"].tobytes(), 0
            for size, time, key in zip(
                *(kept[name].tolist() for name in ("sizes", "times", "keys")), strict=True
            ):
                packet = av.Packet(data[first : first + size])
                packet.pts = packet.dts = time
                packet.time_base, packet.is_keyframe, packet.stream = info.time_base, key, stream
                if time in ends:
                    packet.duration = ends[time] - time
                first += size
                written.append(time)
                yield float(time * info.time_base), packet
    if tuple(written) != info.times:
        raise ImageFileError(f"{info.path}: expected {len(info.times)} rendered frames, found {len(written)}")


def _audio_packets(source: Any, sounds: dict[int, Any]) -> Iterator[tuple[float, Any]]:
    if not sounds:
        return
    for packet in source.demux(tuple(source.streams.audio)):
        if packet.pts is None or not packet.size:
            continue
        time, packet.stream = float(packet.pts * packet.time_base), sounds[packet.stream.index]
        yield time, packet


@contextlib.contextmanager
def _open(path: Path | str) -> Iterator[Any]:
    """Open a video; its bytes from strangers may be anything, so that texts need not be UTF-8."""
    av = _import_av()
    check_name(Path(path))
    with errors_of_file(path, "a video", ImageFileError):
        try:
            with av.open(str(path), metadata_errors="replace") as container:
                yield container
        except BokehnetError:  # some are also OSError
            raise
        except (av.error.FFmpegError, OSError) as error:
            raise ImageFileError(
                f"{path}: expected a video, the file cannot be read: {_reason(error)}"
            ) from error


def _video_stream(path: Path | str, container: Any) -> Any:
    if not container.streams.video:
        raise ImageFileError(f"{path}: expected a video, found no pictures in it")
    return container.streams.video[0]


def _halved(info: VideoInfo, codec: str) -> tuple[bool, bool]:
    """Return whether the columns and rows of chroma have half the resolution in the result."""
    return PixelFormat.named(target_pixels(info, codec), info.codes[2], info.full).halved


def _display_matrix(path: Path | str) -> DisplayMatrix:
    """Return the transformation of the first picture of a video."""
    with _open(path) as container:
        frame = next(container.decode(_video_stream(path, container)), None)
    display = IDENTITY if frame is None else DisplayMatrix.of_frame(frame)
    if display is None:
        raise ImageFileError(
            f"{path}: expected a display matrix of quarter turns and flips, found another one; "
            "turn the video with a video editor first"
        )
    return display


def _planar(name: str) -> str:
    return {"nv12": "yuv420p", "p010le": "yuv420p10le"}.get(name, name)


def _reason(error: Exception) -> str:
    return " ".join(str(error).split())
