"""Exports of the studio: the command line's bytes, and the command that makes them."""

import shlex
from pathlib import Path

import pytest

from bokehnet.cli.app import run
from bokehnet.io.image import read_image
from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.panels.wording import command_line, python_lines

from .conftest import SIZE

LOOKS = {
    "plain": {},
    "shape": {"aperture": {"blades": 6, "curvature": 0.25, "cats_eye": 0.5}},
    "glass": {"lens": {"coma": -2.0, "spherical": 1.5, "vignetting": False}},
    "light": {"highlights": {"threshold": 0.8, "gain": 4.0}, "effects": {"vignette": 0.7}},
    "tilt": {"focus": {"value": 0.4, "tilt_x": -20.0}, "engine": {"name": "scatter"}},
    "file": {"output": {"bits": "16", "dither": "off"}, "depth": {"mixed": "on"}},
}


@pytest.mark.parametrize("look", LOOKS)
def test_an_export_has_the_bytes_of_the_shown_command(client, opened, exported, tmp_path, monkeypatch, look):
    client.post("api/change", json={"changes": LOOKS[look]})
    words = client.post("api/words", json={"name": "out.png"}).json()
    monkeypatch.chdir(tmp_path)
    assert run([*shlex.split(words["command"])[1:], "-q"]) == 0
    result = (tmp_path / "out.png").read_bytes()
    assert exported("out.png") == result
    (tmp_path / "out.png").unlink()
    exec(words["python"], {})
    assert (tmp_path / "out.png").read_bytes() == result


def test_an_export_of_a_painted_map_has_the_bytes_of_its_command(
    client, opened, exported, tmp_path, monkeypatch
):
    stroke = {"effect": "farther", "points": [[0.5, 0.5], [0.6, 0.6]], "radius": 0.1, "strength": 0.5}
    assert client.post("api/stroke", json={"stroke": stroke}).json()["strokes"] == 1
    client.post("api/stroke", json={"stroke": stroke | {"effect": "sharp", "points": [[0.1, 0.1]]}})
    words = client.post("api/words", json={"name": "out.png"}).json()
    (tmp_path / words["map"]).write_bytes(client.get("api/map").content)
    monkeypatch.chdir(tmp_path)
    assert run([*shlex.split(words["command"])[1:], "-q"]) == 0
    assert exported("out.png") == (tmp_path / "out.png").read_bytes()


def test_words_say_every_value_that_was_set():
    values = {
        "focus": {"plane": [[1, 2], [30, 4], [5, 60]]},
        "camera": {"blur": 0.1 + 0.2},
        "lens": {"vignetting": False, "coma": -1.0},
        "aperture": {"blades": 5},
        "color": {"lateral": 1.0, "equaliser": [1.0, 0.5]},
    }
    settings = RenderSettings().updated(values)
    command = command_line("a b.jpg", "out.png", settings)
    for part in (
        "'a b.jpg'",
        "--focus-plane 1,2 30,4 5,60",
        "--blur 0.30000000000000004",
        "--no-lens-vignetting",
    ):
        assert part in command
    assert "--coma=-1.0" in command
    assert "--equaliser 1.0,0.5" in command
    compile(python_lines("a.jpg", "b.png", settings), "words", "exec")


@pytest.mark.parametrize(
    ("name", "expected"), [("a.JPG", "a_bokeh.jpg"), ("a.png", "a_bokeh.png"), ("a.heic", "a_bokeh.jpg")]
)
def test_an_export_has_the_format_of_the_picture(opened, name, expected):
    session_name = f"{name[0]}_bokeh{type(opened.opened)(Path(name), opened.opened.scene).export_suffix}"
    assert session_name == expected


def test_exported_pictures_can_be_read(client, opened, exported, tmp_path):
    (tmp_path / "out.jpg").write_bytes(exported("out.jpg"))
    assert read_image(tmp_path / "out.jpg").shape == (SIZE[1], SIZE[0], 3)
