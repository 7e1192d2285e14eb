"""Settings that change from frame to frame, and the rules that keep the frames of a sequence consistent.

A pull moves focus, f-number or blur from key to key. All maps of a sequence are read in the same
way: their stored values are used, without normalisation per frame, and each frame has its own noise.
"""

import csv
import io
import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from bokehnet.errors import ConfigError, ParameterError, errors_of_file
from bokehnet.io.files.text import read_text
from bokehnet.sequence.frame_names import frame_path, is_pattern, parse_frames
from bokehnet.settings.fields import Group, field_settings, setting
from bokehnet.settings.settings import RenderSettings

if TYPE_CHECKING:
    from bokehnet.sequence.tracking import TrackedPoint  # imports NumPy

__all__ = [
    "PULL_PARAMETERS",
    "Pull",
    "SequenceSettings",
    "input_files",
    "make_pull",
    "read_pull",
    "settings_at_frame",
]

# Name in pull files, and path of the setting.
_PATHS = {
    "focus": "focus.value",
    "focus_distance": "focus.distance",
    "f_number": "camera.f_number",
    "blur": "camera.blur",
    "focus_at_x": "focus.at",
    "focus_at_y": "focus.at",
}

# Parameters of a pull; True if interpolated linearly in the inverse: blur radii are linear in disparity, the
# inverse distance, and in the pupil diameter, which is inverse to the f-number.
PULL_PARAMETERS = {"focus": False, "focus_distance": True, "f_number": True, "blur": False}
PULL_PARAMETERS |= {"focus_at_x": False, "focus_at_y": False}


def _parse_track(text: str) -> tuple[int, ...]:
    pixel, _, frame = text.partition("@")
    x, y = (int(part) for part in pixel.split(","))
    return (x, y, int(frame)) if frame else (x, y)


@dataclass(frozen=True, kw_only=True, slots=True)
class SequenceSettings(Group):
    """Frames to render, and a pull over them, defined by its ends or by a file of keys.

    Examples:
        >>> shot = SequenceSettings(frames=parse_frames("1001-1003"), blur_from=20, blur_to=60)
        >>> make_pull(shot.frames, shot, metric=False).at(1002)  # pixels per unit of disparity
        {'blur': 40.0}
    """

    GROUP: ClassVar[str] = "sequence"
    TITLE: ClassVar[str] = "Sequences"

    frames: tuple[int, ...] | None = setting(
        None,
        "Render a sequence, such as 1001-1100 or 1001-1100x2; #### or %04d in names is the frame.",
        metavar="RANGE",
        parse=parse_frames,
        low=0,
    )
    focus_from: float | None = setting(
        None,
        "With --frames: focus of the first frame, metres with --depth, 0..1 with --disparity.",
        infinite=True,
    )
    focus_to: float | None = setting(
        None, "Focus of the last frame; linear in disparity between.", infinite=True
    )
    f_number_from: float | None = setting(None, "With --frames: f-number of the first frame.")
    f_number_to: float | None = setting(None, "F-number of the last frame; linear in blur between.")
    blur_from: float | None = setting(None, "With --frames: --blur of the first frame.")
    blur_to: float | None = setting(None, "Blur of the last frame.")
    track: tuple[int, ...] | None = setting(
        None,
        "Focus on the thing at this pixel of the first frame, or of FRAME, and follow it through the shot.",
        metavar="X,Y[@FRAME]",
        parse=_parse_track,
        low=0,
        expected="a pixel X,Y, or X,Y@FRAME",
    )
    file: Path | None = setting(
        None,
        "With --frames: columns frame and focus, focus_distance, f_number, blur, or focus_at_x and "
        "focus_at_y; linear between its rows.",
        flag="pull",
        metavar="FILE.csv",
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Pull:
    """Keys of the settings that change over a sequence.

    Between two keys each pixel's blur radius changes by the same amount from frame to frame: focus moves
    linearly in disparity (a pull from 1 m to infinity passes 2 m half-way), the f-number linearly in its
    inverse. Before the first and after the last key the value is constant.

    Attributes:
        keys: (frame, value) pairs in ascending frame order, by name from ``PULL_PARAMETERS``.

    Examples:
        >>> pull = Pull(keys={"focus_distance": [(1, 1.0), (11, math.inf)]})
        >>> pull.at(6)  # m, half-way
        {'focus_distance': 2.0}
    """

    keys: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)

    def at(self, frame: int) -> dict[str, float]:
        """Return the value of each name at ``frame``."""
        return {name: _value_at(frame, keys, PULL_PARAMETERS[name]) for name, keys in self.keys.items()}


