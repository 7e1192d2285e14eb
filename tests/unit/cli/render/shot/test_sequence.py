"""``bokehnet render --frames``: many frames, with all that can happen on the way."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.cli.render.shot.workers import render_in_processes
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.maps import read_map
from bokehnet.settings.settings import EngineSettings, RenderSettings

FRAMES = range(1, 5)
FAST = ("--engine", "scatter", "--repair-disparity", "off", "--mixed-depth", "off")
SHOT = (
    "render",
    "shot.####.png",
    "--disparity",
    "z.%04d.png",
    "-o",
    "out.####.png",
    *FAST,
    "--steady",
    "off",
)
STILL = ("render", "photo.png", "--disparity", "disparity.png", "-o", "out.####.png", *FAST)
FOCUS = ("--blur", 6, "--focus", 0.4)
CAMERA = ("--focal-length", 50, "--sensor-width", 36)


@pytest.fixture
def shot(folder):
    """Four frames beside the stills: the pictures differ, the maps too."""
    for frame in FRAMES:
        write_image(f"shot.{frame:04d}.png", np.roll(read_image("photo.png"), 3 * frame, axis=1))
        write_map(f"z.{frame:04d}.png", np.roll(read_map("disparity.png"), 2 * frame, axis=1))
    return folder


def outputs(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("out.*"))}


def hidden(folder):
    return [path.name for path in folder.rglob(".bokehnet-*")]


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_each_frame_is_what_a_single_render_of_it_is(shot, cli, jobs):
    """Oracle: the command without --frames; the stored disparity spans 0 to 1, so it needs no scaling."""
    outcome = cli(*SHOT, *FOCUS, "--frames", "1-4", "--jobs", jobs, "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    assert set(outputs(shot)) == {f"out.{frame:04d}.png" for frame in FRAMES}
    for frame in FRAMES:
        files = (f"shot.{frame:04d}.png", "--disparity", f"z.{frame:04d}.png", "-o", "single.png")
        assert cli("render", *files, *FAST, *FOCUS).code == 0
        assert_array_equal(read_image("single.png"), read_image(f"out.{frame:04d}.png"))


@pytest.mark.slow
def test_a_static_scene_gives_identical_frames_however_many_render(shot, cli):
    """The rays too, whose samples are random: the same ones in each frame and each process."""
    words = [*STILL[:6], "--blur", 6, "--focus", 0.4]
    assert cli(*words, "--frames", "1-3").code == 0
    one = outputs(shot)
    assert len(set(one.values())) == 1
    assert cli(*words, "--frames", "1-3", "--jobs", 2, "--overwrite").code == 0
    assert outputs(shot) == one


@pytest.mark.slow
def test_a_lens_is_the_same_in_every_process(shot, cli, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    words = [*STILL[:6], *FOCUS, "--lens", "double_gauss", "--coma", 2, "--repair-disparity", "off"]
    assert cli(*words, "--frames", "1").code == 0
    assert cli(*words, "--frames", "2-3", "--jobs", 2).code == 0
    assert len(set(outputs(shot).values())) == 1


def test_what_is_there_is_kept_unless_overwritten(shot, cli):
    shutil.copy(shot / "shot.0002.png", shot / "out.0002.png")
    older = (shot / "out.0002.png").read_bytes()
    outcome = cli(*SHOT, *FOCUS, "--frames", "1-4x1")
    assert (outcome.code, outcome.out) == (0, "")
    existing = r"1 exist already \(--overwrite renders them again\)"
    line = (
        rf"bokehnet: 3 frames rendered, {existing}, \d+\.\d s; assumed: bright is near \(--invert if not\)\n"
    )
    assert re.fullmatch(line, outcome.err)
    assert (shot / "out.0002.png").read_bytes() == older
    assert len(outputs(shot)) == 4
    assert cli(*SHOT, *FOCUS, "--frames", "1-4", "--overwrite").code == 0
    assert (shot / "out.0002.png").read_bytes() != older


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_bad_frames_are_reported_and_do_not_stop_the_others(shot, cli, jobs):
    (shot / "shot.0002.png").unlink()
    (shot / "z.0003.png").write_bytes((shot / "z.0003.png").read_bytes()[:60])
    outcome = cli(*SHOT, *FOCUS, "--frames", "1-4", "--jobs", jobs)
    assert outcome.code == 1
    assert set(outputs(shot)) == {"out.0001.png", "out.0004.png"}
    lines = [line for line in re.split(r"[\r\n]", outcome.err) if line.startswith("bokehnet")]
    assert sorted(line[:29] for line in lines) == [
        "bokehnet: 2 frames rendered, ",
        "bokehnet: error: 2 of 4 frame",
        "bokehnet: frame 2: shot.0002.",
        "bokehnet: frame 3: z.0003.png",
    ]
    assert "failed: 2-3" in outcome.err.splitlines()[-1]
    assert "Traceback" not in outcome.err


def test_focus_is_pulled_evenly_in_disparity(shot, cli):
    """Authority: defocus = blur * (disparity - focus), focus at 0.8, 0.6, 0.4, 0.2."""
    words = ("--blur", 6, "--focus-from", 0.8, "--focus-to", 0.2, "--frames", "1-4", "--save-maps", "maps")
    assert cli(*STILL, *words).code == 0
    for frame, focus in zip(FRAMES, (0.8, 0.6, 0.4, 0.2), strict=True):
        defocus = read_map(f"maps/{frame:04d}/defocus.exr")
        assert_allclose(defocus, 6 * (read_map("disparity.png") - focus), atol=1e-5)


def test_distance_and_aperture_are_pulled_through_a_lens(shot, cli):
    """Oracle: single renders at the harmonic middle of the distances and of the f-numbers."""
    lens = ("render", "photo.png", "--depth", "camera.exr", *CAMERA, *FAST, "--save-maps", "maps")
    pull = ("--focus-from", 1, "--focus-to", 3, "--f-number-from", 8, "--f-number-to", 2)
    assert cli(*lens, *pull, "--frames", "10-12", "-o", "out.###.png").code == 0
    for frame, focus, f_number in ((10, 1, 8), (11, 1.5, 3.2), (12, 3, 2)):
        words = ("--focus-distance", focus, "--f-number", f_number, "-o", "single.png")
        assert cli(*lens, *words).code == 0
        assert_allclose(
            read_map(f"maps/00{frame}/defocus.exr"), read_map("maps/defocus.exr"), rtol=1e-5, atol=1e-6
        )


def test_a_csv_file_of_keys_pulls_focus_and_blur(shot, cli):
    (shot / "pull.csv").write_text("frame,focus,blur\n1,0.5,10\n3,0.1,\n4,,4\n")
    assert cli(*STILL, "--pull", "pull.csv", "--frames", "1-4", "--save-maps", "maps").code == 0
    for frame, focus, blur in ((1, 0.5, 10), (2, 0.3, 8), (3, 0.1, 6), (4, 0.1, 4)):
        defocus = read_map(f"maps/{frame:04d}/defocus.exr")
        assert_allclose(defocus, blur * (read_map("disparity.png") - focus), atol=1e-5)


def test_maps_of_a_sequence_are_not_scaled_each_by_itself(shot, cli):
    """Frame 2 shows only half of the range; its values mean the same as in frame 1."""
    for frame, top in ((1, 1.0), (2, 0.5)):
        write_map(f"float.{frame}.exr", top * read_map("disparity.png"))
        write_map(f"raw.{frame}.exr", 3000 * top * read_map("disparity.png") - 500)
    words = ("render", "photo.png", *FAST, *FOCUS, "--frames", "1-2", "-o", "out.#.png", "--overwrite")
    files = ("--steady", "off", "--save-maps", "maps", "--disparity")
    for original in (("float.#.exr",), ("raw.#.exr", "--disparity-range", "-500,2500")):
        assert cli(*words, *files, *original).code == 0
        for frame, top in ((1, 1.0), (2, 0.5)):
            defocus = read_map(f"maps/{frame:04d}/defocus.exr")
            assert_allclose(defocus, 6 * (top * read_map("disparity.png") - 0.4), atol=1e-5)
    outcome = cli(*words, "--disparity", "raw.#.exr")
    assert outcome.code == 1
    assert "found -500 to 2500; set --disparity-range" in outcome.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*STILL, *FOCUS, "--frames", "four"), "--frames: expected frames such as 1001-1100"),
        ((*STILL, *FOCUS, "--frames", "1-4", "-o", "out.png"), "such as out.####.png, got out.png"),
        ((*SHOT, *FOCUS, "--frames", "1-4", "-o", "shot.####.png"), "got shot.0001.png, an input of a frame"),
        ((*STILL, *FOCUS, "--frames", "1-4", "--focus-from", "0.3"), "both --focus-from and --focus-to"),
        (
            (*STILL, *FOCUS, "--frames", "1-4", "--blur-from", 1, "--blur-to", 2),
            "--blur: expected either a value or a pull of it, got both",
        ),
        ((*STILL, "--frames", "1-4", "--blur", 6), "expected one of --focus, --focus-at"),
        (
            (*STILL, "--blur", 6, "--frames", "1-4", "--focus-from", 0.3, "--focus-to", 2),
            "--focus: expected a relative disparity in 0..1",
        ),
        (
            (*STILL, *FOCUS, "--frames", "1-4", "--f-number-from", 2, "--f-number-to", 4),
            "--f-number: expected nothing: it does not apply to --disparity with --blur, got 2",
        ),
        ((*STILL, *FOCUS, "--frames", "1-4", "--pull", "missing.csv"), "cannot read missing.csv"),
        (
            (*STILL, *FOCUS, "--frames", "1-4", "--pull", "a.csv", "--blur-from", 1, "--blur-to", 2),
            "expected either --pull or the ends",
        ),
        ((*STILL, *FOCUS, "--jobs", 2), "--frames: expected frames such as 1-100 for --jobs, got none"),
        (
            (*STILL, "--blur", 6, "--focus-from", 0, "--focus-to", 1),
            "--frames: expected frames such as 1-100 for --focus-from, --focus-to, got none",
        ),
        (
            (*SHOT[:-2], *FOCUS),
            "--frames: expected frames such as 1001-1100, since shot.####.png names a sequence",
        ),
        ((*STILL, *FOCUS, "--frames", "1-4", "--engine", "magic"), "got 'magic'"),
    ],
)
def test_a_mistake_is_reported_before_any_frame(shot, cli, words, message):
    before = {path: path.read_bytes() for path in shot.iterdir()}
    outcome = cli(*words)
    assert (outcome.code, outcome.out) == (1, "")
    assert outcome.err.startswith("bokehnet: error: ")
    assert outcome.err.count("\n") == 1
    assert message in outcome.err
    assert {path: path.read_bytes() for path in shot.iterdir()} == before


class Deadly:
    """A job that ends the process that takes it."""

    @property
    def shot(self):
        os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_process_that_dies_fails_its_frame_alone(folder):
    jobs = {1: Deadly(), 2: object(), 3: Deadly()}
    settings = RenderSettings(engine=EngineSettings(name="scatter"))
    outcomes = dict(render_in_processes(jobs, settings, 2))
    assert set(outcomes) == {1, 2, 3}
    assert (
        outcomes[1] == outcomes[3] == "the process that rendered it died (killed by signal 9, out of memory?)"
    )
    assert "AttributeError" in outcomes[2]


def hear_interrupts():
    """A job in the background ignores Ctrl-C, and what it starts would, too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def start(*words):
    """A long sequence of the same still, in a process group of its own."""
    program = [
        sys.executable,
        "-m",
        "bokehnet",
        *map(str, (*STILL, *FOCUS, "--frames", "1-600", *words)),
    ]
    return subprocess.Popen(
        program,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=hear_interrupts,
    )


