"""Checks of focus and camera settings against the kind of the depth source, before anything is read.

They import no kernels, so that the command line reports mistakes at once.
"""

from pathlib import Path

from bokehnet.errors import ErrorCollector, ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.scene.camera import merged_camera
from bokehnet.scene.depth.depth_source import ConstantDisparity, EmbeddedDepth, MetricDepth, depth_source
from bokehnet.scene.depth.explicit_depth import map_camera
from bokehnet.settings.error_names import errors_named_as
from bokehnet.settings.settings import CameraSettings, FocusSettings, RenderSettings

__all__ = [
    "check_focus",
    "check_frames_aperture",
    "check_kind",
    "check_nothing_to_focus",
    "check_pixels",
    "has_focus",
    "no_focus_error",
    "stored_pixel",
]

_RELATIVE = ("focus.value", "camera.blur")
_METRIC = ("focus.distance", "camera.sensor_width")

# Settings that take the place of those that do not apply.
_INSTEAD = {
    "focus.value": "set `focus.distance` or `focus.at`",
    "focus.distance": "set `focus.value` or `focus.at`",
    "camera.blur": "set `camera.f_number` or `camera.strength`",
}


def check_focus(settings: RenderSettings, *, automatic: bool = True) -> None:
    """Raise ``ParameterError`` unless focus and camera apply to the depth source; reads no file.

    Args:
        settings: Settings of the render.
        automatic: True if the subject of the picture may define the focus; False for frames of a shot, whose
            focus would jump.

    Examples:
        >>> from bokehnet.settings.settings import InputSettings
        >>> disparity, blur = InputSettings(disparity="disparity.png"), CameraSettings(blur=30)
        >>> check_focus(RenderSettings(input=disparity, camera=blur, focus=FocusSettings(value=0.4)))
        >>> check_focus(RenderSettings(input=disparity, camera=blur, focus=FocusSettings(distance=2)))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.distance: expected nothing: it does not apply to ...
    """
    source = depth_source(settings)
    if source.kind == "defocus":
        check_nothing_to_focus(settings)
        return
    metric, origin = source.kind == "metric", source.origin
    if metric and isinstance(source, EmbeddedDepth):
        origin += " (without `input.disparity`, `input.depth` and `camera.blur`)"
    if isinstance(source, EmbeddedDepth) and settings.camera.strength is not None:
        origin = "camera.strength"
    has_subject = automatic and not isinstance(source, ConstantDisparity)
    complete = not has_subject and not source.tells_focus
    errors = ErrorCollector()
    with errors.collect():
        check_kind(settings.focus, settings.camera, metric=metric, origin=origin, complete=complete)
    with errors.collect():
        if complete and not (automatic or metric):
            _check_strength_of_frames(settings)
    errors.raise_all()


def _check_strength_of_frames(settings: RenderSettings) -> None:
    """Raise ``ParameterError`` for a strength whose blur radius would follow the depth of a pixel."""
    expected = "`focus.value` or `focus.range` with it, or its blur would change from frame to frame"
    for name in ("at", "plane"):
        if settings.camera.strength is not None and getattr(settings.focus, name) is not None:
            raise ParameterError(
                "camera.strength",
                expected=expected,
                shown=f"`focus.{name}`",
                remedy="set one of them, or `camera.blur` in place of it",
            )


def check_frames_aperture(settings: RenderSettings, camera: Camera | None, *, own_depth: bool) -> None:
    """Raise ``ParameterError`` if each frame of a shot with metric depth would assume an f-number of its own.

    Args:
        settings: Settings of the first frame.
        camera: Camera in the file of its picture.
        own_depth: True if that file holds metric depth.

    Examples:
        >>> settings = RenderSettings(camera=CameraSettings(f_number=2))
        >>> check_frames_aperture(settings, None, own_depth=True)
    """
    source = depth_source(settings)
    if isinstance(source, MetricDepth):
        if isinstance(source.map, Path):
            camera = merged_camera(camera, map_camera(source.map))
    elif not (own_depth and isinstance(source, EmbeddedDepth) and not source.relative):
        return
    numbers = settings.camera
    if numbers.strength is not None or (
        numbers.f_number is None and (camera is None or camera.f_number is None)
    ):
        raise ParameterError(
            "camera.f_number",
            expected="one for all frames, as that of a strength would change from frame to frame",
            shown="none" if numbers.strength is None else "`camera.strength`",
        )


