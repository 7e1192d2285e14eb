"""Focus and aperture pulls: numbers that change over a sequence, from key to key."""

import csv
import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bokehnet.errors import ConfigError, ParameterError

__all__ = ["PULLED", "Pull", "read_pull"]

# What can be pulled, and whether it moves evenly by its inverse: blur radii are linear in disparity, which is
# inverse distance, and in the pupil's diameter, which is inverse to the f-number.
PULLED = {"focus": False, "focus_distance": True, "f_number": True, "blur": False}


@dataclass(frozen=True, kw_only=True, slots=True)
class Pull:
    """Keys of what changes over a sequence.

    Between two keys each pixel's blur radius changes by the same amount from frame to frame: focus moves
    linearly in disparity (a pull from 1 m to infinity passes 2 m half-way), the f-number linearly in its
    inverse. Before the first and behind the last key the value stays.

    Attributes:
        keys: Name, one of ``PULLED``, to (frame, value), frames rising.
    """

    keys: Mapping[str, Sequence[tuple[int, float]]] = field(default_factory=dict)

    def at(self, frame: int) -> dict[str, float]:
        """Return the value of each name at ``frame``."""
        return {name: _value_at(frame, keys, PULLED[name]) for name, keys in self.keys.items()}


def read_pull(path: Path) -> Pull:
    """Read a CSV file with the column ``frame`` and some of ``PULLED``; a row is a key, empty cells are none.

    Raises:
        ConfigError: The file cannot be read or holds something else.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            names = [name.strip() for name in rows.fieldnames or ()]
            _check_columns(path, names)
            rows.fieldnames = names
            keys = _read_keys(path, rows, names)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: expected a CSV file, found an error: {error}") from error
    empty = [name for name, of_name in keys.items() if not of_name]
    if empty or not keys:
        raise ConfigError(f"{path}: expected a value in each column, found none for {', '.join(empty)}")
    return Pull(keys={name: sorted(of_name.items()) for name, of_name in keys.items()})


def _check_columns(path: Path, names: list[str]) -> None:
    known = ("frame", *PULLED)
    if "frame" not in names or len(names) < 2 or len(set(names)) < len(names) or set(names) - set(known):
        raise ConfigError(
            f"{path}: expected the column frame and some of {', '.join(PULLED)}, "
            f"found {', '.join(names) or 'nothing'}"
        )


def _read_keys(path: Path, rows: "csv.DictReader[str]", names: list[str]) -> dict[str, dict[int, float]]:
    keys: dict[str, dict[int, float]] = {name: {} for name in names if name != "frame"}
    seen: set[int] = set()
    for row in rows:
        place = f"{path}, line {rows.line_num}"
        try:
            frame = int(row["frame"] or "")
            values = {name: float(row[name]) for name in keys if (row[name] or "").strip()}
        except ValueError as error:
            raise ConfigError(f"{place}: expected a whole frame and numbers: {error}") from error
        if None in row or any(math.isnan(value) for value in values.values()):
            raise ConfigError(f"{place}: expected one number a column, found more, or NaN")
        if frame in seen:
            raise ConfigError(f"{place}: frame {frame} stands there twice; keep one")
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
    share = (frame - before) / (after - before)
    if not by_inverse:
        return (1 - share) * first + share * second
    if min(first, second) <= 0:
        raise ParameterError(f"a pull: expected distances and f-numbers above 0, got {min(first, second):g}")
    inverse = (1 - share) / first + share / second
    return 1 / inverse if inverse else math.inf
