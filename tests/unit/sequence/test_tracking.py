"""Tracked points against the known motion of a synthetic shot."""

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map
from bokehnet.sequence.sequence import SequenceSettings, make_pull, read_pull
from bokehnet.sequence.tracking import TrackedPoint, track_point, track_through

HEIGHT, WIDTH, RADIUS = 120, 200, 26


def grain(seed, shape):
    from scipy.ndimage import gaussian_filter

    values = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 1.5)
    return np.clip(0.5 + 0.15 * values / values.std(), 0.05, 0.95)


GROUND, THING = grain(0, (HEIGHT, WIDTH + 100)), grain(1, (2 * RADIUS + 1,) * 2)


def frame(t, hidden=False):
    """A disc with its middle at (50 + 3 t, 40 + t), before a ground that moves by (1, 0) pixels a frame."""
    picture = GROUND[:, 100 - t : 100 - t + WIDTH].copy()
    x, y = 50 + 3 * t, 40 + t
    v, u = np.mgrid[-RADIUS : RADIUS + 1, -RADIUS : RADIUS + 1]
    inside = (u * u + v * v <= RADIUS**2) & (not hidden)
    window = picture[y - RADIUS : y + RADIUS + 1, x - RADIUS : x + RADIUS + 1]
    window[inside] = THING[inside]
    return np.repeat(picture[..., None], 3, 2).astype(np.float32)


def test_a_point_follows_its_thing_within_a_pixel():
    path = list(track_point(((t, frame(t)) for t in range(30)), 55, 36))
    assert not any(point.is_lost for point in path)
    assert max(np.hypot(p.x - 55 - 3 * p.number, p.y - 36 - p.number) for p in path) < 1


def test_a_path_leads_both_ways_from_its_start():
    path = track_through(frame, range(12), 50 + 18, 40 + 6, start=6)
    assert [point.number for point in path] == list(range(12))
    assert max(np.hypot(p.x - 50 - 3 * p.number, p.y - 40 - p.number) for p in path) < 1


def test_a_thing_that_is_hidden_is_lost_and_stays_where_it_was():
    path = list(track_point(((t, frame(t, hidden=t >= 6)) for t in range(9)), 50, 40))
    assert [point.is_lost for point in path] == [False] * 6 + [True] * 3
    assert {(point.x, point.y) for point in path[6:]} == {(path[5].x, path[5].y)}


def test_a_thing_that_leaves_the_picture_is_lost():
    path = list(track_point(((t, frame(t)[:, : 100 - 2 * t]) for t in (0,)), 5, 5))
    assert path == [TrackedPoint(number=0, x=5, y=5)]
    path = list(track_point(((t, frame(0)[:, 9 * t : 9 * t + 150]) for t in range(9)), 40, 40))
    assert [point.is_lost for point in path] == [False] * 5 + [True] * 4


def test_a_pull_may_be_a_path_of_pixels(tmp_path):
    file = tmp_path / "keys.csv"
    file.write_text("frame,focus_at_x,focus_at_y\n1,10,20\n5,30,24\n")
    assert read_pull(file).at(3) == {"focus_at_x": 20.0, "focus_at_y": 22.0}
    path = [TrackedPoint(number=t, x=t, y=2 * t) for t in (1, 2)]
    pull = make_pull([1, 2], SequenceSettings(track=(1, 2)), metric=False, path=path)
    assert pull.at(2) == {"focus_at_x": 2.0, "focus_at_y": 4.0}


@pytest.fixture
def shot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    for t in range(6):
        write_image(f"in.{t}.png", frame(t) ** 2.2)
        inside = (x - 50 - 3 * t) ** 2 + (y - 40 - t) ** 2 <= RADIUS**2
        write_map(f"z.{t}.png", np.where(inside, 0.3 + 0.1 * t, 0.1).astype(np.float32))
    return tmp_path


WORDS = [
    "render",
    "in.#.png",
    "--disparity",
    "z.#.png",
    "-o",
    "out.#.png",
    "--blur",
    "4",
    "--engine",
    "scatter",
]
WORDS += ["--repair-disparity", "off", "--steady", "off", "-v"]


def focus_of(error):
    import re

    return [float(value) for value in re.findall(r"focus at ([\d.]+)", error)]


@pytest.mark.parametrize("words", [["--track", "50,40"], ["--track", "62,44@4"], ["--pull", "keys.csv"]])
def test_the_focus_stays_on_a_thing_that_comes_nearer(shot, cli, words):
    """Authority: the disparity of the thing, which moves by 15 pixels."""
    (shot / "keys.csv").write_text("frame,focus_at_x,focus_at_y\n0,50,40\n5,65,45\n")
    outcome = cli(*WORDS, "--frames", "0-5", *words)
    assert outcome.code == 0, outcome.err
    np.testing.assert_allclose(focus_of(outcome.err), 0.3 + 0.1 * np.arange(6), atol=0.006)


def test_a_lost_thing_is_reported(shot, cli):
    write_image("in.3.png", frame(3, hidden=True) ** 2.2)
    outcome = cli(*WORDS, "--frames", "0-5", "--track", "50,40")
    assert outcome.code == 0
    assert "note: --track loses the thing in frame 3" in outcome.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--track", "500,40"], "--track: expected a pixel inside the picture of 200x120, got 500,40"),
        (["--track", "5"], "--track: expected a pixel X,Y, or X,Y@FRAME"),
        (["--track", "5,5@77"], "--track: expected a frame that exists, got frame 77"),
        (["--track", "5,5", "--focus-from", "0", "--focus-to", "1"], "--track: expected no other focus"),
    ],
)
def test_an_invalid_track_is_reported_in_one_line(shot, cli, words, message):
    outcome = cli(*WORDS, "--frames", "0-5", *words)
    assert (outcome.code, outcome.out) == (1, "")
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
