"""Subject search, checked against scenes whose subject is known by construction."""

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.io.window import Window
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import MetricDepth, RelativeDisparity
from bokehnet.scene.scene import make_scene
from bokehnet.scene.subject import find_subject, surface_around
from bokehnet.settings.settings import RenderSettings

HEIGHT, WIDTH = 96, 144


def gray(value=0.5):
    return np.full((HEIGHT, WIDTH, 3), value, np.float32)


def ground_with(*boxes):
    """Return a map of ground below a far wall, with upright boxes (x, width, top row, foot row)."""
    y = np.arange(HEIGHT, dtype=np.float32)[:, None]
    ground = np.maximum((y - 40) / (HEIGHT - 40), 0) * 0.8 + 0.1
    values = np.broadcast_to(ground, (HEIGHT, WIDTH)).copy()
    for x, width, top, foot in sorted(boxes, key=lambda box: box[3]):
        values[top:foot, x : x + width] = ground[foot - 1, 0]
    return values


@pytest.mark.parametrize("x", [20, 60, 100])
def test_the_subject_excludes_the_ground_it_stands_on(x):
    values = ground_with((x, 24, 25, 70))
    subject = find_subject(gray(), values)
    assert not subject.is_fallback
    column, row = subject.position
    assert x <= column < x + 24
    assert 25 <= row < 70
    assert subject.disparity == pytest.approx(values[69, x], abs=1e-6)
    assert subject.near - subject.far < 0.06
    assert subject.far <= subject.disparity <= subject.near


def test_a_round_body_stays_sharp_as_a_whole():
    """A sphere's disparity falls towards its outline; ray-sphere intersection gives the extent."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    inside = 1 - ((x - 70) / 30) ** 2 - ((y - 48) / 30) ** 2
    body = 0.6 + 0.1 * np.sqrt(np.maximum(inside, 0))
    values = np.where(inside > 0, body, 0.1).astype(np.float32)
    subject = find_subject(gray(), values)
    sharp = (values >= subject.far) & (values <= subject.near)
    assert sharp[inside > 0].mean() > 0.93
    assert not sharp[inside <= 0].any()


def test_nothing_that_stands_out_falls_back_to_the_near_middle():
    ramp = np.broadcast_to(np.linspace(0, 1, WIDTH, dtype=np.float32), (HEIGHT, WIDTH)).copy()
    subject = find_subject(gray(), ramp)
    assert subject.is_fallback
    assert subject.certainty < 0.35
    assert 0.4 < subject.disparity < 0.8


def test_a_face_decides_between_equal_candidates():
    values = ground_with((20, 26, 30, 70), (98, 26, 30, 70))
    left, right = (find_subject(gray(), values, faces=lambda _, x=x: [(x, 32, 16, 16)]) for x in (25, 103))
    assert left.position[0] < WIDTH // 2 < right.position[0]


def test_the_unit_of_the_map_does_not_matter():
    values = ground_with((50, 30, 25, 75))
    one, other = find_subject(gray(), values), find_subject(gray(), 0.002 * values + 0.0001)
    assert one.position == other.position
    assert other.disparity == pytest.approx(0.002 * one.disparity + 0.0001, rel=1e-5)


def test_a_surface_ends_at_its_depth_edges():
    values = ground_with((50, 30, 25, 75))
    surface = surface_around(values, (60, 40))
    assert surface.near == surface.far == surface.disparity == values[40, 60]


def test_maps_with_nan_are_refused():
    with pytest.raises(ParameterError, match="finite"):
        find_subject(gray(), np.full((HEIGHT, WIDTH), np.nan, np.float32))


def test_a_render_without_focus_keeps_the_subject_sharp():
    """Dead zone of the defocus map: 0 on the whole subject, unlike with a single plane."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    inside = 1 - ((x - 70) / 30) ** 2 - ((y - 48) / 30) ** 2
    values = np.where(inside > 0, 0.6 + 0.1 * np.sqrt(np.maximum(inside, 0)), 0.1).astype(np.float32)
    scene = make_scene(gray(), RelativeDisparity(map=values, as_stored=True))
    changes = {"camera": {"blur": 50}, "depth": {"repair": "off"}}
    renderer, settings = BokehRenderer("scatter"), RenderSettings().updated(changes)
    focused = renderer.prepare(scene, settings)
    assert "focus on the subject" in focused.lens.assumptions[0]
    assert (focused.defocus[inside > 0] == 0).mean() > 0.93
    assert focused.defocus[0, 0] < -10
    plane = renderer.prepare(scene, settings.updated({"focus": {"range": "off"}}))
    assert (plane.defocus[inside > 0] == 0).mean() < 0.1


def test_depth_in_metres_without_focus_falls_on_the_subject():
    depth = np.full((HEIGHT, WIDTH), 10.0, np.float32)
    depth[20:80, 50:90] = 2
    changes = {"camera": {"focal_length": 50, "f_number": 2, "sensor_width": 36}}
    scene = make_scene(gray(), MetricDepth(map=depth))
    focused = BokehRenderer("scatter").prepare(scene, RenderSettings().updated(changes))
    assert focused.lens.distance == pytest.approx(2, rel=1e-4)


def test_the_note_counts_pixels_of_the_shown_picture():
    subject = find_subject(gray(), ground_with((50, 30, 25, 75)))
    x, y = subject.position
    window = Window(x=10, y=20, width=WIDTH, height=HEIGHT, display_width=400, display_height=400)
    assert f"pixel {x + 10},{y + 20} " in subject.note(window)


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 2), (3, 1), (1, 40)])
def test_tiny_pictures_have_a_subject_or_none(size):
    rng = np.random.default_rng(0)
    find_subject(rng.random((*size, 3), np.float32), rng.random(size, np.float32))
