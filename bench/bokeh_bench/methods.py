"""Methods: a shell command, a Python function, or one of two trivial methods."""

import importlib
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bokeh_bench.dataset import Case
from bokeh_bench.files import BenchError, read_picture

__all__ = ["BUILTIN", "Method", "by_command", "by_function", "gather", "no_blur", "placeholders"]

# Function of a case that returns the scene-linear picture (H, W, 3).
Method = Callable[[Case], np.ndarray]

_GATHER_TAPS = 64


def no_blur(case: Case) -> np.ndarray:
    """Return the input: the score that a method must exceed."""
    return case.image


def gather(case: Case) -> np.ndarray:
    """Return the mean of points in each pixel's own disc: the simplest blur, and a reference of the table."""
    height, width = case.depth.shape
    y, x = np.mgrid[:height, :width]
    radius = np.abs(case.defocus)
    total = np.zeros(case.image.shape)
    for number in range(_GATHER_TAPS):
        distance = np.sqrt((number + 0.5) / _GATHER_TAPS)
        angle = number * np.pi * (3 - np.sqrt(5))
        row = np.clip(np.round(y + radius * distance * np.sin(angle)), 0, height - 1).astype(int)
        column = np.clip(np.round(x + radius * distance * np.cos(angle)), 0, width - 1).astype(int)
        total += case.image[row, column]
    return np.asarray(total / _GATHER_TAPS, np.float32)


BUILTIN: dict[str, Method] = {"no_blur": no_blur, "gather": gather}


def placeholders(case: Case, description: dict[str, Any], out: Path) -> dict[str, str]:
    """Return the quoted value of each placeholder of a command; README describes them."""
    kind, folder = case.map_kind, case.folder.resolve()
    low, high = description["disparity"][kind]["min"], description["disparity"][kind]["max"]
    png = folder / "image.png"
    values: dict[str, Any] = {
        "image": png if case.track == "clipped" else folder / "image.pfm",
        "image_png": png,
        "depth": folder / f"depth_{kind}.pfm",
        "disparity": folder / f"disparity_{kind}.png",
        "focal_length": case.focal_length,
        "sensor_width": case.sensor_width,
        "f_number": case.f_number,
        "focus_distance": case.focus,
        "blades": case.blades,
        "blur": case.blur * (high - low),
        "focus": (1 / case.focus - low) / (high - low),
        "out": out / "out.pfm",
        "out_png": out / "out.png",
    }
    return {name: shlex.quote(str(value)) for name, value in values.items()}


def by_command(command: str, descriptions: dict[str, dict[str, Any]]) -> Method:
    """Return the method of a shell command that reads files and writes ``{out}`` or ``{out_png}``.

    Raises:
        BenchError: The command has an unknown placeholder or none for its output; later: it fails or writes
            nothing.
    """
    used = set(re.findall(r"\{(\w*)\}", command))
    example = Case(
        scene="",
        shot=0,
        track="exact",
        folder=Path(),
        image=np.empty(0),
        depth=np.empty(0),
        blur=1.0,
        focus=1.0,
        f_number=1.0,
        blades=0,
        focal_length=1.0,
        sensor_width=1.0,
    )
    known = placeholders(example, {"disparity": {"exact": {"min": 0.0, "max": 1.0}}}, Path())
    if unknown := used - set(known):
        raise BenchError(f"--command: expected placeholders {', '.join(known)}; found {', '.join(unknown)}")
    if not used & {"out", "out_png"}:
        raise BenchError("--command: expected {out} or {out_png} for the picture; found neither")

    def render(case: Case) -> np.ndarray:
        with TemporaryDirectory() as out:
            filled = command
            for name, value in placeholders(case, descriptions[case.scene], Path(out)).items():
                filled = filled.replace(f"{{{name}}}", value)
            done = subprocess.run(filled, shell=True, capture_output=True, text=True, check=False)
            if done.returncode:
                lines = (done.stderr or done.stdout).strip().splitlines() or ["no output"]
                raise BenchError(f"{filled}: exit status {done.returncode}: {lines[-1]}")
            written = [path for path in (Path(out) / "out.pfm", Path(out) / "out.png") if path.exists()]
            if not written:
                raise BenchError(f"{filled}: expected a picture at {{out}} or {{out_png}}; found none")
            return read_picture(written[0])

    return render


def by_function(name: str) -> Method:
    """Return the function ``module:function``, which maps a case to a scene-linear picture.

    Raises:
        BenchError: The module cannot be imported or lacks the function.
    """
    module, separator, function = name.partition(":")
    if not separator:
        raise BenchError(f"--function: expected module:function; found {name}")
    try:
        method = getattr(importlib.import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise BenchError(f"--function {name}: {error}") from error
    result: Method = method
    return result
