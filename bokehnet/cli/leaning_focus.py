"""A plane of focus that leans over the picture of a scene, from options and the scene's map."""

from typing import TYPE_CHECKING

from bokehnet.cli.naming import named_options
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    from bokehnet.cli.focus import Focus
    from bokehnet.cli.scene_map import SceneMap
    from bokehnet.optics.focus_plane import FocusPlane

__all__ = ["check_lean", "leaning_focus", "value_at"]

_OPTIONS = {
    "tilt_x": "--tilt-x",
    "tilt_y": "--tilt-y",
    "focus plane": "--focus-plane",
    "pixels": "--focus-plane",
}


def check_lean(focus: "Focus") -> None:
    """Raise ``ParameterError`` unless tilt, or the three pixels, can be those of a plane."""
    from bokehnet.optics.focus_plane import FocusPlane, check_tilt

    with named_options(_OPTIONS):
        check_tilt(focus.tilt)
        if focus.focus_plane is not None:
            if any(focus.tilt):
                raise ParameterError(
                    "focus plane: expected three pixels, or --tilt-x and --tilt-y, found both"
                )
            FocusPlane.through(focus.focus_plane, (0, 0, 0))


def leaning_focus(focus: "Focus", scene: "SceneMap", disparity: float) -> "tuple[FocusPlane, float]":
    """Return the plane in focus, in the unit of the map, and the blur in pixels per unit of it.

    Args:
        focus: Complete numbers, of which some lean the plane.
        scene: What is seen.
        disparity: In focus at the pixel of ``--focus-at``, else in the middle; three pixels need none.

    Raises:
        ParameterError: A pixel lies outside.
        LensError: The lens cannot focus there.
    """
    from bokehnet.lenses import ThinLens
    from bokehnet.optics.focus_plane import FocusPlane, distance_to_sensor, relative_plane, tilted_lens

    window = scene.window
    size = window.display_width, window.display_height
    middle = (size[0] - 1) / 2, (size[1] - 1) / 2
    picked = None
    if focus.focus_plane is not None:
        values = [value_at(pixel, scene, "--focus-plane") for pixel in focus.focus_plane]
        picked = FocusPlane.through(focus.focus_plane, values)
    pixel = middle if focus.focus_at is None else focus.focus_at
    if not scene.metric:
        assert focus.blur is not None
        return picked or relative_plane(focus.tilt, pixel, disparity, size), focus.blur
    assert focus.focal_length is not None
    assert focus.f_number is not None
    assert focus.sensor_width is not None
    lens = ThinLens(focal_length=focus.focal_length, f_number=focus.f_number)
    pitch = focus.sensor_width / window.display_width
    if picked is not None:
        plane = picked
        distance = distance_to_sensor(plane, focal_length=lens.focal_length, pixel_pitch=pitch, centre=middle)
    else:
        plane, distance = tilted_lens(
            focus.tilt,
            pixel,
            disparity,
            focal_length=lens.focal_length,
            pixel_pitch=pitch,
            centre=middle,
        )
    return plane, lens.pupil_radius * distance / pitch


def value_at(pixel: tuple[int, int], scene: "SceneMap", option: str) -> float:
    """Value of the map at a pixel of the shown picture; ``ParameterError`` names ``option``."""
    (x, y), window = pixel, scene.window
    if not (0 <= x < window.display_width and 0 <= y < window.display_height):
        size = f"{window.display_width}x{window.display_height}"
        raise ParameterError(f"{option}: expected a pixel inside the picture of {size}, got {x},{y}")
    column, row = x - window.x, y - window.y
    height, width = scene.disparity.shape
    if not (0 <= column < width and 0 <= row < height):
        raise ParameterError(f"{option}: the file stores nothing at {x},{y}, outside its data window")
    return float(scene.disparity[row, column])
