"""The program in hard circumstances: closed and full streams, long names, no folder, little address space.

Authority: the documented behaviour, one line on stderr and exit code 1.
"""

import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bokehnet.io.image import write_image

ROOT = Path(__file__).parents[2]
LONG = "a" * 300
FLAT = ("--constant-disparity", "0.4", "--blur", "2", "--focus", "0.4", "--engine", "scatter")


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    path = tmp_path_factory.mktemp("circumstances") / "a.png"
    write_image(path, np.random.default_rng(0).random((12, 16, 3), dtype=np.float32))
    return path


def program(*words, **options):
    """Run the program; return its exit code and the lines on its stderr."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "bokehnet", *map(str, words)]
    options = {"stderr": subprocess.PIPE, "stdout": subprocess.DEVNULL, "cwd": "/"} | options
    done = subprocess.run(command, env=environment, text=True, timeout=120, check=False, **options)
    return done.returncode, (done.stderr or "").splitlines()


def assert_one_line(result, *fragments):
    code, lines = result
    assert (code, len(lines)) == (1, 1), lines
    assert lines[0].startswith("bokehnet: error: ")
    for fragment in fragments:
        assert fragment in lines[0]


def test_a_full_disk_behind_stdout(picture):
    with open("/dev/full", "w") as full:
        assert_one_line(program("info", picture, stdout=full), "No space left")
        assert_one_line(program("presets", stdout=full), "No space left")


def test_a_full_disk_behind_stderr_loses_notices_only(picture, tmp_path):
    """Authority: the same command with a log that can be written."""
    with open("/dev/full", "w") as full:
        assert program("render", picture, *FLAT, "-o", tmp_path / "a.png", stderr=full)[0] == 0
        assert program("info", picture.with_name("none.png"), stderr=full)[0] == 1
    assert program("render", picture, *FLAT, "-o", tmp_path / "b.png")[0] == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_closed_streams(picture):
    for closed, code in ((1, 0), (2, 0), (0, 0)):
        assert program("info", picture, preexec_fn=lambda number=closed: os.close(number))[0] == code
    missing = program("info", picture.with_name("none.png"), preexec_fn=lambda: os.close(2))
    assert missing == (1, [])


def test_a_closed_stderr_does_not_end_in_the_picture(picture, tmp_path):
    """The first file that is opened must not become descriptor 2."""
    words = ["render", picture, *FLAT]
    assert program(*words, "-o", tmp_path / "a.png", preexec_fn=lambda: os.close(2))[0] == 0
    assert program(*words, "-o", tmp_path / "b.png")[0] == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(
    "words",
    [
        ("info", f"{LONG}.png"),
        (
            "render",
            f"{LONG}.png",
            "--constant-disparity",
            "0.4",
            "--blur",
            "2",
            "--focus",
            "0.4",
            "-o",
            "a.png",
        ),
        ("render", "PICTURE", "--disparity", f"{LONG}.png", "--blur", "2", "--focus", "0.4", "-o", "a.png"),
        (
            "render",
            "PICTURE",
            "--constant-disparity",
            "0.4",
            "--blur",
            "2",
            "--focus",
            "0",
            "-o",
            f"{LONG}.png",
        ),
        ("render", "PICTURE", "--settings", f"{LONG}.toml", "-o", "a.png"),
        ("render", "PICTURE", "--preset", f"{LONG}.toml", "-o", "a.png"),
        ("lens", f"{LONG}.zmx"),
        ("lens", f"{LONG}.npz"),
        ("depth", "PICTURE", "--model", f"{LONG}.onnx", "-o", "a.png"),
        ("trace", f"{LONG}.toml", "-o", "a.exr"),
    ],
)
def test_names_above_255_bytes(picture, tmp_path, words):
    words = [picture if word == "PICTURE" else word for word in words]
    assert_one_line(program(*words, cwd=tmp_path))


def test_a_deleted_working_folder(picture, tmp_path):
    folder = tmp_path / "gone"

    def delete():
        folder.mkdir()
        os.chdir(folder)
        folder.rmdir()

    assert_one_line(program("info", "a.png", preexec_fn=delete))
    words = [*FLAT, "-q"]
    assert_one_line(program("render", picture, "-o", "a.png", *words, preexec_fn=delete))
    assert program("render", picture, "-o", tmp_path / "a.png", *words, preexec_fn=delete) == (0, [])


@pytest.mark.parametrize("megabytes", [250, 500, 900])
def test_little_address_space(picture, megabytes):
    def limit():
        resource.setrlimit(resource.RLIMIT_AS, (megabytes * 10**6, megabytes * 10**6))

    assert_one_line(program("info", picture, preexec_fn=limit), "address space", "ulimit -v")
    assert program("--version", preexec_fn=limit) == (0, [])
