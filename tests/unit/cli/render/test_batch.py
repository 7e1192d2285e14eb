"""Many pictures of unlike names. Authority: each picture rendered by a command of its own."""

import json

import numpy as np
import pytest

from bokehnet.io.image import write_image, write_map

WORDS = ["--blur", "6", "--focus", "1", "--engine", "scatter", "--repair-disparity", "off"]


@pytest.fixture
def photos(tmp_path, monkeypatch):
    """Three pictures with maps, a.png, tree 2.jpg and c.png with c_depth.png."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    for folder in ("photos", "maps"):
        (tmp_path / folder).mkdir()
    for picture, depth in (("a.png", "a.png"), ("tree 2.jpg", "tree 2.png"), ("c.png", "c_depth.png")):
        write_image(f"photos/{picture}", rng.random((40, 56, 3), dtype=np.float32))
        write_map(f"maps/{depth}", np.tile(np.linspace(0, 1, 56, dtype=np.float32), (40, 1)))
    return tmp_path


@pytest.mark.parametrize("pictures", ["photos/", "photos/*"])
def test_each_picture_is_rendered_with_the_map_of_its_name(photos, cli, pictures):
    outcome = cli("render", pictures, "--disparity", "maps", "-o", "out", *WORDS)
    assert outcome.code == 0, outcome.err
    assert "3 pictures rendered" in outcome.err
    for picture, depth in (("a.png", "a.png"), ("tree 2.jpg", "tree 2.png"), ("c.png", "c_depth.png")):
        single = photos / f"single_{picture}"
        assert (
            cli("render", f"photos/{picture}", "--disparity", f"maps/{depth}", "-o", single, *WORDS).code == 0
        )
        assert (photos / "out" / picture).read_bytes() == single.read_bytes()


def test_failures_are_listed_at_the_end_and_do_not_stop_the_others(photos, cli):
    (photos / "maps" / "a.png").unlink()
    (photos / "photos" / "c.png").write_bytes(b"no picture")
    outcome = cli("render", "photos", "--disparity", "maps", "-o", "out", *WORDS, "--json")
    assert outcome.code == 1
    table = json.loads(outcome.out)
    assert set(table["pictures"]) == {"photos/tree 2.jpg"}
    assert set(table["failed"]) == {"photos/a.png", "photos/c.png"}
    lines = outcome.err.strip().splitlines()
    assert "one map named a.* in maps for a.png, got none" in lines[-3]
    assert lines[-2].startswith("bokehnet: failed: photos/c.png: ")
    assert lines[-1] == "bokehnet: error: 2 of 3 pictures failed"


def test_a_reason_of_several_failures_is_printed_once(photos, cli):
    """Authority: one mistake, one line, with the names of all pictures."""
    words = ["--f-number", "2", "--focus-distance", "2"]  # a distance does not apply to disparity
    outcome = cli("render", "photos", "--disparity", "maps", "-o", "out", *words)
    assert outcome.code == 1
    lines = [line for line in outcome.err.splitlines() if "failed: " in line]
    assert len(lines) == 1
    assert lines[0].startswith(
        "bokehnet: failed: photos/a.png, photos/c.png, photos/tree 2.jpg: --focus-distance: "
    )


def test_finished_pictures_are_kept(photos, cli):
    words = ["render", "photos", "--constant-disparity", "0.5", "-o", "out", *WORDS]
    assert cli(*words).code == 0
    (photos / "out" / "a.png").write_bytes(b"")
    assert "1 picture rendered, 2 exist already" in cli(*words).err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["photos", "-o", "out.png"], "--output: expected a folder for many pictures, got out.png"),
        (["photos"], "--output: expected a folder for many pictures, got none"),
        (
            ["none/*.png", "-o", "out"],
            "IMAGE: expected a folder or glob with pictures, got none in none/*.png",
        ),
        (
            ["photos", "-o", "out", "--matte", "none"],
            "--matte: expected a file, a folder or a glob, got none at none",
        ),
    ],
)
def test_an_invalid_batch_is_reported_in_one_line(photos, cli, words, message):
    outcome = cli("render", *words, "--constant-disparity", "0.5", *WORDS)
    assert outcome.code == 1
    assert message in outcome.err
    assert outcome.err.count("\n") == 1
