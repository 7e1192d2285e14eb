"""Feeds odd input to readers, command line and API: ``python -m tests.unit.fuzz_all SECONDS [SEED]``.

What each may do: give a picture, or fail with one line. Tries run in processes of their own, a few each, so
that a crash or a hang is counted and the rest goes on.
"""

import contextlib
import io
import os
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path

import numpy as np

from bokehnet import BokehRenderer, RenderSettings, make_scene
from bokehnet.cli.app import run
from bokehnet.errors import BokehnetError
from bokehnet.io.image import read_image
from bokehnet.scene.depth.depth_source import DefocusMap, MetricDepth, RelativeDisparity
from tests.unit.cli.render.test_render_fuzz import FLAGS, ODD_NUMBERS
from tests.unit.io.fuzz.fuzz_unusual import read_all
from tests.unit.io.fuzz.unusual_files import MAKERS

SECONDS = 180  # for one try, where kernels may be compiled
TRIES = 6  # in one process
READS = 40

NUMBERS = [*ODD_NUMBERS, "0.3", "0.7", "2", "5", "12", "45", "1,2", "0.2,0.9", "3,4", "x", ""]
OPTIONS = {
    "--blades": ["0", "3", "6", "99"],
    "--depth-unit": ["m", "cm", "1/m", "parsec"],
    "--mixed-depth": ["on", "off", "auto"],
    "--pixel-filter": ["auto", "box", "gaussian:1.4", "cycles"],
    "--repair-disparity": ["on", "off", "auto"],
    "--max-memory": ["700M", "4G", "1", "4X"],
    "--channel": ["Z", "R", "Y", "Q", ""],
    "--engine": ["scatter", "rays", "fast", "none"],
    "--preset": ["petzval-swirl", "anamorphic", "none"],
    "--lens": ["petzval", "none"],
    **dict.fromkeys(
        (
            "--blur", "--focus", "--focus-at", "--focus-range", "--focus-distance", "--focal-length",
            "--f-number", "--sensor-width", "--gamma", "--highlights", "--highlight-gain", "--squeeze",
            "--rim", "--cats-eye", "--obstruction", "--tilt-x", "--tilt-y", "--distortion", "--vignette",
            "--grain", "--coma", "--spherical", "--axial-fringe", "--lateral-fringe", "--disparity-range",
            "--constant-disparity", "--onion", "--blade-curvature", "--aperture-rotation", "--brown",
        ),
        NUMBERS,
    ),
}  # fmt: skip


class WrongError(Exception):
    """Something was accepted that is no picture."""


def pick(rng, choices):
    choices = list(choices)
    return choices[int(rng.integers(len(choices)))]


def odd_file(folder, rng):
    """Write an unusual file; one in three is cut, one in three has some bytes changed."""
    path = pick(rng, MAKERS)(folder, rng)
    data = bytearray(path.read_bytes())
    damage = int(rng.integers(3))
    if damage == 1:
        data = data[: int(rng.integers(len(data)))]
    elif damage == 2:
        for _ in range(int(rng.integers(1, 6))):
            data[int(rng.integers(min(len(data), int(10 ** rng.uniform(1, 5)))))] = int(rng.integers(256))
    named = folder / f"odd{int(rng.integers(10**9))}{path.suffix}"
    named.write_bytes(data)
    path.unlink()
    return named


def try_readers(folder, rng):
    read_all(odd_file(folder, rng), None)
    return "readers"


def try_command(folder, rng):
    """A command line over odd files, or good ones, with odd options."""
    picture = odd_file(folder, rng) if rng.integers(2) else folder / "photo.png"
    depth = [odd_file(folder, rng), folder / "disparity.png", folder / "camera.exr", picture][
        int(rng.integers(4))
    ]
    output = folder / f"out.{pick(rng, ['png', 'jpg', 'exr', 'tif', 'webp', 'hdr', 'xyz'])}"
    words = ["render", picture, "-o", output]
    start = int(rng.integers(4))
    if start == 0:
        words += ["--disparity", depth, "--blur", "4", "--focus", "0.4", "--resize-disparity"]
    elif start == 1:
        words += ["--depth", depth, "--focal-length", "50", "--f-number", "2", "--sensor-width", "36"]
        words += ["--focus-distance", "2", "--resize-disparity"]
    elif start == 2:
        words += ["--f-number", "2", "--focus-distance", "2", "--focal-length", "30", "--sensor-width", "30"]
    else:
        words += ["--constant-disparity", "0.4", "--blur", "9", "--focus", "0.2"]
    for option in rng.choice([*OPTIONS, *FLAGS], int(rng.integers(0, 4)), replace=False):
        if option not in words:
            words += [option, pick(rng, OPTIONS[option])] if option in OPTIONS else [option]
    if "--engine" not in words:
        words += ["--engine", "scatter"]
    if "--repair-disparity" not in words:
        words += ["--repair-disparity", "off"]
    sys.stderr.write(f"trying {' '.join(map(str, words))}\n")
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run([str(word) for word in words])
    lines = err.getvalue().splitlines()
    if code not in (0, 1) or (code == 1 and not lines[-1].startswith("bokehnet: error: ")):
        raise WrongError(f"exit code {code}: {lines[-3:]}")
    if code == 0 and not np.isfinite(read_image(output)).all():
        raise WrongError("the result is not finite")
    if code == 1 and output.exists():
        raise WrongError("an output is left of a failure")
    return f"command, exit code {code}"


