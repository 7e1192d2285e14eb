"""Bad input to ``bokehnet render``: one line that says what is wrong, exit code 1, nothing written."""

import json
import os
import shutil

import numpy as np
import pytest

from bokehnet.inference.session import WEIGHTS
from bokehnet.io.image import write_image, write_map

WIDTH, HEIGHT = 64, 40  # of the pictures in the folder
PHOTO = ["render", "photo.png", "--engine", "scatter"]
MAP = [*PHOTO, "--disparity", "disparity.png"]
SIZES = ["--blur", 6, "--focus", 0.4]
CAMERA = ["--focal-length", 50, "--f-number", 2, "--sensor-width", 36]
LENS = [*CAMERA, "--focus-distance", 1]
ALL = [*MAP, *SIZES]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([*PHOTO, "--disparity", "missing.png", *SIZES], ["missing.png: no such file"]),
        (["render", "missing.jpg", *ALL[2:]], ["missing.jpg: no such file"]),
        ([*PHOTO, "--depth", "missing.exr", *LENS], ["missing.exr: no such file"]),
        ([*PHOTO, "disparity.png"], ["extra argument (disparity.png); a map needs --disparity or --depth"]),
        (
            [*PHOTO, "--focus-at", "64", "41"],
            ["extra argument (41); numbers that belong together", "640,410"],
        ),
        ([*PHOTO, "--focus-at", "64", "-41"], ["unexpected number -41; numbers that belong together"]),
        ([*PHOTO, "--focus-at", "64", "-.5"], ["unexpected number -.5; numbers that belong together"]),
        ([*PHOTO, "--focus-at", "64", "1e1"], ["extra argument (1e1); numbers that belong together"]),
        ([*PHOTO, "--focus-at", "64,41", "-x"], ["-x: no such option; see bokehnet render --help"]),
        ([*PHOTO, *SIZES], ["expected one of --disparity and --depth", "neither", "has no depth map"]),
        ([*ALL, "--depth", "camera.exr"], ["expected one of --disparity and --depth", "both"]),
        ([*MAP, "--blur", 6, "--focus", 1.2], ["--focus", "0..1", "1.2"]),
        ([*MAP, "--blur", 6, "--focus", -0.1], ["--focus", "0..1", "-0.1"]),
        ([*MAP, "--blur", 6, "--focus", "nan"], ["--focus", "0..1", "nan"]),
        ([*ALL, "--focus-at", "1,1"], ["--focus-at: expected one of --focus and --focus-at, got both"]),
        ([*ALL, "--strength", 5], ["--strength: expected one of --blur and --strength, got both"]),
        ([*MAP, "--blur", -1, "--focus", 0.4], ["--blur", "at least 0", "-1"]),
        ([*MAP, "--blur", "nan", "--focus", 0.4], ["--blur", "finite", "nan"]),
        ([*MAP, "--blur", "inf", "--focus", 0.4], ["--blur", "finite", "inf"]),
        (
            [*MAP, "--blur", "wide", "--focus", 0.4],
            ["--blur: expected a number of at least 0 pixels, got 'wide'"],
        ),
        ([*ALL, "--f-number", 2], ["--f-number", "does not apply to --disparity with --blur"]),
        (
            [*MAP, "--focal-length", 50, "--focus-distance", 2],
            [
                "--focus-distance: expected nothing: it does not apply to --disparity, got 2",
                "--focal-length: expected nothing: it does not apply to --disparity without --f-number",
            ],
        ),
        (
            [*MAP, "--blur", "wide", "--focus", 7, "--engine", "magic"],
            ["--blur: expected", "--focus: expected", "--engine: expected"],
        ),
        (
            [*MAP, "--blades", "x", "--focus-distance", 2],
            ["--blades: expected", "got 'x'; --focus-distance: expected nothing: it does not apply"],
        ),
        (
            [*ALL, "--strength", 4, "--blades", "x"],
            ["--blades: expected", "--strength: expected one of --blur and --strength, got both"],
        ),
        (
            [*ALL, "--lens", "petzval", "--jobs", 0],
            ["--jobs: expected", "--lens: expected --engine rays or hybrid"],
        ),
        (
            [*MAP, "--focus-distance", 2, "--quality", 80, "--quiet", "--verbose", "--jobs", 2],
            [
                "--quiet: expected no --verbose",
                "--frames: expected frames",
                "for --jobs",
                "--quality: expected",
            ],
        ),
        (
            [*ALL, "--quality", 500, "--quiet", "--verbose", "--steady", "off"],
            ["--quality: expected 1 to 100", "--quiet: expected no --verbose", "for --steady"],
        ),
        (
            [*ALL, "--focus-at", "1,1", "--quiet", "--verbose"],
            ["--focus-at: expected one of --focus", "--quiet: expected no --verbose"],
        ),
        ([*PHOTO, "--depth", "camera.exr", *LENS, "--blur", 3], ["--blur", "does not apply to --depth"]),
        (
            [*PHOTO, "--depth", "camera.exr", *LENS, "--strength", 30],
            ["--f-number", "does not apply to --depth with --strength"],
        ),
        (
            [*PHOTO, "--depth", "camera.exr", *LENS[:-1], 0.04],
            ["cannot focus at 0.04 m: expected more than 50 mm, the --focal-length"],
        ),
        (
            [*PHOTO, "--depth", "camera.exr", *LENS, "--f-number", 0],
            ["--f-number: expected a number above 0, got 0"],
        ),
        ([*PHOTO, "--depth", "camera.exr", *LENS, "--sensor-width", 0], ["--sensor-width", "above 0"]),
        ([*PHOTO, "--depth", "camera.exr", *LENS, "--sensor-width", "nan"], ["--sensor-width", "finite"]),
        ([*PHOTO, "--depth", "camera.exr", *LENS, "--channel", "W"], ["no channel 'W'", "Z"]),
        ([*PHOTO, "--depth", "disparity.png", *LENS], ["floating point", "disparity"]),
        ([*ALL, "--engine", "magic"], ["rays, scatter", "magic"]),
        ([*ALL, "--repair-disparity", "maybe"], ["--repair-disparity", "auto, off, on", "maybe"]),
        ([*ALL, "--save-maps", "photo.png/maps"], ["--save-maps", "photo.png"]),
    ],
)
def test_a_mistake_in_the_words(fails, arguments, words):
    fails(arguments, *words)


