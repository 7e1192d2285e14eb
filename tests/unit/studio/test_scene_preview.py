"""The previewer of scene files: its session, and its errors."""

import io
import math

import numpy as np
import pytest
from PIL import Image

pytest.importorskip("torch", reason="scenes need the extra train")

from bokehnet.errors import ConfigError, ParameterError
from bokehnet.studio.scene_preview.session import SceneSession

SCENE = """
[camera]
width = 48
height = 32
[lens]
focal_length = 50.0
f_number = 2.0
focus_distance = 1.5
[render]
samples = 12
[environment]
color = [0.2, 0.2, 0.2]
[[spheres]]
centre = [0.0, 0.0, 1.5]
radius = 0.1
material = { color = [0.8, 0.1, 0.1] }
[[spheres]]
centre = [0.0, -1.0, 0.5]
radius = 0.1
material = { emission = [20.0, 20.0, 20.0] }
"""
LENS = {"name": "thin", "focal_length": 50.0, "f_number": 2.0, "focus_distance": 1.5}


@pytest.fixture
def session(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    opened = SceneSession(tmp_path / "scene.toml")
    yield opened
    opened.close()


def pixels(picture) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(picture.jpeg)), float)


def test_a_draft_comes_first_and_pictures_converge_to_the_scenes_samples(session):
    request = {"lens": LENS, "width": 48, "draft_width": 32}
    pictures = list(session.pictures(request))
    assert [picture.stage for picture in pictures] == ["draft", "traced", "traced"]
    assert [picture.samples for picture in pictures] == [0, 4, 12]
    assert pixels(pictures[0]).shape == (21, 32, 3)
    assert pixels(pictures[-1]).shape == (32, 48, 3)


def test_a_newer_request_ends_an_older_one(session):
    old = session.pictures({"lens": LENS, "width": 48})
    assert next(old).stage == "draft"
    assert next(session.pictures({"lens": LENS, "moving": True})).stage == "draft"
    assert list(old) == []


def test_a_click_focuses_on_the_surface(session):
    """Authority: the sphere's front is at its centre's depth less its radius."""
    request = {"lens": {**LENS, "focus_distance": 3.0}, "focus_at": [0.5, 0.5], "moving": True}
    assert next(session.pictures(request)).focus_distance == pytest.approx(1.4, abs=2e-3)


def test_a_click_on_nothing_focuses_at_infinity(session):
    request = {"lens": LENS, "focus_at": [0.01, 0.99], "moving": True}
    assert math.isinf(next(session.pictures(request)).focus_distance)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"elevation": 95}, r"^elevation: expected -89 to 89"),
        ({"zoom": 0}, r"^zoom: expected"),
        ({"draft_width": 9999}, r"^draft_width: expected 16 to 1280"),
        ({"lens": {"name": "no such lens"}}, r"^lens: expected one of"),
    ],
)
def test_wrong_values_are_one_line(session, change, message):
    with pytest.raises(ParameterError, match=message):
        next(session.pictures({"lens": LENS, **change}))


def test_a_lens_that_cannot_focus_so_near_is_one_line(session):
    with pytest.raises(ConfigError, match="focus distance"):
        next(session.pictures({"lens": {**LENS, "focus_distance": 0.01}}))


def test_a_mesh_without_a_scene_opens_in_the_middle_and_in_focus(tmp_path):
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    box = trimesh.creation.box((40, 40, 40))
    box.apply_translation((500, 0, 0))
    box.export(tmp_path / "box.STL", file_type="stl")
    opened = SceneSession(tmp_path / "box.STL")
    lens = opened.state()["lens"]
    picture = next(opened.pictures({"lens": lens, "focus_at": [0.5, 0.5], "moving": True}))
    opened.close()
    assert lens["focus_distance"] == 1.5
    assert picture.focus_distance == pytest.approx(1.25, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [("empty.obj", "", "at least one triangle"), ("cut.ply", "ply\nformat ascii 1.0\n", "be read as a mesh")],
)
def test_a_mesh_file_without_triangles_is_one_line(cli, tmp_path, name, content, message):
    pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    (tmp_path / name).write_text(content)
    failed = cli("studio", tmp_path / name, "--no-browser")
    assert failed.code == 1
    assert message in failed.err
    assert len(failed.err.strip().splitlines()) == 1


def test_without_torch_scenes_are_refused_in_one_line(python_process):
    source = """
import sys
sys.modules["torch"] = None
from bokehnet.cli.app import run
sys.exit(run(["studio", "scene.toml", "--no-browser"]))
"""
    refused = python_process(source)
    assert refused.code == 1
    assert refused.err == "bokehnet: error: this needs torch: pip install 'bokehnet[trace]'\n"


def test_the_command_line_refuses_settings_of_a_render_for_a_scene(cli, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    refused = cli("studio", tmp_path / "scene.toml", "--blur", 5, "--no-browser")
    assert refused.code == 1
    assert "the scene" in refused.err
    broken = tmp_path / "broken.toml"
    broken.write_text("[camera]\nwidth = 3\n")
    failed = cli("studio", broken, "--no-browser")
    assert failed.code == 1
    assert "broken.toml" in failed.err