def wait_for_frames(folder, count, process):
    end = time.monotonic() + 120
    while len(list(folder.glob("out.*.png"))) < count:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_no_process_starts_with_interrupts_let_through(python_process):
    """The first one starts multiprocessing's resource tracker, too, which unblocks them."""
    source = (
        "import signal\n"
        "from multiprocessing import resource_tracker\n"
        "from bokehnet.cli.render.shot.workers import _interrupts_held\n"
        "with _interrupts_held():\n"
        "    resource_tracker.ensure_running()\n"
        "    print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))\n"
    )
    assert python_process(source).out == "True\n"


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("jobs", [1, 2])
def test_ctrl_c_is_clean(folder, jobs):
    process = start("--jobs", jobs)
    wait_for_frames(folder, 3, process)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert out == ""
    assert err.splitlines()[-1] == "bokehnet: interrupted"
    assert "Traceback" not in err
    assert hidden(folder) == []
    files = outputs(folder)
    assert 3 <= len(files) < 600
    assert len(set(files.values())) == 1


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("jobs", [1, 2])
def test_killed_in_the_middle_and_run_again_nothing_is_lost_or_half(folder, cli, jobs):
    process = start("--jobs", jobs)
    wait_for_frames(folder, 3, process)
    process.kill()
    process.communicate(timeout=60)
    before = {path.name: path.stat().st_mtime_ns for path in folder.glob("out.*.png")}
    assert cli(*STILL, *FOCUS, "--frames", f"1-{len(before) + 5}").code == 0
    files = outputs(folder)
    assert len(files) >= len(before) + 5
    assert len(set(files.values())) == 1
    assert all((folder / name).stat().st_mtime_ns == time for name, time in before.items())


@pytest.mark.slow
def test_two_processes_may_write_the_same_frames(folder):
    processes = [start("--overwrite") for _ in range(2)]
    for process in processes:
        wait_for_frames(folder, 40, process)
    for process in processes:
        os.killpg(process.pid, signal.SIGINT)
        process.communicate(timeout=60)
        assert process.returncode == 130
    assert hidden(folder) == []
    assert len(set(outputs(folder).values())) == 1