def check_pixels(focus: FocusSettings, window: Window, supersampled: int = 1) -> None:
    """Raise ``ParameterError`` unless the pixels of the focus lie inside the picture.

    Args:
        focus: Focus settings.
        window: Position of the picture's pixels in the shown picture.
        supersampled: Size of the window relative to the pixels of the settings.

    Examples:
        >>> check_pixels(FocusSettings(at=(2, 1)), Window.whole(3, 2))
        >>> check_pixels(FocusSettings(at=(3, 1)), Window.whole(3, 2))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.at: expected a pixel inside the picture of 3x2, got 3,1
    """
    size = window.display_width // supersampled, window.display_height // supersampled
    for pixel in (focus.at,) if focus.at is not None else focus.plane or ():
        name = "focus.plane" if focus.at is None else "focus.at"
        if supersampled == 1:
            stored_pixel(pixel, window, name)
        elif not (0 <= pixel[0] < size[0] and 0 <= pixel[1] < size[1]):
            raise _outside(pixel, size, name)


def stored_pixel(pixel: tuple[int, int], window: Window, name: str) -> tuple[int, int]:
    """Return column and row in the file of a pixel of the shown picture.

    Args:
        pixel: Column and row, from the upper left corner of the shown picture.
        window: Position of the picture's pixels in the shown picture.
        name: Setting that names the pixel, for the message.

    Raises:
        ParameterError: The file stores no such pixel.

    Examples:
        >>> from dataclasses import replace
        >>> cropped = replace(Window.whole(60, 40), x=10, y=5, width=40, height=30)
        >>> stored_pixel((12, 6), cropped, "focus.at")
        (2, 1)
    """
    x, y = pixel
    if not (0 <= x < window.display_width and 0 <= y < window.display_height):
        raise _outside(pixel, (window.display_width, window.display_height), name)
    column, row = x - window.x, y - window.y
    if not (0 <= column < window.width and 0 <= row < window.height):
        raise ParameterError(
            name, expected="a pixel that the file stores", shown=f"{x},{y}, outside its data window"
        )
    return column, row


def _outside(pixel: tuple[int, int], size: tuple[int, int], name: str) -> ParameterError:
    expected = f"a pixel inside the picture of {size[0]}x{size[1]}"
    return ParameterError(name, expected=expected, shown=f"{pixel[0]},{pixel[1]}")


def check_nothing_to_focus(settings: RenderSettings) -> None:
    """Raise ``ParameterError`` if the settings would focus a defocus map again.

    Examples:
        >>> check_nothing_to_focus(RenderSettings())
        >>> check_nothing_to_focus(RenderSettings(focus=FocusSettings(value=0.4)))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.value: expected nothing: `input.defocus` is already focused...
    """
    for name in ("value", "distance", "at", "range", "plane"):
        if getattr(settings.focus, name) is not None:
            raise ParameterError(
                f"focus.{name}", expected="nothing: `input.defocus` is already focused", remedy="leave it out"
            )
    if settings.focus.tilt_x or settings.focus.tilt_y or settings.camera != CameraSettings():
        raise ParameterError(
            "input.defocus",
            expected="no camera and no tilt with it: its blur radii are final",
            remedy="leave them out",
        )


