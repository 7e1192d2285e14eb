"""Resumption of a repeatedly killed video render: ``python -m benchmarks.speed.video`` (extra: video).

Makes a clip of uneven frame times with sound and a timecode, in which every frame encodes its number, renders
it in one run, and again in runs that are killed (SIGKILL) after some segments. Prints whether all frames are
present once and in order, at their times, with the same sound and timecode, and whether both files are equal.

With ``--once`` it renders in a single run and prints its frames per minute; ``--depth-video`` reads depth
from a video, with temporal filtering of its maps.
"""

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

import bokehnet
from bokehnet.arrays.resample import resample
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import read_image
from bokehnet.io.video.frames import video_info

_DEMO = Path(bokehnet.__file__).parent / "assets"
_BITS, _BASE = 9, Fraction(1, 24000)


def make_clip(path: Path, frames: int, width: int, height: int) -> None:
    """Write a clip that pans over the demo picture."""
    import av

    picture = read_image(_DEMO / "demo.png")
    larger = np.stack([resample(picture[..., i], height, width + 2 * frames) for i in range(3)], 2)
    shown = np.rint(255 * linear_to_srgb(np.clip(larger, 0, 1))).astype(np.uint8)
    side, now = width // (2 * _BITS), 0
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=24, options={"crf": "12", "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = stream.time_base = _BASE
        stream.metadata["timecode"] = "10:00:00:00"
        tone = container.add_stream("aac", rate=48000)
        for number in range(frames):
            colors = shown[:, 2 * number : 2 * number + width].copy()
            for bit in range(_BITS):
                colors[:side, side * bit : side * (bit + 1)] = 255 * (number >> bit & 1)
            frame = av.VideoFrame.from_ndarray(colors, "rgb24")
            frame.pts, frame.time_base = now, _BASE
            now += 1000 if number % 3 else 1500
            container.mux(stream.encode(frame.reformat(format="yuv420p")))
        container.mux(stream.encode(None))
        wave = (9000 * np.sin(np.arange(int(48000 * now * _BASE)) / 17)).astype(np.int16)
        for start in range(0, len(wave) - 1024, 1024):
            sound = av.AudioFrame.from_ndarray(wave[None, start : start + 1024], format="s16", layout="mono")
            sound.sample_rate, sound.pts, sound.time_base = 48000, start, Fraction(1, 48000)
            container.mux(tone.encode(sound))
        container.mux(tone.encode(None))


def make_depth(path: Path, frames: int, width: int, height: int) -> None:
    """Write the depth of the clip of :func:`make_clip` as a video, with noise of 1 % of its range."""
    import av

    near = np.asarray(linear_to_srgb(read_image(_DEMO / "demo_disparity.png")[..., 0]), np.float32)
    larger, rng = resample(near, height, width + 2 * frames), np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.width, stream.height, stream.pix_fmt = width, height, "gray"
        for number in range(frames):
            shown = larger[:, 2 * number : 2 * number + width]
            values = np.clip(shown + 0.01 * rng.standard_normal(shown.shape, np.float32), 0, 1)
            frame = av.VideoFrame.from_ndarray(np.rint(255 * values).astype(np.uint8), "gray")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def read_clip(path: Path) -> dict[str, Any]:
    """Return the frame numbers, their times, the sound packets, and the timecode."""
    import av

    info, numbers = video_info(path), []
    side = info.width // (2 * _BITS)
    part = slice(side // 4, side - side // 4)
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            grey = frame.to_ndarray(format="gray")[part]
            bits = (grey[:, side * bit : side * (bit + 1)][:, part].mean() > 128 for bit in range(_BITS))
            numbers.append(sum(int(on) << bit for bit, on in enumerate(bits)))
    with av.open(str(path)) as container:
        sound = [(one.pts, bytes(one)) for one in container.demux(audio=0) if one.size]
    return {"numbers": numbers, "times": info.times, "sound": sound, "timecode": info.timecode}


def killed_after(command: list[str], folder: Path, segments: int) -> bool:
    """Start a command and kill it after ``segments`` segments; return whether it was still running."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while process.poll() is None:
        with contextlib.suppress(FileNotFoundError):
            if sum(one.name[0] != "." for one in folder.glob("*.npz")) >= segments:
                process.kill()
                process.wait()
                return True
        time.sleep(0.02)
    return False


def main() -> None:
    """Print the comparison of both renders."""
    parser = argparse.ArgumentParser(description="Resumption of a repeatedly killed video render.")
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--engine", default="scatter")
    parser.add_argument("--once", action="store_true", help="only measure the time of one run")
    parser.add_argument(
        "--depth-video", action="store_true", help="read depth from a video instead of a single map"
    )
    arguments = parser.parse_args()
    width, height = map(int, arguments.size.split("x"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        clip, whole, parts = (folder / f"{one}.mp4" for one in ("clip", "whole", "parts"))
        make_clip(clip, arguments.frames, width, height)
        (folder / "pull.csv").write_text(f"frame,focus\n1,0.2\n{arguments.frames},0.8\n")
        words = [sys.executable, "-m", "bokehnet", "render", str(clip), "--engine", arguments.engine]
        depth = ["--disparity", str(_DEMO / "demo_disparity.png"), "--resize-disparity"]
        if arguments.depth_video:
            make_depth(folder / "depth.mkv", arguments.frames, width, height)
            depth = ["--disparity", str(folder / "depth.mkv")]
        words += [*depth, "--blur", "12"]
        words += ["--repair-disparity", "off", "--pull", str(folder / "pull.csv"), "--json", "-q", "-o"]
        start = time.perf_counter()
        subprocess.run([*words, str(whole)], check=True, stdout=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        print(
            f"one run: {seconds:.1f} s, {60 * arguments.frames / seconds:.1f} frames per minute", flush=True
        )
        if arguments.once:
            return
        segments_folder, segment_count = folder / f".bokehnet-video-{parts.name}", arguments.frames // 24
        kills = sum(
            killed_after([*words, str(parts)], segments_folder, round(fraction * segment_count))
            for fraction in (0.2, 0.5, 0.8)
        )
        done = subprocess.run([*words, str(parts)], check=True, capture_output=True, text=True).stdout
        print(f"killed {kills} times; the last run rendered {json.loads(done)['rendered']} frames")
        original, resumed = read_clip(clip), read_clip(parts)
        print("every frame once, in order:", resumed["numbers"] == list(range(arguments.frames)))
        for key in ("times", "sound", "timecode"):
            print(f"same {key}:", resumed[key] == original[key])
        print("same bytes as in one run:", whole.read_bytes() == parts.read_bytes())


if __name__ == "__main__":
    main()
