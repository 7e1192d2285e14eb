"""Range of disparities that stays sharp; for the command line see test_focus_plane_options.py."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import LensError, ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.scene.depth.depth_source import DepthMap
from bokehnet.scene.focus import disparity_at_pixel, disparity_of_distance, focus_lens
from bokehnet.scene.focus_checks import check_focus
from bokehnet.settings.settings import CameraSettings, FocusSettings, InputSettings, RenderSettings

WIDTH, HEIGHT = 64, 40
WINDOW = Window.whole(WIDTH, HEIGHT)
LENS = CameraSettings(focal_length=50, f_number=2, sensor_width=36)


def relative(values):
    return DepthMap(values=np.asarray(values, np.float32), kind="relative", origin="input.disparity")


def metric(metres, camera=None):
    values = (1 / (1000 * np.asarray(metres))).astype(np.float32)
    return DepthMap(values=values, kind="metric", origin="input.depth", camera=camera)


def test_a_lens_is_focused_where_the_plane_is_in_the_middle():
    """The focus in the middle of a map that is linear from 0.1 at the left to 0.9 at the right."""
    depth = relative(np.linspace(0.1, 0.9, WIDTH)[None].repeat(HEIGHT, 0))
    focus = FocusSettings(plane=((3, 3), (60, 5), (20, 30)))
    lens = focus_lens(depth, WINDOW, focus, CameraSettings(blur=6))
    assert lens.near == lens.far == pytest.approx(0.5)
    assert lens.distance is None
    assert_allclose(lens.defocus(depth.values), 0, atol=1e-5)
    assert lens.aberration_map() is not None


def test_the_ends_of_a_range_come_in_any_order():
    """Authority: blur times the distance of the disparity from the interval."""
    depth = relative(np.tile(np.linspace(0, 1, WIDTH), (HEIGHT, 1)))
    for ends in ((0.3, 0.5), (0.5, 0.3)):
        lens = focus_lens(depth, WINDOW, FocusSettings(range=ends), CameraSettings(blur=6))
        assert (lens.near, lens.far) == (0.5, 0.3)
        expected = 6 * (depth.values - np.clip(depth.values, 0.3, 0.5))
        assert_allclose(lens.defocus(depth.values), expected, atol=1e-6)


@pytest.mark.parametrize("focus", [1.0, 3.0, math.inf])
def test_a_distance_gives_the_textbook_circle_of_confusion(focus):
    """Authority: c = f^2 |1/s - 1/d| / (N (1 - f/s)), halved, over the pixel pitch."""
    metres = np.tile(np.linspace(0.5, 20, WIDTH), (HEIGHT, 1))
    depth = metric(metres)
    lens = focus_lens(depth, WINDOW, FocusSettings(distance=focus), LENS)
    assert lens.distance == pytest.approx(focus)
    pitch = 36 / WIDTH
    c = 50**2 / 2 * (1 / (1000 * metres) - 1 / (1000 * focus)) / (1 - 50 / (1000 * focus))
    assert_allclose(lens.defocus(depth.values), c / 2 / pitch, rtol=1e-4, atol=1e-4)


def test_the_file_sets_focus_and_camera_without_options():
    camera = Camera(focal_length=50.0, f_number=2.0, sensor_width=36.0, focus_distance=1500.0)
    depth = metric(np.full((HEIGHT, WIDTH), 4.0), camera)
    result = focus_lens(depth, WINDOW, FocusSettings(), CameraSettings())
    expected = focus_lens(metric(np.full((HEIGHT, WIDTH), 4.0)), WINDOW, FocusSettings(distance=1.5), LENS)
    assert result.distance == pytest.approx(1.5)
    assert_allclose(result.defocus(depth.values), expected.defocus(depth.values))


def test_a_pixel_is_one_of_the_shown_picture():
    depth = relative(np.arange(12, dtype=np.float32).reshape(3, 4) / 12)
    window = Window(x=2, y=1, width=4, height=3, display_width=8, display_height=6)
    assert disparity_at_pixel((2, 1), depth, window) == 0
    assert disparity_at_pixel((5, 3), depth, window) == pytest.approx(11 / 12)
    with pytest.raises(
        ParameterError, match=r"focus.at: expected a pixel inside the picture of 8x6, got 8,0"
    ):
        disparity_at_pixel((8, 0), depth, window)
    with pytest.raises(ParameterError, match=r"focus.plane: expected a pixel that the file stores, got 0,0"):
        disparity_at_pixel((0, 0), depth, window, "focus.plane")


def test_disparity_is_inverse_distance_in_millimetres():
    assert disparity_of_distance(2) == 1 / 2000
    assert disparity_of_distance(math.inf) == 0
    for wrong in (0, -1, math.nan):
        with pytest.raises(ParameterError, match="metres above 0"):
            disparity_of_distance(wrong)


def test_a_focus_out_of_reach_is_reported_in_the_units_of_the_input():
    depth = metric(np.full((HEIGHT, WIDTH), 0.03))
    lens = focus_lens(depth, WINDOW, FocusSettings(at=(3, 3)), LENS)
    with pytest.raises(
        LensError, match=r"cannot focus at 0.03 m: expected more than 50 mm, the `camera.focal"
    ):
        lens.defocus(depth.values)


DISPARITY, DEPTH = InputSettings(disparity="a.png"), InputSettings(depth="a.exr")
BLUR, VALUE = CameraSettings(blur=3), FocusSettings(value=0.5)


@pytest.mark.parametrize(
    ("settings", "parameter", "words"),
    [
        (
            {"input": DISPARITY, "camera": BLUR, "focus": FocusSettings(distance=2)},
            "focus.distance",
            "does not apply to `input.disparity`",
        ),
        (
            {"input": DISPARITY, "camera": CameraSettings(blur=3, sensor_width=36), "focus": VALUE},
            "camera.sensor_width",
            "does not apply to `input.disparity`",
        ),
        (
            {"input": DISPARITY, "camera": CameraSettings(focal_length=50), "focus": VALUE},
            "camera.focal_length",
            "does not apply to `input.disparity` without `camera.f_number`",
        ),
        (
            {"input": DISPARITY, "camera": CameraSettings(strength=50, f_number=2), "focus": VALUE},
            "camera.f_number",
            "does not apply to `input.disparity` with `camera.strength`",
        ),
        (
            {"input": DEPTH, "camera": CameraSettings(strength=50, f_number=2)},
            "camera.f_number",
            "does not apply to `input.depth` with `camera.strength`",
        ),
        (
            {"input": DISPARITY, "camera": BLUR, "focus": FocusSettings(range=(0.5, 1.5))},
            "focus.range",
            "relative disparities in 0..1",
        ),
        (
            {
                "input": DISPARITY,
                "camera": BLUR,
                "focus": FocusSettings(plane=((1, 1), (2, 2), (3, 3))),
            },
            "focus.plane",
            "three pixels off one line",
        ),
        ({"input": DEPTH, "camera": BLUR}, "camera.blur", "does not apply to `input.depth`"),
        ({"input": DEPTH, "focus": VALUE}, "focus.value", "does not apply to `input.depth`"),
        ({"input": DEPTH, "focus": FocusSettings(range=(0, 2))}, "focus.range", "metres above 0, got 0"),
        (
            {"input": InputSettings(constant_disparity=0.5)},
            "camera.blur",
            "`input.constant_disparity` needs `camera.blur`, `camera.strength` or `camera.f_number`",
        ),
        ({"focus": VALUE}, "focus.value", "a photo's own depth (without `input.disparity`"),
        (
            {"camera": CameraSettings(blur=3, f_number=2)},
            "camera.f_number",
            "does not apply to `camera.blur`",
        ),
        ({"input": InputSettings(defocus="a.exr"), "focus": VALUE}, "focus.value", "already focused"),
        ({"input": InputSettings(defocus="a.exr"), "camera": BLUR}, "input.defocus", "are final"),
        (
            {"input": InputSettings(defocus="a.exr"), "focus": FocusSettings(tilt_x=5)},
            "input.defocus",
            "no tilt with it",
        ),
    ],
)
def test_contradictory_options_are_reported_before_anything_is_read(settings, parameter, words):
    with pytest.raises(ParameterError) as caught:
        check_focus(RenderSettings(**settings))
    assert caught.value.parameter == parameter
    assert words in str(caught.value)


def test_frames_accept_a_strength_whose_blur_is_the_same_in_all():
    strength = {"input": DISPARITY, "camera": CameraSettings(strength=30)}
    for focus in (VALUE, FocusSettings(range=(0.2, 0.4))):
        check_focus(RenderSettings(**strength, focus=focus), automatic=False)
    with pytest.raises(ParameterError, match="change from frame to frame") as caught:
        check_focus(RenderSettings(**strength, focus=FocusSettings(at=(1, 1))), automatic=False)
    assert caught.value.parameter == "camera.strength"


def test_frames_without_a_blur_are_told_all_ways_out():
    with pytest.raises(ParameterError, match=r"needs `camera.blur`, `camera.strength` or `camera.f_number`"):
        check_focus(RenderSettings(input=DISPARITY, focus=VALUE), automatic=False)


def test_frames_of_a_shot_need_a_focus():
    settings = RenderSettings(input=InputSettings(depth_model="a.onnx"), camera=BLUR)
    check_focus(settings)  # one picture: its subject
    with pytest.raises(ParameterError, match=r"one of `focus\.value`"):
        check_focus(settings, automatic=False)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"camera": BLUR},
        {"camera": CameraSettings(f_number=2)},
        {"input": DISPARITY, "camera": BLUR, "focus": VALUE},
        {"input": DEPTH},
        {"input": DEPTH, "focus": FocusSettings(range=(math.inf, 2)), "camera": LENS},
        {"input": InputSettings(defocus="a.exr")},
        {
            "input": InputSettings(depth_model="a.onnx", depth_convention="depth-anything-v2-metric"),
            "camera": LENS,
        },
        {"input": InputSettings(constant_disparity=0.5), "camera": BLUR, "focus": VALUE},
    ],
)
def test_what_a_file_can_complete_passes(settings):
    check_focus(RenderSettings(**settings))
