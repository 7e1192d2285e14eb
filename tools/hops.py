"""Files and rooms that an option passes on its way to a kernel: ``python -m tools.hops [OPTION ...]``.

The command renders a small picture with ``bokehnet render``, in this process and under a profiler. The option
has a value that nothing else has, so that the profiler recognizes it in arguments and results: by itself,
in a dataclass or a collection, as the first pixel of a map, and as the defocus computed from it. Contents of
closures, such as progress callbacks, are not followed.
A file is counted if one of its functions

- is on the stack when the first kernel of :mod:`bokehnet.classical` receives the value; of an aperture, the
  first function of :mod:`bokehnet.optics.aperture`, whose points the kernels receive; or
- received the value before, and returned it in another object.

Functions that only check or report the value are not counted, nor are other threads. The list begins with the
command line on the stack, continues with the files that returned the value in the order of the first return,
and ends with the rest of the stack and the kernel. Rooms are the folders of the package; a room is re-entered
if a file between two of its files ran outside it, that is, without a function of the room on the stack.
"""

import argparse
import contextlib
import dataclasses
import io
import sys
import tempfile
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import groupby
from pathlib import Path
from types import CodeType, FrameType
from typing import Any
from unittest import mock

import numpy as np

import bokehnet

__all__ = ["Way", "way_of"]

PACKAGE = Path(bokehnet.__file__).parent

# Binary fractions, so that their products are exact; blades are an integer, recognized with its name.
DISPARITY, FOCUS, BLUR, BLADES = 0.828125, 0.265625, 5.8125, 11
DEFOCUS = BLUR * (DISPARITY - FOCUS)

# Option -> its value and that of the maps computed from it.
VALUES: dict[str, tuple[float, ...]] = {
    "blur": (BLUR, DEFOCUS),
    "focus": (FOCUS, DEFOCUS),
    "disparity": (DISPARITY, DEFOCUS),
    "blades": (BLADES,),
}

_MAX_DEPTH, _MAX_ITEMS = 6, 64


@dataclasses.dataclass(frozen=True)
class Way:
    """Way of an option from the command line to the kernel.

    Attributes:
        files: Files, relative to the package, in order.
        callers: Rooms on the stack when each file returned the value, or received it last.
    """

    files: list[str]
    callers: list[frozenset[str]]

    @property
    def rooms(self) -> list[str]:
        """Rooms in order; a room appears again where the way re-enters it."""
        return [room for room, _ in groupby(self.files, key=_room_of)]

    @property
    def re_entered(self) -> list[str]:
        """Rooms that the way leaves, and enters again."""
        left: set[str] = set()
        seen: set[str] = set()
        again = set()
        for file, callers in zip(self.files, self.callers, strict=True):
            inside = callers | {_room_of(file)}
            again |= inside & left
            seen.add(_room_of(file))
            left = (left | seen) - inside
        return sorted(again)


class _KernelReached(BaseException):
    """End of the recording: a kernel has received the value."""