@pytest.mark.parametrize(
    "arguments",
    [
        [*PHOTO, "--constant-disparity", 0, "--focus", 0.5, "--f-number", "x"],  # not that there is no blur
        [*PHOTO, "--focus", 0.5, "--strength", "x"],  # not that the focus needs a relative map
        [*ALL, "--jobs", 2, "--frames", "x"],  # not that there are no frames
        [*PHOTO, "--disparity", "disparity.png", "--ghosts", "ideal", "--lens-f-number", "x"],
    ],
)
def test_an_invalid_option_is_not_reported_as_missing(fails, arguments):
    fails(arguments, f"{arguments[-2]}: expected", "got 'x'; see bokehnet render --help")


@pytest.mark.parametrize("pixel", [f"{WIDTH},0", f"0,{HEIGHT}", "-1,0", "999999,5"])
def test_focus_at_outside_the_picture(fails, pixel):
    fails([*MAP, "--blur", 6, "--focus-at", pixel], "--focus-at", f"{WIDTH}x{HEIGHT}", pixel)


@pytest.mark.parametrize("pixel", ["3", "1,2,3", "1.5,2", "a,b", ""])
def test_focus_at_that_is_no_pixel(fails, pixel):
    fails([*MAP, "--blur", 6, "--focus-at", pixel], "--focus-at", "X,Y", repr(pixel))


@pytest.mark.parametrize("extension", ["png", "jpg", "exr", "tif", "webp"])
@pytest.mark.parametrize("victim", ["picture", "map"])
def test_a_truncated_file(fails, folder, extension, victim):
    path = folder / f"cut.{extension}"
    write_image(path, np.random.default_rng(1).random((HEIGHT, WIDTH, 3)))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    if victim == "picture":
        fails(["render", path.name, "--disparity", "disparity.png", *SIZES, "--engine", "scatter"], path.name)
    else:
        fails([*PHOTO, "--disparity", path.name, *SIZES], path.name)


def test_a_file_that_is_no_picture(fails, folder):
    (folder / "empty.png").touch()
    (folder / "letter.png").write_text("hello")
    fails([*PHOTO, "--disparity", "empty.png", *SIZES], "empty.png", "0 bytes")
    fails([*PHOTO, "--disparity", "letter.png", *SIZES], "letter.png", "expected PNG")


