"""Blur strength where the settings have none, or a strength or an f-number in place of a blur radius.

A relative map has no unit, so its blur radius per unit of disparity follows from an assumption: a fraction of
the picture's size, or a full-frame camera at an assumed distance.
"""

import math
from dataclasses import replace

import numpy as np

from bokehnet.io.window import Window
from bokehnet.lenses import ThinLens
from bokehnet.scene.camera import complete_camera, full_frame_camera, has_view
from bokehnet.scene.depth.depth_source import DepthMap
from bokehnet.settings.settings import CameraSettings

__all__ = ["DEFAULT_STRENGTH", "completed_blur", "equivalent_f_number"]

# Strength without any setting, and the largest blur radius at strength 100, relative to the longer side.
DEFAULT_STRENGTH, _FULL_RADIUS = 50.0, 0.08

# Full-frame focal length for a relative map of a picture without one, mm: a normal lens.
_NORMAL_FOCAL_LENGTH = 50.0

# Assumed distance of disparity 1, mm, and at least in focal lengths; disparity 0 is at infinity.
_NEAREST_DISTANCE, _NEAREST_FOCAL_LENGTHS = 1000.0, 20.0

# Percentiles of a metric map that count as its ends.
_END_PERCENTILES = (2, 98)


def completed_blur(
    camera: CameraSettings, depth: DepthMap, near: float, far: float, window: Window
) -> tuple[CameraSettings, tuple[str, ...]]:
    """Return camera settings that define the blur, and the assumptions behind them.

    A strength S, by default 50, makes the larger of the two blur radii at the farthest and the nearest point,
    of metric depth at its 2nd and 98th percentile, S/100 of 8 % of the longer side, i.e. 4 %. An f-number of
    a relative map is that of a full-frame camera with the nearest point at 1 m, or 20 focal lengths if that
    is farther, and the farthest at infinity. Metric depth without a view gets a 50 mm lens on full frame,
    without an f-number that of the strength.

    Args:
        camera: Camera settings.
        depth: Depth map of the scene.
        near: Largest disparity in focus, in the unit of the map.
        far: Smallest disparity in focus.
        window: Position of the map's pixels in the shown picture.

    Examples:
        >>> depth = DepthMap(values=np.eye(2, dtype=np.float32), kind="relative", origin="input.disparity")
        >>> completed_blur(CameraSettings(), depth, 0.8, 0.8, Window.whole(1000, 500))[0].blur  # 40 px / 0.8
        50.0
        >>> settings, notes = completed_blur(
        ...     CameraSettings(f_number=2), depth, 0.5, 0.5, Window.whole(1000, 500))
        >>> round(settings.blur, 1), notes[0]
        (16.6, 'f/2 as on full frame at 50 mm, nearest point at 1 m, focus at 2 m')
    """
    if depth.kind == "metric":
        return _completed_aperture(camera, depth, near, far, window)
    if camera.blur is not None:
        return camera, ()
    if camera.f_number is not None:
        return _equivalent_blur(camera, depth, near, window)
    longer_side = max(window.display_width, window.display_height)
    strength = DEFAULT_STRENGTH if camera.strength is None else camera.strength
    radius = strength / 100 * _FULL_RADIUS * longer_side
    blur = radius / max(far, 1 - near, 0.5)
    return replace(camera, blur=blur, strength=None), (() if camera.strength is not None else _DEFAULT_NOTE)


def equivalent_f_number(
    blur: float, camera: CameraSettings, depth: DepthMap, near: float, window: Window
) -> float:
    """Return the full-frame f-number whose blur of a relative map equals a blur radius; inverse of its blur.

    Args:
        blur: Blur radius per unit of disparity, pixels, above 0.
        camera: Camera settings, whose focal length counts.
        depth: Relative depth map of the scene.
        near: Largest disparity in focus.
        window: Position of the map's pixels in the shown picture.

    Examples:
        >>> depth = DepthMap(values=np.eye(2, dtype=np.float32), kind="relative", origin="input.disparity")
        >>> window = Window.whole(1000, 500)
        >>> blur = completed_blur(CameraSettings(f_number=2), depth, 0.5, 0.5, window)[0].blur
        >>> round(equivalent_f_number(blur, CameraSettings(), depth, 0.5, window), 6)
        2.0
    """
    unit = replace(camera, blur=None, strength=None, f_number=1.0)  # the blur is inverse to the f-number
    full = _equivalent_blur(unit, depth, near, window)[0].blur
    assert full is not None
    return full / blur


_DEFAULT_NOTE = (
    f"blur up to {_FULL_RADIUS * DEFAULT_STRENGTH:.0f} % of the longer side "
    f"(`camera.strength` {DEFAULT_STRENGTH:.0f})",
)