class _Recorder:
    """Profiler that records files until a classical kernel receives the value of an option."""

    def __init__(self, option: str) -> None:
        self._option, self._values = option, VALUES[option]
        self._returned: dict[str, frozenset[str]] = {}  # callers' rooms by file, in order
        self._received: dict[int, tuple[list[Any], bool]] = {}
        self.way: Way | None = None

    def __call__(self, frame: FrameType, event: str, result: Any) -> None:
        """Record one call or return of a function of the package."""
        if self.way is not None or event not in ("call", "return"):
            return
        file = _file_of(frame.f_code)
        if file is None or frame.f_code.co_name.startswith("<"):  # comprehensions belong to their function
            return
        if event == "call":
            arguments = _arguments(frame)
            holds = any(self._holds(value, name) for name, value in arguments.items())
            self._received[id(frame)] = list(arguments.values()), holds
            if holds and file == "precompiled/kernel.py" and frame.f_code.co_name == "__call__":
                self._reach(frame, arguments["self"].function.__module__)
            elif holds and file == "optics/aperture.py":
                self._reach(frame, "bokehnet.optics.aperture")
            return
        values, holds = self._received.pop(id(frame), ([], False))
        results = result if type(result) is tuple else (result,)
        new = [one for one in results if not any(one is value for value in values)]
        if holds and self._holds(new, "") and file not in self._returned:
            self._returned[file] = _rooms_of(_stack(frame.f_back))

    def _reach(self, frame: FrameType, module: str) -> None:
        """End the recording if a function of ``module`` is or belongs to a classical kernel."""
        stack = _stack(frame.f_back)
        own = module.removeprefix("bokehnet.").replace(".", "/") + ".py"
        if not any(file.startswith("classical/") for file in (own, *stack)):
            return
        outer = next((i for i, file in enumerate(stack) if not file.startswith("cli/")), len(stack))
        files = dict.fromkeys(stack[:outer], _rooms_of(stack[:outer]))
        files |= {file: rooms for file, rooms in self._returned.items() if file not in stack}
        files |= dict.fromkeys([*stack[outer:], own], _rooms_of(stack))
        self.way = Way([*files], [*files.values()])
        raise _KernelReached

    def _holds(self, value: Any, name: str, depth: int = 0) -> bool:
        """Return whether a value, which has a name, is or contains that of the option."""
        if depth > _MAX_DEPTH or value is None or isinstance(value, bool | str | bytes | type):
            return False
        if isinstance(value, np.ndarray):
            return value.ndim >= 2 and value.size > 0 and value.flat[0] in self._values
        if isinstance(value, int):
            return name == self._option and value in self._values
        if isinstance(value, float | np.floating):
            return float(value) in self._values
        return any(self._holds(item, key, depth + 1) for key, item in _items(value))


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the named contents of a container."""
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield field.name, getattr(value, field.name, None)
    elif isinstance(value, dict):
        for key in list(value)[:_MAX_ITEMS]:
            yield str(key), value[key]
    elif isinstance(value, list | tuple):
        for item in value[:_MAX_ITEMS]:
            yield "", item
    elif isinstance(value, partial):
        yield "", value.args
        yield "", value.keywords


def _arguments(frame: FrameType) -> dict[str, Any]:
    """Return the arguments of a call; of a generator that continues, those of its start."""
    code = frame.f_code
    count = code.co_argcount + code.co_kwonlyargcount + bool(code.co_flags & 4) + bool(code.co_flags & 8)
    names = (*code.co_varnames[:count], *code.co_freevars)
    return {name: frame.f_locals[name] for name in names if name in frame.f_locals}


def _file_of(code: CodeType) -> str | None:
    """Return the file of code, relative to the package; None for code of others."""
    path = Path(code.co_filename)
    return str(path.relative_to(PACKAGE)) if path.is_relative_to(PACKAGE) else None


def _stack(frame: FrameType | None) -> list[str]:
    """Return the files of the package on the stack, the outermost first."""
    stack: list[str] = []
    while frame is not None:
        if (file := _file_of(frame.f_code)) is not None:
            stack.insert(0, file)
        frame = frame.f_back
    return stack


def _room_of(file: str) -> str:
    return file.split("/")[0]


def _rooms_of(files: Iterable[str]) -> frozenset[str]:
    return frozenset(map(_room_of, files))


def way_of(option: str) -> Way:
    """Return the way of ``blur``, ``focus``, ``disparity`` or ``blades`` through one render by rays.

    Raises:
        RuntimeError: No kernel received the value.
    """
    from bokehnet.cli.app import run
    from bokehnet.io.image import write_image

    recorder = _Recorder(option)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        height, width = 36, 52
        disparity = np.full((height, width, 3), DISPARITY, np.float32)
        disparity[8:28, 12:40] = 0.140625
        disparity[-1, -2:] = [[0], [1]]  # both ends, so that reading keeps the scale
        picture = np.random.default_rng(0).uniform(0.2, 0.6, (height, width, 3)).astype(np.float32)
        write_image(folder / "picture.exr", picture)
        write_image(folder / "disparity.exr", disparity)
        words = ["render", str(folder / "picture.exr"), "--disparity", str(folder / "disparity.exr")]
        words += [
            "--focus",
            str(FOCUS),
            "--blur",
            str(BLUR),
            "--blades",
            str(BLADES),
            "--repair-disparity",
            "off",
        ]
        words += ["-o", str(folder / "bokeh.exr"), "--engine", "rays"]
        # Loading in the background would receive the value first.
        warm_up = mock.patch(
            "bokehnet.cli.render.frame.loading_kernels", return_value=contextlib.nullcontext()
        )
        sys.setprofile(recorder)
        try:
            with contextlib.redirect_stderr(io.StringIO()) as stderr, warm_up:
                run(words)
        except (_KernelReached, SystemExit):
            pass
        finally:
            sys.setprofile(None)
    if recorder.way is None:
        raise RuntimeError(f"no kernel received {option}: {stderr.getvalue()}")
    return recorder.way


def main() -> None:
    """Print the files of each option, and their number."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("options", nargs="*", metavar="OPTION", help=", ".join(VALUES))
    for option in parser.parse_args().options or VALUES:
        way = way_of(option)
        again = ", ".join(way.re_entered) or "none"
        print(f"{option}: {len(way.files)} files, {len(way.rooms)} rooms; re-entered: {again}")
        for file in way.files:
            print(f"    {file}")


if __name__ == "__main__":
    main()
