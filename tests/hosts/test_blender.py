"""The Blender extension inside Blender. Authority: Cycles, and bokehnet's command line.

``BOKEHNET_BLENDER`` names its program. Without it, it is the module bpy, which pins a NumPy of its own and
may therefore live in another environment, whose Python ``BOKEHNET_BPY_PYTHON`` names.
"""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bokehnet.io.image import read_image

ROOT = Path(__file__).parents[2]
PYTHON = os.environ.get("BOKEHNET_BPY_PYTHON") or (sys.executable if importlib.util.find_spec("bpy") else "")
BLENDER = os.environ.get("BOKEHNET_BLENDER")

pytestmark = [
    pytest.mark.host,
    pytest.mark.skipif(
        not (PYTHON or BLENDER),
        reason="needs BOKEHNET_BLENDER, or bpy: pip install bpy, here or where BOKEHNET_BPY_PYTHON names",
    ),
]


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("extension")
    command = [sys.executable, "-m", "tools.host_archives", "blender", "--no-wheels", "--out", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (built,) = folder.glob("*.zip")
    return built


@pytest.fixture
def blender(archive, tmp_path):
    """Run a task in Blender, and return its report."""

    def run(python=None, **task):
        warm = tmp_path / "python.sh"
        warm.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" "$@"\n', encoding="utf-8")
        warm.chmod(0o755)
        environment = dict(os.environ, BOKEHNET_PYTHON=str(python or warm))
        environment["BLENDER_USER_RESOURCES"] = str(tmp_path / "user")
        child = str(ROOT / "tests/hosts/blender_child.py")
        inside = [BLENDER, "--background", "--factory-startup", "--python", child, "--"]
        words = inside if BLENDER else [PYTHON, child]
        words = [*words, str(archive), str(tmp_path), json.dumps(task)]
        done = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=300)
        lines = [line for line in done.stdout.splitlines() if line.startswith("TOLD ")]
        assert lines, done.stdout + done.stderr
        return json.loads(lines[-1][5:])

    return run


def shown(image):
    """The clipped sRGB picture."""
    light = np.clip(image, 0, 1)
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("camera", "options"),
    [
        ({}, []),
        ({"blades": 5, "rotation": 0.4}, ["--blades", "5", "--aperture-rotation", "22.91831"]),
        ({"ratio": 1.6}, ["--squeeze", "0.625"]),
    ],
    ids=["disc", "blades", "ratio"],
)
def test_the_blur_is_that_of_cycles_and_of_the_command_line(
    blender, cli, tmp_path, camera, options, record_property
):
    response = blender(truth=128, samples=64, camera=camera)
    assert "error" not in response
    assert response["unchanged"]
    bokeh = read_image(tmp_path / "bokeh.0001.exr")
    first, second = (shown(read_image(tmp_path / f"truth{seed}.exr")) for seed in (1, 2))
    noise = np.mean((first - second) ** 2) / 4  # of their mean
    error = np.mean((shown(bokeh) - (first + second) / 2) ** 2) - noise
    record_property("dB to Cycles", to_cycles := float(-10 * np.log10(error)))
    assert to_cycles >= 35
    assert response["node"] == "Bokeh Result"
    assert response["image"]["mean"] == pytest.approx((3 * bokeh.mean() + 1) / 4, rel=1e-4)  # with its alpha

    pinhole, by_command = tmp_path / "pinhole.0001.exr", tmp_path / "command.exr"
    # 0.12 on Blender's camera, whose view does not breathe: 3.4 m / (3.4 m - 50 mm) of it for a lens
    lens = ["--focal-length", "50", "--f-number", str(0.12 * 3.4 / 3.35), "--sensor-width", "36"]
    depth = ["--depth", pinhole, "--channel", "ViewLayer.Depth.Z", "--focus-distance", "3.4"]
    words = [*depth, *lens, *options, "--pixel-filter", "blackman-harris:1.5", "-o", by_command]
    assert cli("render", pinhole, *words).code == 0
    off = float(np.mean((shown(bokeh) - shown(read_image(by_command))) ** 2))
    record_property("dB to the command line", to_command := -10 * np.log10(off + 1e-12))
    assert to_command >= 60


@pytest.mark.slow
def test_an_animation_is_a_sequence_and_what_is_there_is_kept(blender, tmp_path):
    (tmp_path / "bokeh.0003.exr").write_bytes(b"kept")
    response = blender(samples=4, engine="scatter", frames=[3, 4])
    assert "error" not in response
    assert response["image"]["source"] == "SEQUENCE"
    assert (tmp_path / "bokeh.0003.exr").read_bytes() == b"kept"
    assert (tmp_path / "bokeh.0004.exr").stat().st_size > 1000
    (tmp_path / "bokeh.0003.exr").unlink()
    blender(samples=4, engine="scatter", frames=[3, 4])
    near, far = (read_image(tmp_path / f"bokeh.{frame:04d}.exr") for frame in (3, 4))
    assert np.abs(near - far).mean() > 0.01  # the focus was pulled


@pytest.mark.parametrize(
    ("task", "message"),
    [
        ({"change": {"type": "ORTHO"}}, "expected a perspective one, found ORTHO"),
        ({"change": {"pixel_aspect_x": 2}}, "expected square pixels, found 2:1"),
        ({"change": {"lens": 4000}}, "expected a focus farther than 4 m"),
        ({"python": "/bin/false", "samples": 1}, "expected a Python with bokehnet, found /bin/false"),
        ({"python": "/nowhere/python", "samples": 1}, "found /nowhere/python (No such file or directory)"),
    ],
)
def test_what_is_wrong_is_one_line_in_blenders_own_way(blender, tmp_path, task, message):
    text = blender(**task)
    assert message in text["error"]
    assert text["error"].startswith("Error: ")
    assert len(text["error"].splitlines()) <= 2  # the second names the script that called the operator
    assert text["unchanged"]
    assert not list(tmp_path.glob("bokeh.*"))


def test_blender_takes_the_manifest(archive):
    """By the tool that Blender's own extension platform checks with."""
    if BLENDER:
        words = [BLENDER, "--command", "extension", "validate", str(archive)]
        done = subprocess.run(words, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return
    code = "import bpy; print(bpy.utils.system_resource('SCRIPTS'))"
    done = subprocess.run([PYTHON, "-c", code], capture_output=True, text=True)
    tool = Path(done.stdout.split()[-1]) / "addons_core/bl_pkg/cli/blender_ext.py"
    done = subprocess.run([PYTHON, str(tool), "validate", str(archive)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