def make_pull(
    frames: Sequence[int],
    settings: SequenceSettings,
    *,
    metric: bool,
    path: "Sequence[TrackedPoint]" = (),
) -> Pull:
    """Return the pull over the frames.

    Args:
        frames: Frames in ascending order.
        settings: Ends of the pull, or a file of keys.
        metric: True if focus is in metres, False for relative disparity.
        path: Positions of the thing that ``settings.track`` follows.

    Raises:
        ParameterError: Only one end is set, or ends as well as a file.
        ConfigError: As for :func:`read_pull`.

    Examples:
        >>> pull = make_pull([1, 2, 3], SequenceSettings(focus_from=0.0, focus_to=1.0), metric=False)
        >>> pull.at(2)
        {'focus': 0.5}
    """
    keys: dict[str, Sequence[tuple[int, float]]] = {}
    for name, option in (
        ("focus_distance" if metric else "focus", "focus"),
        ("f_number",) * 2,
        ("blur",) * 2,
    ):
        first, last = getattr(settings, f"{option}_from"), getattr(settings, f"{option}_to")
        if first is None and last is None:
            continue
        if settings.file is not None:
            raise ParameterError(
                "sequence.file",
                expected="either `sequence.file` or the ends of a pull",
                shown="both",
            )
        if first is None or last is None:
            raise ParameterError(
                f"sequence.{option}_{'from' if first is None else 'to'}",
                expected=f"both `sequence.{option}_from` and `sequence.{option}_to`",
                shown="one",
            )
        keys[name] = [(frames[0], first), (frames[-1], last)]
    keys = keys if settings.file is None else dict(read_pull(settings.file).keys)
    if path:
        clash = next((name for name in keys if name.startswith("focus")), None)
        if clash is not None:
            shown, remedy = f"a pull of {clash}", "leave one out"
            raise ParameterError("sequence.track", expected="no other focus", shown=shown, remedy=remedy)
        keys["focus_at_x"] = [(point.number, point.x) for point in path]
        keys["focus_at_y"] = [(point.number, point.y) for point in path]
    return Pull(keys=keys)


def settings_at_frame(settings: RenderSettings, frame: int, pull: Pull | None = None) -> RenderSettings:
    """Return the settings of one frame, with its files and the values of the pull.

    Args:
        settings: Settings of all frames; file names may contain a placeholder, such as ``z.####.exr``.
        frame: Frame number.
        pull: Settings that change over the frames.

    Raises:
        ParameterError: A pulled value is also set, or is out of range.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> shot = RenderSettings(input=InputSettings(depth="z.####.exr"))
        >>> str(settings_at_frame(shot, 7).input.depth)
        'z.0007.exr'
    """
    changes: dict[str, dict[str, Any]] = {"input": {}, "depth": {}, "focus": {}, "camera": {}}
    for name, path in input_files(settings).items():
        changes["input"][name] = frame_path(path, frame)
    disparity = settings.input.disparity
    if disparity is not None and is_pattern(disparity):
        changes["depth"]["as_stored"] = True
    pulled: dict[str, Any] = {} if pull is None else dict(pull.at(frame))
    if "focus_at_x" in pulled:
        pixel = (round(pulled.pop("focus_at_x")), round(pulled.pop("focus_at_y")))
        pulled = {"focus_at_x": pixel, **pulled}
    for name, value in pulled.items():
        group, _, field_name = _PATHS[name].partition(".")
        if getattr(getattr(settings, group), field_name) is not None:
            raise ParameterError(
                _PATHS[name], expected="either a value or a pull of it", shown="both", remedy="leave one out"
            )
        changes[group][field_name] = value
    return settings.updated(changes)