def odd_array(rng, shape):
    """An array of about the right shape, with odd values, types and strides."""
    kind = pick(
        rng, ["float32", "float32", "float64", "float16", "uint8", "int64", "bool", "complex64", "object"]
    )
    if rng.integers(5) == 0:
        shape = pick(rng, [(), (0,), (1, 1), (1, 1, 3), shape[:-1], (*shape, 1), shape[::-1], (0, 4, 3)])
    values = np.asarray(rng.random(shape) * 10 ** rng.uniform(-3, 3))
    if values.size and rng.integers(4) == 0:
        places = rng.integers(0, values.size, 3)
        values.reshape(-1)[places] = pick(rng, [np.nan, np.inf, -np.inf, -1, 1e38, 1e-40, 0])
    with np.errstate(all="ignore"):
        values = values.astype(kind)
    if values.ndim > 1 and rng.integers(4) == 0:
        values = values[::-1, ::2] if rng.integers(2) else np.asfortranarray(values)
    return values if rng.integers(20) else values.tolist()


def try_api(folder, rng):
    """The renderer over odd arrays."""
    height, width = int(rng.integers(1, 60)), int(rng.integers(1, 60))
    image, depth = odd_array(rng, (height, width, 3)), odd_array(rng, (height, width))
    renderer = BokehRenderer(pick(rng, ["scatter", "rays"]))
    number = lambda: pick(rng, [0, 0.5, 1, 3.0, -1, np.nan, np.inf, 1e30, "x", None, True, np.float32(2)])  # noqa: E731
    way = int(rng.integers(4))
    try:
        if way == 0:
            result = renderer.render_arrays(image, depth)
        elif way == 1:
            result = renderer.render_arrays(image, disparity=depth, blur=number(), focus=number())
        else:
            source = pick(rng, [RelativeDisparity, MetricDepth, DefocusMap])(map=depth)
            table = {"camera": {pick(rng, ["blur", "f_number", "focal_length"]): number()}}
            table["focus"] = {pick(rng, ["value", "distance", "at", "tilt_x"]): number()}
            table["depth"] = {"repair": "off", "resize": True}
            result = renderer.render(make_scene(image, source), RenderSettings().updated(table))
    except BokehnetError as error:
        if "\n" in str(error):
            raise WrongError("an error of several lines") from error
        return "API, refused"
    if result.bokeh.shape != np.shape(image) or not np.isfinite(result.bokeh).all():
        raise WrongError("the result is no picture of this size")
    return "API, rendered"


def work(folder, kind, seed, number, pipe):
    """Try a few times and tell of each in a line; ends the process."""
    for step in range(READS if kind is try_readers else TRIES):
        rng = np.random.default_rng([seed, number, step])
        os.write(pipe, b"?")
        signal.alarm(SECONDS)
        try:
            for old in folder.glob("out.*"):
                old.unlink()
            result = kind(folder, rng)
        except BaseException as error:
            sys.stderr.write(f"{kind.__name__} {seed} {number} {step}:\n")
            traceback.print_exc()
            result = f"{'wrong accept' if isinstance(error, WrongError) else 'unclean'} in {kind.__name__}"
        signal.alarm(0)
        os.write(pipe, result.encode() + b"\n")
    sys.stderr.flush()
    os._exit(0)


def good_files(folder):
    """photo.png, disparity.png and camera.exr, written in a process of its own."""
    from bokehnet.io.channels import write_channels
    from bokehnet.io.image import write_image, write_map

    rng = np.random.default_rng(0)
    photo = rng.random((40, 64, 3), dtype=np.float32)
    write_image(folder / "photo.png", photo)
    write_map(folder / "disparity.png", np.linspace(0, 1, 40 * 64).reshape(40, 64))
    write_channels(
        folder / "camera.exr",
        dict(zip("RGB", photo.transpose(2, 0, 1), strict=True)) | {"Z": photo[..., 0] + 1},
    )


def main(seconds, seed):
    """Go on until the time is up, and say what was tried and what went wrong."""
    counts, end, number = Counter(), time.monotonic() + seconds, 0
    while time.monotonic() < end:
        kind = (try_readers, try_command, try_api)[number % 3]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            reading, writing = os.pipe()
            child = os.fork()
            if child == 0:
                os.close(reading)
                good_files(folder)
                work(folder, kind, seed, number, writing)
            os.close(writing)
            with os.fdopen(reading, "rb") as pipe:
                message = pipe.read().decode()
            _, status = os.waitpid(child, 0)
        lines = [line.lstrip("?") for line in message.split("\n")]
        counts.update(line for line in lines if line)
        if status:
            died = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
            what = "hang" if died == signal.SIGALRM else f"crash by signal {died}"
            sys.stderr.write(f"{kind.__name__} {seed} {number} {len(lines) - 1}: {what}\n")
            counts[f"{what} in {kind.__name__}"] += 1
        number += 1
        if number % 30 == 0:
            sys.stderr.write(f"so far {dict(counts)}\n")
    sys.stderr.write(f"tried {sum(counts.values())}: {dict(counts)}\n")


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
