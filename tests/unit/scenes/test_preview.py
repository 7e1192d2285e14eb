"""Preview of a scene: orbit, draft and traced pictures against the tracer and geometry."""

from dataclasses import replace

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.scenes.preview import ScenePreview, View
from bokehnet.scenes.reader import read_scene

SCENE = """
[camera]
width = 48
height = 32
[lens]
focal_length = 50.0
f_number = 2.0
focus_distance = 1.5
[render]
samples = 8
bounces = 1
[environment]
color = [0.2, 0.2, 0.2]
[[quads]]
centre = [0.0, 0.0, 1.8]
u_axis = [2.0, 0.0, 0.0]
v_axis = [0.0, 2.0, 0.0]
material = { color = [0.5, 0.6, 0.7] }
[[quads]]
centre = [0.3, 0.0, 1.5]
u_axis = [0.05, 0.0, 0.0]
v_axis = [0.0, 0.3, 0.0]
material = { color = [0.9, 0.1, 0.1] }
[[lamps]]
position = [0.0, -1.0, 0.2]
intensity = [3.0, 3.0, 3.0]
"""


@pytest.fixture
def preview(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return ScenePreview(tmp_path / "scene.toml")


def test_refined_pictures_are_those_of_the_trace(preview):
    """Authority: the tracer of ``bokehnet trace``."""
    *_, (picture, samples) = preview.refine(View(lens=preview.lens, width=48), lambda: False)
    traced = read_scene(preview.path).tracer().render(8).bokeh.numpy()
    assert samples == 8
    assert picture == pytest.approx(traced, abs=1e-5)


def test_a_draft_in_focus_is_the_traced_light(preview):
    """Authority: the tracer, whose few samples of ambient light leave some noise."""
    lens = replace(preview.lens, focus_distance=1.8)
    draft = preview.draft(View(lens=lens, width=48))
    *_, (traced, _) = preview.refine(View(lens=lens, width=48), lambda: False)
    error = np.abs(draft - traced)[:, :10] / traced[:, :10]
    assert np.quantile(error, 0.9) < 0.02


def test_an_orbit_keeps_the_pivot_and_turns_the_rest(preview):
    """Authority: geometry. The pivot is 1.5 m ahead; seen from the right, what is behind it moves right."""
    ahead, aside = (
        preview.focus_at(View(lens=preview.lens, width=480, azimuth=turn), 0.5, 0.5) for turn in (0, 20)
    )
    assert ahead == pytest.approx(1.8, abs=1e-3)
    # The ray through the pivot meets the wall 0.3 m behind it, at 0.3 / cos(20 degrees) beyond.
    assert aside == pytest.approx(1.5 + 0.3 / np.cos(np.radians(20)), abs=2e-3)


def test_zoom_is_the_distance_from_the_pivot(preview):
    assert preview.focus_at(View(lens=preview.lens, zoom=2), 0.5, 0.5) == pytest.approx(3.3, abs=1e-3)


def test_seen_from_above_the_camera_rises(preview):
    """Authority: the pose; y points down."""
    pose = preview._camera(View(lens=preview.lens, elevation=30), ideal=True).pose
    assert pose.position == pytest.approx((0, -750, 1500 - 1500 * np.cos(np.radians(30))), abs=1e-3)
    assert np.array(pose.rotation) @ [0, 0, 1500] + pose.position == pytest.approx((0, 0, 1500), abs=1e-3)


def test_a_cancelled_iteration_ends(preview):
    assert list(preview.refine(View(lens=preview.lens), lambda: True)) == []


def test_a_wrong_view_is_an_error(preview):
    with pytest.raises(ParameterError, match="elevation"):
        View(lens=preview.lens, elevation=90)
