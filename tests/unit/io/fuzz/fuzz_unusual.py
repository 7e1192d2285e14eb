"""Feeds unusual files, whole and cut, to the readers.

Command: ``python -m tests.unit.io.fuzz.fuzz_unusual FILES [SEED]``.

Each file is read in a process of its own, so that a crash is counted and not suffered. What a reader may do:
give a picture, or raise a :class:`BokehnetError` of one line within seconds. A file that is cut may give a
picture only where it is that of the whole one.
"""

import os
import signal
import sys
import tempfile
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

from bokehnet.errors import BokehnetError
from bokehnet.io.frame import read_frame, write_frame
from bokehnet.io.info import image_info
from bokehnet.io.maps import read_depth, read_disparity
from bokehnet.io.phone_depth import read_phone_depth
from tests.unit.io.fuzz.unusual_files import MAKERS

CUTS = 50
SECONDS = 20
_UNCLEAN, _WRONG = 41, 42  # exit codes


def in_process(call, *arguments):
    """Run ``call`` in a process of its own; return what went wrong, or an empty text."""
    child = os.fork()
    if child == 0:
        signal.alarm(SECONDS)
        code = _UNCLEAN
        try:
            code = call(*arguments) or 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        number = os.WTERMSIG(status)
        return "hang" if number == signal.SIGALRM else f"crash by {signal.Signals(number).name}"
    return {0: "", _UNCLEAN: "unclean", _WRONG: "wrong accept"}[os.WEXITSTATUS(status)]


def clean(call, *arguments):
    """Return what ``call`` gives; None after an error of one line."""
    try:
        return call(*arguments)
    except BokehnetError as error:
        if "\n" in str(error):
            raise ValueError("an error of several lines") from error
        return None


def read_all(path, whole):
    """Every reader has a go at the file; ``whole`` is that of which it was cut, where it was."""
    results = [clean(read, path) for read in (image_info, read_disparity, read_depth, read_phone_depth)]
    frame = clean(read_frame, path)
    if whole is not None and (frame is not None or results[1] is not None):
        original = clean(read_frame, whole), clean(read_disparity, whole)
        for result, expected in ((frame, original[0]), (results[1], original[1])):
            if result is not None and not _alike(result, expected):
                return _WRONG
    if frame is not None:
        for extension in ("exr", "png"):
            clean(write_frame, path.with_name(f"out.{extension}"), frame, frame.image)
    return 0


def _alike(result, expected):
    if expected is None:
        return False
    pictures = [x if isinstance(x, np.ndarray) else x.image for x in (result, expected)]
    return np.array_equal(*pictures)


def fuzz(files, seed, makers=MAKERS, cuts=CUTS):
    """Try so many files; return what went wrong how often, and what each kind was tried."""
    wrong, tried = Counter(), Counter()
    with tempfile.TemporaryDirectory() as name:
        number = 0
        while sum(tried.values()) < files:
            maker = makers[number % len(makers)]
            rng = np.random.default_rng([seed, number])
            folder = Path(name) / f"{number}"
            folder.mkdir()
            problem = in_process(_make, maker, folder, rng)
            if problem == "hang":
                problem = in_process(_make, maker, folder, np.random.default_rng([seed, number]))
            assert not problem, f"{maker.__name__} could not write its file: {problem}"
            (path,) = folder.glob("a.*")
            data = path.read_bytes()
            for cut in [None, *rng.integers(0, len(data), cuts)]:
                tested = path if cut is None else path.with_name(f"cut{path.suffix}")
                if cut is not None:
                    tested.write_bytes(data[:cut])
                tried[maker.__name__] += 1
                whole = None if cut is None else path
                problem = in_process(read_all, tested, whole)
                if problem == "hang":  # unless it was this process that was kept from running
                    problem = in_process(read_all, tested, whole)
                if problem:
                    wrong[maker.__name__, problem] += 1
                    _tell(f"{maker.__name__}, seed {seed}, number {number}, cut {cut}: {problem}")
            for file in folder.iterdir():
                file.unlink()
            number += 1
    return wrong, tried


def _tell(line):
    sys.stderr.write(line + "\n")


def _make(maker, folder, rng):
    maker(folder, rng)
    return 0


def main(files, seed, cuts=CUTS):
    """Print what went wrong; raise unless that is nothing."""
    wrong, tried = fuzz(files, seed, cuts=cuts)
    _tell(f"{sum(tried.values())} files of {len(tried)} kinds")
    for (kind, problem), count in sorted(wrong.items()):
        _tell(f"{kind}: {problem} {count} times")
    assert not wrong


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