def _equivalent_blur(
    camera: CameraSettings, depth: DepthMap, near: float, window: Window
) -> tuple[CameraSettings, tuple[str, ...]]:
    """Return the blur of a full-frame camera at the f-number of the settings."""
    film = full_frame_camera(depth.camera, window.display_width, window.display_height)
    assert camera.f_number is not None
    assert film.sensor_width is not None
    in_file = has_view(depth.camera)
    length = camera.focal_length or (film.focal_length if in_file else None) or _NORMAL_FOCAL_LENGTH
    nearest = max(_NEAREST_DISTANCE, _NEAREST_FOCAL_LENGTHS * length)
    distance = nearest / near if near > 0 else math.inf
    lens = ThinLens(focal_length=length, f_number=camera.f_number, focus_distance=distance)
    radii = np.asarray(lens.coc_radius(np.array([[0.0, 1 / nearest]])))[0]  # mm, linear in disparity
    blur = float(radii[1] - radii[0]) * window.display_width / film.sensor_width
    focus = "infinity" if math.isinf(distance) else f"{_two_digits(distance / 1000)} m"
    note = (
        f"f/{camera.f_number:g} as on full frame at {length:.3g} mm, "
        f"nearest point at {_two_digits(nearest / 1000)} m, focus at {focus}"
    )
    return replace(camera, blur=blur, f_number=None, focal_length=None), (note,)


def _completed_aperture(
    camera: CameraSettings, depth: DepthMap, near: float, far: float, window: Window
) -> tuple[CameraSettings, tuple[str, ...]]:
    """Return the settings with a full-frame view and the f-number of a strength where files have none."""
    camera, notes = _completed_view(camera, depth, window)
    in_file = None if depth.camera is None else depth.camera.f_number
    if camera.strength is None and (camera.f_number is not None or in_file is not None):
        return camera, notes
    strength = DEFAULT_STRENGTH if camera.strength is None else camera.strength
    numbers = complete_camera(replace(camera, f_number=1.0), depth.camera, depth.origin)
    low, high = np.percentile(depth.values, _END_PERCENTILES)
    lens = ThinLens(focal_length=numbers.focal_length, f_number=1.0, focus_distance=_distance(far))
    at_far = abs(float(np.asarray(lens.coc_radius(np.array([[min(low, far)]])))[0, 0]))
    lens = ThinLens(focal_length=numbers.focal_length, f_number=1.0, focus_distance=_distance(near))
    at_near = abs(float(np.asarray(lens.coc_radius(np.array([[max(high, near)]])))[0, 0]))
    pixels = max(at_far, at_near) * window.display_width / numbers.sensor_width
    longer_side = max(window.display_width, window.display_height)
    radius = max(strength / 100 * _FULL_RADIUS, _MIN_RADIUS) * longer_side
    f_number = max(pixels / radius, _MIN_F_NUMBER)
    percentage = _two_digits(100 * radius / longer_side)
    note = f"f/{_two_digits(f_number)} for a blur of about {percentage} % of the longer side"
    if camera.strength is None:
        note += ", as the file has no f-number"
        if f_number < _FASTEST_LENS:
            note += " (no lens has it; `camera.f_number` sets another)"
    return replace(camera, f_number=f_number, strength=None), (*notes, note)


def _completed_view(
    camera: CameraSettings, depth: DepthMap, window: Window
) -> tuple[CameraSettings, tuple[str, ...]]:
    """Return the settings with the sensor and the normal lens of full frame where files have neither."""
    film = full_frame_camera(None, window.display_width, window.display_height)
    sensor = camera.sensor_width or getattr(depth.camera, "sensor_width", None)
    length = camera.focal_length or getattr(depth.camera, "focal_length", None)
    if sensor is not None and length is not None:
        return camera, ()
    assert film.sensor_width is not None
    width = sensor or film.sensor_width
    length = length or _NORMAL_FOCAL_LENGTH * width / film.sensor_width
    on = "full frame" if sensor is None else f"a sensor {sensor:.3g} mm wide"
    return replace(camera, focal_length=length, sensor_width=width), (f"{length:.3g} mm on {on}",)


# Smallest radius of a strength, relative to the longer side: strength 0 has no finite f-number.
_MIN_RADIUS = 1e-5

# Smallest f-number of a lens in air.
_FASTEST_LENS = 0.5

# Largest aperture that is assumed; a flat scene needs an infinite one for any blur.
_MIN_F_NUMBER = 0.1


def _two_digits(value: float) -> str:
    """Return a number with two significant digits, without an exponent below a million."""
    return f"{float(f'{value:.2g}'):g}"


def _distance(disparity: float) -> float:
    """Return a distance in mm; infinity for disparity 0."""
    return 1 / disparity if disparity > 0 else math.inf