def input_files(settings: RenderSettings) -> dict[str, Path]:
    """Return the input files other than the picture, by field.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> shot = RenderSettings(input=InputSettings(depth="z.####.exr"))
        >>> {name: str(path) for name, path in input_files(shot).items()}
        {'depth': 'z.####.exr'}
    """
    known = field_settings(settings.input).values()
    paths = {item.name: getattr(settings.input, item.name) for item in known if item.type is Path}
    return {name: path for name, path in paths.items() if path is not None}


def read_pull(path: Path) -> Pull:
    """Read a CSV file with the column ``frame`` and some of ``PULL_PARAMETERS``; each row is a key.

    Empty cells are no keys.

    Raises:
        ConfigError: The file cannot be read or has other content.

    Examples:
        >>> with open("pull.csv", "w", newline="") as file:
        ...     csv.writer(file).writerows([("frame", "blur"), (1001, 20), (1003, 60)])
        >>> read_pull(Path("pull.csv")).at(1002)
        {'blur': 40.0}
    """
    with errors_of_file(path, "a CSV file", ConfigError):
        return _pull_of(path, read_text(path, expected="a CSV file"))


def _pull_of(path: Path, text: str) -> Pull:
    try:
        rows = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
        names = [name.strip() for name in rows.fieldnames or ()]
        _check_columns(path, names)
        rows.fieldnames = names
        keys = _read_keys(path, rows, names)
    except csv.Error as error:
        raise ConfigError(f"{path}: expected a CSV file, found an error: {error}") from error
    if ("focus_at_x" in keys) != ("focus_at_y" in keys):
        raise ConfigError(f"{path}: expected both columns focus_at_x and focus_at_y, found one")
    empty = [name for name, values in keys.items() if not values]
    if empty or not keys:
        raise ConfigError(f"{path}: expected a value in each column, found none for {', '.join(empty)}")
    return Pull(keys={name: sorted(values.items()) for name, values in keys.items()})


def _check_columns(path: Path, names: list[str]) -> None:
    known = ("frame", *PULL_PARAMETERS)
    if "frame" not in names or len(names) < 2 or len(set(names)) < len(names) or set(names) - set(known):
        raise ConfigError(
            f"{path}: expected the column frame and some of {', '.join(PULL_PARAMETERS)}, "
            f"found {', '.join(names) or 'nothing'}"
        )


def _read_keys(path: Path, rows: "csv.DictReader[str]", names: list[str]) -> dict[str, dict[int, float]]:
    keys: dict[str, dict[int, float]] = {name: {} for name in names if name != "frame"}
    seen: set[int] = set()
    for row in rows:
        location = f"{path}, line {rows.line_num}"
        try:
            frame = int(row["frame"] or "")
            values = {name: float(row[name]) for name in keys if (row[name] or "").strip()}
        except ValueError as error:
            raise ConfigError(f"{location}: expected a whole frame and numbers: {error}") from error
        if None in row or any(math.isnan(value) for value in values.values()):
            raise ConfigError(f"{location}: expected one number a column, found more, or NaN")
        if frame in seen:
            raise ConfigError(f"{location}: frame {frame} occurs twice; keep one")
        seen.add(frame)
        for name, value in values.items():
            keys[name][frame] = value
    return keys


def _value_at(frame: int, keys: Sequence[tuple[int, float]], by_inverse: bool) -> float:
    index = bisect_left(keys, frame, key=lambda key: key[0])
    if index == len(keys):
        return keys[-1][1]
    after, second = keys[index]
    if index == 0 or after == frame:
        return second
    before, first = keys[index - 1]
    weight = (frame - before) / (after - before)
    if not by_inverse:
        return (1 - weight) * first + weight * second
    if min(first, second) <= 0:
        raise ParameterError(f"a pull: expected distances and f-numbers above 0, got {min(first, second):g}")
    inverse = (1 - weight) / first + weight / second
    return 1 / inverse if inverse else math.inf
