"""Blur strength without a blur radius. Authority: the formula of a thin lens, by hand."""

import math

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.scene.blur_strength import completed_blur
from bokehnet.scene.depth.depth_map import DepthMap
from bokehnet.scene.focus import focus_lens
from bokehnet.scene.focus_checks import check_frames_aperture
from bokehnet.settings.settings import CameraSettings, FocusSettings, RenderSettings

WINDOW = Window.whole(900, 600)
RAMP = np.tile(np.linspace(0, 1, 9, dtype=np.float32), (6, 1))


def relative(camera=None):
    return DepthMap(values=RAMP, kind="relative", origin="input.disparity", camera=camera)


def radii(depth, camera, focus=None, window=WINDOW):
    lens = focus_lens(depth, window, focus or FocusSettings(value=0.75), camera)
    return lens, lens.defocus(depth.values)


@pytest.mark.parametrize("focus", [0.0, 0.3, 0.5, 0.9, 1.0])
def test_the_default_blurs_the_farther_end_by_four_percent_of_the_longer_side(focus):
    lens, defocus = radii(relative(), CameraSettings(), FocusSettings(value=focus))
    assert np.abs(defocus).max() == pytest.approx(0.04 * 900)
    assert lens.assumptions == ("blur up to 4 % of the longer side (`camera.strength` 50)",)


def test_a_portrait_format_uses_its_height():
    assert np.abs(radii(relative(), CameraSettings(), window=Window.whole(600, 900))[1]).max() == 36


@pytest.mark.parametrize("strength", [0, 10, 100])
def test_strength_is_a_percentage_of_eight_percent_and_no_assumption(strength):
    lens, defocus = radii(relative(), CameraSettings(strength=strength))
    assert np.abs(defocus).max() == pytest.approx(strength / 100 * 0.08 * 900)
    assert lens.assumptions == ()


def test_a_blur_radius_stays():
    assert completed_blur(CameraSettings(blur=7), relative(), 0.5, 0.5, WINDOW) == (
        CameraSettings(blur=7),
        (),
    )


def test_an_f_number_is_that_of_a_full_frame_camera():
    """Radius f^2 |1/s - 1/d| s / (2 N (s - f)) on 36 x 24 mm; here s is 1 m / 0.75, d 1 m / disparity."""
    lens, defocus = radii(relative(), CameraSettings(f_number=1.4))
    length, subject = 50, 1000 / 0.75
    factor = length**2 * subject / (2 * 1.4 * (subject - length)) / (36 / 900)
    np.testing.assert_allclose(defocus, factor * (RAMP - 0.75) / 1000, rtol=1e-4, atol=1e-4)
    assert lens.assumptions == ("f/1.4 as on full frame at 50 mm, nearest point at 1 m, focus at 1.3 m",)


def test_the_focal_length_comes_from_options_then_from_the_file():
    phone = Camera(focal_length=4, sensor_width=4.8)  # 30 mm on 36 mm
    assert " at 30 mm" in radii(relative(phone), CameraSettings(f_number=2))[0].assumptions[0]
    lens, _ = radii(relative(phone), CameraSettings(f_number=2, focal_length=200))
    assert " at 200 mm, nearest point at 4 m" in lens.assumptions[0]


def test_a_range_in_focus_leaves_its_longer_side_of_four_percent():
    defocus = radii(relative(), CameraSettings(), FocusSettings(range=(0.5, 0.75)))[1]
    assert np.abs(defocus).max() == pytest.approx(0.04 * 900)
    assert not defocus[:, 4:7].any()


def photo(camera):
    metres = np.tile(np.linspace(1, 4, 9, dtype=np.float32), (6, 1))
    return DepthMap(
        values=0.001 / metres,
        kind="metric",
        origin="the photo's own depth",
        fits_any_size=True,
        camera=camera,
        focus=0.001,
    )