def test_sizes_that_differ_are_reported_with_the_way_out(fails, folder, write_channels):
    write_map("small.png", np.linspace(0, 1, 30 * 20).reshape(20, 30))
    words = (f"{WIDTH}x{HEIGHT}", "30x20", "--resize-disparity")
    fails([*PHOTO, "--disparity", "small.png", *SIZES], "disparity", *words)
    write_channels("small.exr", Z=np.ones((20, 30)))
    fails([*PHOTO, "--depth", "small.exr", *LENS], "depth", *words)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_non_finite_disparity_is_reported_with_its_position(fails, value, write_channels):
    disparity = np.linspace(0, 1, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    disparity[3, 7] = value
    write_channels("bad.exr", Y=disparity)
    fails([*PHOTO, "--disparity", "bad.exr", *SIZES, "--holes", "error"], "bad.exr", "1 pixels", "x=7, y=3")


@pytest.mark.parametrize("value", [0, -2.5, np.nan, -np.inf])
def test_depth_not_above_zero_is_reported_with_its_position(fails, value, write_channels):
    depth = np.full((HEIGHT, WIDTH), 2.0)
    depth[3, 7] = value
    write_channels("bad.exr", Z=depth)
    fails([*PHOTO, "--depth", "bad.exr", *LENS, "--holes", "error"], "bad.exr", "1 pixels", "x=7, y=3")


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("nowhere/out.png", ["nowhere", "does not exist"]),
        ("photo.png/out.png", ["photo.png", "is not a folder"]),
        ("out.gif", ["unknown extension '.gif'", ".png", ".exr"]),
        ("out", ["unknown extension ''"]),
        (".", ["found a folder"]),
    ],
)
def test_an_output_that_cannot_be_written_is_reported_before_any_work(fails, output, words):
    fails(["render", "unread.png", "--disparity", "unread.png", *SIZES], *words, output=output)


@pytest.mark.skipif(not os.path.isdir("/proc/self"), reason="needs the file system of processes")
@pytest.mark.parametrize(
    ("words", "start"),
    [(["-o", "/proc/out.png"], "/proc/out.png: "), (["--save-maps", "/proc/maps"], "--save-maps: ")],
)
def test_a_folder_that_no_permission_bit_protects(folder, cli, words, start):
    """In /proc even root creates no file; the unread picture shows that the render never began."""
    outcome = cli("render", "unread.png", "--disparity", "unread.png", *SIZES, *words)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith(f"bokehnet: error: {start}the folder /proc is not writable: ")
    assert outcome.err.count("\n") == 1


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_is_write_protected(fails, folder):
    (folder / "locked").mkdir(mode=0o500)
    fails(ALL, "locked", "not writable", output="locked/out.png")
    fails([*ALL, "--save-maps", "locked/maps"], "--save-maps", "not writable")


def test_weights_that_are_missing(fails, folder, random_weights):
    fast = [*ALL, "--engine", "fast", "--weights", "weights"]
    fails(fast, "weights missing", "manifest.json", "--engine rays")
    shutil.copytree(random_weights, folder / "weights")
    (folder / "weights" / "arnet.onnx").unlink()
    (folder / "out.png").unlink()
    fails(fast, "weights missing", "arnet.onnx")


def test_weights_with_a_wrong_hash(fails, folder, random_weights):
    shutil.copytree(random_weights, folder / "weights")
    network = folder / "weights" / "arnet.onnx"
    network.write_bytes(network.read_bytes()[:-1] + b"?")
    fails([*ALL, "--engine", "fast", "--weights", "weights"], "arnet.onnx", "sha256", "damaged")


def test_weights_that_are_a_file(fails, folder):
    (folder / "mine.onnx").write_bytes(b"")
    fast = [*ALL, "--engine", "fast", "--weights", "mine.onnx"]
    fails(fast, "mine.onnx: expected a folder with manifest.json, found a file")


@pytest.mark.parametrize("engine", ["rays", "scatter"])
def test_weights_for_an_engine_without_networks(fails, engine):
    words = f"--weights: expected none for engine {engine}, got mine; use engine hybrid, neural or fast"
    fails([*ALL, "--engine", engine, "--weights", "mine"], words)


def test_weights_of_a_settings_file_wait_for_an_engine_with_networks(cli, folder):
    (folder / "mine.toml").write_text('[engine]\nname = "fast"\nweights = "mine"\n')
    outcome = cli(*ALL, "--settings", "mine.toml", "--engine", "scatter")
    assert outcome.code == 0, outcome.err


