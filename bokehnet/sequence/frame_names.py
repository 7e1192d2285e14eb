"""Frame numbers and the names of numbered files: ``1001-1100x2`` and ``shot.####.exr``."""

import os
import re
from collections.abc import Iterable
from pathlib import Path

from bokehnet.errors import ParameterError

__all__ = ["existing_frames", "format_frames", "frame_path", "is_pattern", "parse_frames"]

# Frame number in a file name: #### or %04d, one # or digit for each digit.
_NUMBER = re.compile(r"#+|%(?:0(\d{1,2}))?d")

_PART = re.compile(r"(\d{1,9})(?:-(\d{1,9})(?:x(\d{1,9}))?)?")

_MAX_FRAMES = 1_000_000


def parse_frames(text: str) -> tuple[int, ...]:
    """Return the frames of ``1001-1100``, ``1001-1100x2`` (every second) or ``1,5,10-20``, ascending.

    Raises:
        ParameterError: ``text`` has another form, or names more than a million frames.

    Examples:
        >>> parse_frames("1001-1007x2,1010")
        (1001, 1003, 1005, 1007, 1010)
    """
    frames: set[int] = set()
    for part in text.split(","):
        match = _PART.fullmatch(part.strip())
        if match is None:
            raise ParameterError(
                "frames", expected="frames such as 1001-1100, 1001-1100x2 or 1,5,10-20", got=text
            )
        first, last, step = int(match[1]), int(match[2] or match[1]), int(match[3] or 1)
        if last < first or step < 1:
            raise ParameterError("frames", expected="FIRST-LAST or FIRST-LASTxSTEP that rises", got=part)
        steps = range(first, last + 1, step)
        if len(frames) + len(steps) > _MAX_FRAMES:
            raise ParameterError("frames", expected=f"at most {_MAX_FRAMES} frames", got=text)
        frames.update(steps)
    return tuple(sorted(frames))


def format_frames(frames: Iterable[int]) -> str:
    """Return the text that :func:`parse_frames` reads as these frames, with consecutive frames as ranges.

    Examples:
        >>> format_frames([1001, 1002, 1003, 1010])
        '1001-1003,1010'
    """
    runs: list[list[int]] = []
    for frame in sorted(frames):
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    return ",".join(f"{first}" if first == last else f"{first}-{last}" for first, last in runs)


def is_pattern(path: Path) -> bool:
    """Return whether the name of ``path`` has a placeholder for a frame number.

    Examples:
        >>> is_pattern(Path("shot.####.exr")), is_pattern(Path("shot.%04d.exr")), is_pattern(Path("shot.exr"))
        (True, True, False)
    """
    return _NUMBER.search(path.name) is not None


def frame_path(path: Path, frame: int) -> Path:
    """Return ``path`` with the last ``####`` or ``%04d`` of its name replaced by ``frame``, zero-padded.

    A path without placeholder belongs to every frame and is returned unchanged.

    Examples:
        >>> frame_path(Path("shot.####.exr"), 7).name
        'shot.0007.exr'
    """
    placeholders = list(_NUMBER.finditer(path.name))
    if not placeholders:
        return path
    last = placeholders[-1]
    width = len(last[0]) if last[0][0] == "#" else int(last[1] or 1)
    return path.with_name(f"{path.name[: last.start()]}{frame:0{width}d}{path.name[last.end() :]}")


def existing_frames(path: Path) -> set[int]:
    """Return the frames whose files exist, for a path with a placeholder.

    Examples:
        >>> for name in ("shot.0007.exr", "shot.12.exr", "shot.0009.png"):
        ...     Path(name).touch()
        >>> existing_frames(Path("shot.####.exr"))
        {7}
    """
    last = list(_NUMBER.finditer(path.name))[-1]
    before, after = path.name[: last.start()], path.name[last.end() :]
    try:
        names = [entry.name for entry in os.scandir(path.parent)]
    except OSError:  # reported when a frame is read
        return set()
    frames = set()
    for name in names:
        digits = name[len(before) : len(name) - len(after)]
        if name.startswith(before) and name.endswith(after) and re.fullmatch(r"[0-9]{1,9}", digits):
            frames.add(int(digits))
    known = set(names)
    return {frame for frame in frames if frame_path(path, frame).name in known}