def test_a_photo_without_an_f_number_gets_one_of_that_strength():
    film = Camera(focal_length=26, sensor_width=36)
    lens, defocus = radii(photo(film), CameraSettings(), FocusSettings())
    assert np.abs(defocus).max() == pytest.approx(0.04 * 900, rel=0.1)  # ends are percentiles
    assert lens.assumptions[0].startswith("f/0.")
    stated = Camera(focal_length=26, sensor_width=36, f_number=1.8)
    assert radii(photo(stated), CameraSettings(), FocusSettings())[0].assumptions == ()


def depth_file():
    metres = np.tile(np.linspace(1, 4, 9, dtype=np.float32), (6, 1))
    return DepthMap(values=0.001 / metres, kind="metric", origin="input.depth")


def test_depth_without_a_camera_gets_a_normal_lens_on_full_frame():
    """Authority: 50 mm on a diagonal of 43.27 mm, and 4 % of the longer side; both are stated."""
    lens, defocus = radii(depth_file(), CameraSettings(), FocusSettings(distance=1))
    assert np.abs(defocus).max() == pytest.approx(0.04 * 900, rel=0.1)
    assert lens.assumptions[0] == "50 mm on full frame"
    assert "the file has no f-number" in lens.assumptions[1]
    assert lens.camera.focal_length == 50
    assert lens.camera.sensor_width == pytest.approx(math.hypot(36, 24) * 900 / math.hypot(900, 600))


def test_a_known_part_of_the_view_is_kept():
    lens = radii(depth_file(), CameraSettings(f_number=2, sensor_width=18), FocusSettings(distance=1))[0]
    assert (lens.camera.f_number, lens.camera.sensor_width) == (2, 18)
    assert lens.camera.focal_length == pytest.approx(25, rel=1e-3)  # the same view
    assert lens.assumptions == ("25 mm on a sensor 18 mm wide",)
    lens = radii(depth_file(), CameraSettings(f_number=2, focal_length=35), FocusSettings(distance=1))[0]
    assert lens.assumptions == ("35 mm on full frame",)


def test_a_strength_of_metric_depth_is_its_fraction_of_the_longer_side():
    defocus = radii(depth_file(), CameraSettings(strength=100), FocusSettings(distance=1))[1]
    assert np.abs(defocus).max() == pytest.approx(0.08 * 900, rel=0.1)
    assert not radii(depth_file(), CameraSettings(strength=0), FocusSettings(distance=1))[1].round(1).any()
    with pytest.raises(ParameterError, match="f_number"):
        radii(depth_file(), CameraSettings(strength=50, f_number=2), FocusSettings(distance=1))


def test_single_points_of_metric_depth_blur_more_than_the_strength():
    """Authority: the radius holds at the 98th percentile; the map's ends may be errors of a sensor."""
    metres = np.tile(np.linspace(1, 4, 900, dtype=np.float32), (6, 1))
    depth = DepthMap(values=0.001 / metres, kind="metric", origin="input.depth")
    lens, defocus = radii(depth, CameraSettings(), FocusSettings(distance=4))
    assert np.percentile(np.abs(defocus), 98) == pytest.approx(36, rel=1e-3)
    assert np.abs(defocus).max() > 37
    assert "for a blur of about 4 % of the longer side" in lens.assumptions[1]


def test_frames_share_one_f_number():
    settings = RenderSettings(focus=FocusSettings(distance=1))
    for changed in (settings, settings.updated({"camera": {"strength": 30}, "input": {"depth": "z.npy"}})):
        with pytest.raises(ParameterError, match="one for all frames"):
            check_frames_aperture(changed, None, own_depth=True)
    check_frames_aperture(settings, Camera(f_number=2), own_depth=True)
    check_frames_aperture(settings, None, own_depth=False)


def test_focus_at_infinity_is_allowed_with_an_f_number():
    lens, defocus = radii(relative(), CameraSettings(f_number=2), FocusSettings(value=0))
    assert "focus at infinity" in lens.assumptions[0]
    assert math.isclose(float(defocus.max()), 50**2 / (2 * 2) / 1000 / (36 / 900), rel_tol=1e-4)