@pytest.mark.parametrize(
    ("engine", "networks", "words"),
    [
        ("hybrid", "neural", ["correct the rays, found", "correct the scatter, for --engine neural or fast"]),
        ("fast", "hybrid", ["correct the scatter, found", "correct the rays, for --engine hybrid"]),
    ],
)
def test_networks_behind_another_renderer_are_refused(fails, engine, networks, words):
    fails([*ALL, "--engine", engine, "--weights", WEIGHTS / networks], *words)


@pytest.mark.parametrize(
    ("text", "words"),
    [("not json", ["expected JSON"]), (json.dumps({"format": 99}), ["format 1, found 99"]), ("[]", ["None"])],
)
def test_an_invalid_manifest_is_reported(fails, folder, text, words):
    (folder / "weights").mkdir()
    (folder / "weights" / "manifest.json").write_text(text)
    fails([*ALL, "--engine", "fast", "--weights", "weights"], "manifest.json", *words)


def test_the_checks_before_a_render_import_no_kernels(python_process):
    """Mistakes are reported within half a second of processor time, of which numba would take 0.2 s."""
    outcome = python_process(
        "import sys, bokehnet.cli.app, bokehnet.cli.render.checks\n"
        "sys.exit(', '.join({'numba', 'onnxruntime', 'torch'} & set(sys.modules)) or 0)"
    )
    assert (outcome.code, outcome.err) == (0, "")


def test_depth_in_a_numpy_file_with_options_for_the_camera(folder, cli):
    np.save("z.npy", np.tile(np.linspace(1, 4, WIDTH, dtype=np.float32), (HEIGHT, 1)))
    assert cli(*PHOTO, "--depth", "z.npy", *LENS, "-o", "out.png").code == 0
    outcome = cli(*PHOTO, "--depth", "z.npy", *LENS[2:], "-o", "out2.png")
    assert "mm on a sensor 36 mm wide" in outcome.err


# Runs a command line in the folder that is the first word.
_RUN = "import os, sys; from bokehnet.cli.app import run; os.chdir(sys.argv[1]); code = run(sys.argv[2:])"


@pytest.fixture
def mistaken_maps(folder):
    """Files of maps that do not apply to the photo: another size, and a picture in colours."""
    write_map("small.png", np.linspace(0, 1, 30 * 20).reshape(20, 30))
    np.save("small.npy", np.zeros((20, 30), np.float32))
    write_image("color.png", np.random.default_rng(2).random((HEIGHT, WIDTH, 3)))
    return folder


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--disparity", "small.png"], "64x40 pixels but its disparity is 30x20"),
        (["--disparity", "small.npy"], "64x40 pixels but its disparity is 30x20"),
        (["--depth", "small.npy"], "64x40 pixels but its depth is 30x20"),
        (["--disparity", "disparity.png", "--channel", "Q"], "no channel 'Q', found Y"),
        (["--disparity", "disparity.png", "--disparity-range", "0,255"], "codes of this map count over 255"),
        (["--depth", "disparity.png"], "found integers up to 255"),
        (["--disparity", "color.png"], "if this is the picture, it and its map are swapped"),
    ],
)
def test_a_map_that_does_not_apply_is_refused_before_kernels_are_imported(
    mistaken_maps, python_process, arguments, word
):
    source = f"{_RUN}; sys.exit(', '.join({{'numba', 'onnxruntime'}} & set(sys.modules)) or code)"
    outcome = python_process(source, mistaken_maps, *PHOTO, *arguments, "-o", "out.png")
    assert outcome.code == 1
    assert word in outcome.err
    assert outcome.err.count("\n") == 1  # no imported module is named


def test_a_preset_as_a_lens_is_named_as_one(folder, fails):
    fails(
        [*MAP, "--engine", "rays", "--lens", "petzval-swirl"],
        "--lens: expected a lens, got the preset 'petzval-swirl'",
    )


def test_an_unknown_lens_is_refused_before_the_renderer_is_imported(folder, python_process):
    source = f"{_RUN}; sys.exit('bokehnet.render.renderer' in sys.modules)"
    outcome = python_process(source, folder, *MAP[:2], *MAP[4:], "--lens", "glass", "-o", "out.png")
    assert "--lens: unknown lens 'glass'" in outcome.err
    assert outcome.code == 0