def check_kind(
    focus: FocusSettings, camera: CameraSettings, *, metric: bool, origin: str, complete: bool = False
) -> None:
    """Raise ``ParameterError`` unless focus and camera apply to a map of this kind.

    Args:
        focus: Focus settings.
        camera: Camera settings.
        metric: True for metric depth, False for relative disparity.
        origin: Origin of the map for messages: a setting, or words.
        complete: True if the settings must contain the focus, as no file does.

    Examples:
        >>> focus, camera = FocusSettings(distance=2), CameraSettings(f_number=2)
        >>> check_kind(focus, camera, metric=True, origin="input.depth")
        >>> check_kind(focus, camera, metric=False, origin="input.disparity")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.distance: expected nothing: it does not apply to ...
    """
    holder = f"`{origin}`" if origin.partition(".")[2].isidentifier() else origin
    errors = ErrorCollector()
    unusable = dict.fromkeys(_RELATIVE if metric else _METRIC, "")
    if not metric and camera.f_number is None:
        unusable["camera.focal_length"] = " without `camera.f_number`"
    if metric and camera.strength is not None:
        unusable["camera.f_number"] = " with `camera.strength`"
    if not metric and (
        other := next((n for n in ("blur", "strength") if getattr(camera, n) is not None), "")
    ):
        unusable["camera.f_number"] = "" if origin == f"camera.{other}" else f" with `camera.{other}`"
    for path, why in unusable.items():
        group, _, name = path.partition(".")
        value = getattr(focus if group == "focus" else camera, name)
        with errors.collect():
            if value is not None:
                expected = f"nothing: it does not apply to {holder}{why}"
                remedy = _INSTEAD.get(path, "leave it out")
                raise ParameterError(path, expected=expected, got=value, remedy=remedy)
    with errors.collect():
        no_blur = (camera.blur, camera.f_number, camera.strength) == (None,) * 3
        if complete and not metric and no_blur:
            expected = f"{holder} needs `camera.blur`, `camera.strength` or `camera.f_number`"
            raise ParameterError("camera.blur", f"pixels per unit of disparity: {expected}", shown="none")
    with errors.collect():
        if complete and not has_focus(focus, metric):
            raise no_focus_error(metric)
    with errors.collect():
        if not metric and isinstance(focus.range, tuple) and max(focus.range) > 1:
            raise ParameterError("focus.range", expected="relative disparities in 0..1", got=focus.range)
        if metric and isinstance(focus.range, tuple) and not min(focus.range) > 0:
            raise ParameterError("focus.range", expected="metres above 0", got=min(focus.range))
    with errors.collect(), errors_named_as("focus", {"pixels": "plane"}):
        if focus.plane is not None:
            from bokehnet.optics.focus_plane import FocusPlane  # imports numba, 0.2 s

            FocusPlane.through(focus.plane, (0, 0, 0))
    errors.raise_all()


def no_focus_error(metric: bool, why: str = "") -> ParameterError:
    """Return the error of a missing focus.

    Args:
        metric: True for metric depth, False for relative disparity.
        why: Text after the words "got none".

    Examples:
        >>> print(no_focus_error(metric=True))
        focus.distance: expected one of `focus.distance`, `focus.at`, `focus.range` and `focus.plane`,
        got none
    """
    *first, last = (f"`focus.{name}`" for name in _focus_fields(metric))
    return ParameterError(
        f"focus.{_focus_fields(metric)[0]}",
        expected=f"one of {', '.join(first)} and {last}",
        shown=f"none{why}",
    )


def _focus_fields(metric: bool) -> tuple[str, ...]:
    """Return the settings that can define the focus."""
    return ("distance" if metric else "value", "at", "range", "plane")


def has_focus(focus: FocusSettings, metric: bool) -> bool:
    """Return whether settings define the focus; ``focus.range`` "off" only shapes an automatic one.

    Args:
        focus: Focus settings.
        metric: True for metric depth, False for relative disparity.

    Examples:
        >>> has_focus(FocusSettings(at=(2, 1)), metric=True), has_focus(FocusSettings(range="off"), True)
        (True, False)
    """
    return any(getattr(focus, name) not in (None, "off") for name in _focus_fields(metric))
