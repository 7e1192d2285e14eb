"""Summary of ``bokehnet render``: a line, nothing, more, or JSON."""

import json
import re
import shutil

import pytest

from bokehnet.cli.render.summary import FrameSummary
from bokehnet.render.result import RenderReport

SCATTER = ("--engine", "scatter", "--blur", 6, "-o", "out.png")
RELATIVE = ("render", "photo.png", "--disparity", "disparity.png", *SCATTER)
METRIC = ("render", "photo.png", "--depth", "camera.exr", "--engine", "rays", "-o", "out.png")
CAMERA = ("--focal-length", 50, "--f-number", 2, "--sensor-width", 36)
SEQUENCE = ("render", "photo.png", "--disparity", "disparity.png", *SCATTER[:-1], "out.##.png")


def test_one_line_names_size_engine_focus_blur_repair_and_time(folder, cli):
    """Authority: the largest |blur * (disparity - focus)| is 6 * (1 - 0.4) = 3.6 pixels."""
    outcome = cli(*RELATIVE, "--focus", 0.4, "--repair-disparity", "off")
    assert (outcome.code, outcome.out) == (0, "")
    message = (
        r"bokehnet: out\.png: 64x40, scatter, focus at 0\.4, blur up to 3\.6 px, "
        r"map unchanged, \d+\.\d s; assumed: bright is near \(--invert if not\)\n"
    )
    assert re.fullmatch(message, outcome.err)


def test_the_repair_is_reported_with_its_reason(folder, cli):
    outcome = cli(*RELATIVE, "--focus", 0.4, "--repair-disparity", "on")
    assert "map repaired (asked for)" in outcome.err


def test_distances_are_reported_in_metres(folder, cli):
    outcome = cli(*METRIC, *CAMERA, "--focus-distance", 2.5)
    assert outcome.code == 0
    assert "64x40, rays, focus at 2.5 m, blur up to " in outcome.err


def test_quiet_prints_nothing(folder, cli):
    outcome = cli(*RELATIVE, "--focus", 0.4, "--quiet")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")


def test_verbose_adds_what_each_step_took(folder, cli):
    outcome = cli(*RELATIVE, "--focus", 0.4, "-v")
    first, second = outcome.err.splitlines()
    assert first.startswith("bokehnet: out.png: 64x40")
    steps = ", ".join(rf"{step} \d+\.\d\d s" for step in ("read", "prepare", "render", "write"))
    assert re.fullmatch(rf"bokehnet: {steps}(, \d+\.\d\d GB peak memory)?", second)


def test_json_is_one_object_on_stdout(folder, cli):
    outcome = cli(*RELATIVE, "--focus", 0.4, "--repair-disparity", "off", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    summary = json.loads(outcome.out)
    seconds = summary.pop("seconds")
    assert set(seconds) == {"read", "prepare", "render", "write"}
    assert min(seconds.values()) >= 0
    assert summary.pop("largest_blur_px") == pytest.approx(3.6)
    assert summary.pop("focus_disparity") == pytest.approx(0.4)
    assert summary == {
        "output": "out.png",
        "width": 64,
        "height": 40,
        "engine": "scatter",
        "focus_distance_m": None,
        "focus_far_disparity": None,
        "focus_far_distance_m": None,
        "repaired": None,
        "repair_reason": "",
        "pixel_filter": None,
        "pixel_filter_reason": None,
        "pixel_filter_confidence": None,
        "assumptions": ["bright is near"],
        "recovered_light": "",
        "notes": [],
    }


def test_the_pixel_filter_is_reported_for_unmixed_pixels(folder, cli):
    rays = ("render", "photo.png", "--disparity", "disparity.png", "--engine", "rays", "--blur", 6)
    requested = (
        *rays,
        "--focus",
        0.4,
        "-o",
        "out.png",
        "--repair-disparity",
        "off",
        "--pixel-filter",
        "arnold",
    )
    outcome = cli(*requested, "-v")
    assert outcome.err.splitlines()[1].count("pixel filter gaussian:2 (as set)") == 1
    summary = json.loads(cli(*requested, "--json").out)
    assert (summary["pixel_filter"], summary["pixel_filter_reason"]) == ("gaussian:2", "as set")
    assert summary["pixel_filter_confidence"] is None


def test_quiet_and_verbose_contradict_each_other(fails):
    fails([*RELATIVE[:-2], "--focus", 0.4, "-q", "-v"], "--quiet", "--verbose")


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_json_of_a_sequence_lists_every_frame(folder, cli, jobs):
    shutil.copy(folder / "photo.png", folder / "out.02.png")
    words = ("--focus", 0.4, "--frames", "1-3", "--jobs", jobs, "--json")
    outcome = cli(*SEQUENCE, *words)
    assert (outcome.code, outcome.err) == (0, "")
    summary = json.loads(outcome.out)
    assert (set(summary["frames"]), summary["there"], summary["failed"]) == ({"1", "3"}, 1, {})
    assert summary["frames"]["3"]["output"] == "out.03.png"


def test_json_of_a_sequence_lists_failures(folder, cli):
    (folder / "photo.01.png").write_bytes((folder / "photo.png").read_bytes())
    words = ("--focus", 0.4, "--frames", "1-2", "--json")
    outcome = cli("render", "photo.##.png", *SEQUENCE[2:], *words)
    assert outcome.code == 1
    summary = json.loads(outcome.out)
    assert set(summary["frames"]) == {"1"}
    assert "photo.02.png" in summary["failed"]["2"]


def test_verbose_lists_every_frame_of_a_sequence(folder, cli):
    outcome = cli(*SEQUENCE, "--focus", 0.4, "--frames", "1-2", "-v")
    lines = [line for line in outcome.err.splitlines() if line.startswith("bokehnet")]
    assert [line[:18] for line in lines] == ["bokehnet: frame 1:", "bokehnet: frame 2:", "bokehnet: 2 frames"]


def test_what_was_not_found_is_left_out():
    report = RenderReport(engine="rays", largest_blur=160.4)
    summary = FrameSummary(output="a.png", width=8, height=6, report=report, seconds={"render": 1.26})
    assert summary.line() == "a.png: 8x6, rays, blur up to 160 px, map unchanged, 1.3 s"


@pytest.mark.parametrize(
    ("focus", "words"),
    [
        ({"focus_disparity": 0.8, "focus_far_disparity": 0.65}, "sharp from 0.65 to 0.8,"),
        ({"focus_disparity": 0.8, "focus_far_disparity": 0.8}, "focus at 0.8,"),
        (
            {"focus_disparity": 5e-4, "focus_far_disparity": 4e-4}
            | {"focus_distance": 2.0, "focus_far_distance": 2.5},
            "sharp from 2 to 2.5 m,",
        ),
    ],
)
def test_both_ends_of_a_range_are_reported(focus, words):
    report = RenderReport(engine="rays", largest_blur=4, **focus)
    assert words in FrameSummary(output="a.png", width=8, height=6, report=report, seconds={}).line()


def test_a_focus_range_is_reported_with_both_ends(folder, cli):
    outcome = cli(*METRIC, *CAMERA, "--focus-range", "2,2.5")
    assert (outcome.code, "sharp from 2 to 2.5 m, blur up to " in outcome.err) == (0, True), outcome.err


def test_zero_blur_is_printed_without_a_sign(folder, cli):
    outcome = cli(*RELATIVE, "--blur", 0, "--focus", 1, "--repair-disparity", "off")
    assert "blur up to 0 px" in outcome.err
