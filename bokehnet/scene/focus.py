"""Focus and blur strength: conversion of settings and the depth map of a scene to defocus.

The signed blur radius of a lens is linear in disparity. Any focus (a value, a distance, a pixel, a range, a
tilted plane, the subject) thus becomes a disparity, or a plane of disparities, and a factor.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.row_blocks import cut_row_blocks
from bokehnet.checks import check_rank
from bokehnet.errors import LensError, ParameterError
from bokehnet.io.window import Window
from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.coc import defocus_from_disparity, defocus_outside_range
from bokehnet.optics.focus_plane import (
    FocusPlane,
    distance_to_sensor,
    plane_aberration_map,
    plane_defocus,
    relative_plane,
    tilted_aberration_map,
    tilted_lens,
)
from bokehnet.scene.blur_strength import completed_blur
from bokehnet.scene.camera import LensNumbers, complete_camera
from bokehnet.scene.depth.depth_source import (
    DepthMap,
)
from bokehnet.scene.focus_checks import check_kind, check_pixels, has_focus, no_focus_error, stored_pixel
from bokehnet.scene.focus_patch import surface_disparity
from bokehnet.scene.subject import Subject
from bokehnet.settings.settings import CameraSettings, FocusSettings

__all__ = [
    "FocusedLens",
    "check_lens",
    "disparity_at_pixel",
    "disparity_of_distance",
    "focus_lens",
    "is_automatic",
]

Array = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusedLens:
    """Lens with its focus.

    Attributes:
        near: Largest disparity in focus, in the unit of the map.
        far: Smallest disparity in focus; everything between both is sharp.
        blur: Blur radius in pixels per unit of relative disparity; None for metric depth.
        camera: Camera; None for relative disparity.
        plane: Function from the disparity at the pivot to the plane in focus and the blur in pixels per
            does not tilt.
        window: Position of the map's pixels in the shown picture.
        tilt_gradient: Signed blur radius per pixel from the middle of the picture, to the right and down,
            that a misaligned copy of a lens adds; see :mod:`bokehnet.lenses.assembly.misalignment`.
        subject: Subject that an automatic focus chose; None for a focus of the settings or the file.
        assumptions: Assumed values that the blur depends on, a few words each.

    Examples:
        >>> camera = LensNumbers(focal_length=50, f_number=2, sensor_width=36)
        >>> window = Window.whole(3600, 2400)
        >>> lens = FocusedLens(near=0.0005, far=0.0005, blur=None, camera=camera, plane=None, window=window)
        >>> lens.distance, round(float(lens.defocus(np.zeros((1, 1), np.float32))[0, 0]), 1)  # m, pixels
        (2.0, -32.1)
    """

    near: float
    far: float
    blur: float | None
    camera: LensNumbers | None
    plane: Callable[[float], tuple[FocusPlane, float]] | None
    window: Window
    tilt_gradient: tuple[float, float] = (0.0, 0.0)
    subject: Subject | None = None
    assumptions: tuple[str, ...] = ()

    @property
    def distance(self) -> float | None:
        """Distance in focus, metres; the near end of a range; None for relative disparity."""
        return self._distance(self.near)

    @property
    def far_distance(self) -> float | None:
        """Distance of the far end of a range in focus, metres; None for relative disparity."""
        return self._distance(self.far)

    def _distance(self, disparity: float) -> float | None:
        if self.camera is None:
            return None
        return 1 / (1000 * disparity) if disparity > 0 else math.inf

    def defocus(self, disparity: Array) -> Array:
        """Return the signed blur radius of each pixel, (H, W), pixels, positive in front of focus.

        Args:
            disparity: Disparity of each pixel, (H, W), in the unit of the focus.

        Raises:
            LensError: The lens cannot focus there.
        """
        is_float_map = (
            isinstance(disparity, np.ndarray) and disparity.dtype.kind == "f" and disparity.ndim == 2
        )
        if not is_float_map or self.plane is not None or any(self.tilt_gradient):
            return self._outside_range(disparity)
        result = np.empty_like(disparity)
        for rows in cut_row_blocks(disparity.shape):  # alike everywhere: no copies of the whole map
            result[rows] = self._outside_range(disparity[rows])
        return result

    def aberration_map(self) -> AberrationMap | None:
        """Return the effect of a tilted plane of focus on the rays; None without tilt."""
        tilted = self._plane_aberrations()
        if not any(self.tilt_gradient):
            return tilted
        misaligned = plane_aberration_map(self._misalignment_plane, 1.0)
        return misaligned if tilted is None else tilted + misaligned

    @property
    def _misalignment_plane(self) -> FocusPlane:
        """Plane of focus of a misaligned copy of a lens, in pixels of blur."""
        return FocusPlane.around(_middle(self.window), 0.0, (-self.tilt_gradient[0], -self.tilt_gradient[1]))

    def _plane_aberrations(self) -> AberrationMap | None:
        if self.plane is None:
            return None
        plane, blur = self.plane(self.near)
        if self.camera is None:
            return plane_aberration_map(plane, blur)
        pitch = self.camera.sensor_width / self.window.display_width
        lens = _thin_lens(self.camera, 0.0)
        return tilted_aberration_map(
            plane,
            blur,
            focal_length=lens.focal_length,
            pixel_pitch=pitch,
            distance=blur * pitch / lens.pupil_radius,
            size=(self.window.display_width, self.window.display_height),
        )

    def _outside_range(self, disparity: Array) -> Array:
        """Return the defocus of all rows of a picture, or of any if it does not depend on the place."""
        near = self._focused(disparity, self.near)
        if self.near == self.far:
            return near
        defocus: Array = defocus_outside_range(near, self._focused(disparity, self.far))
        return defocus

    def _focused(self, disparity: Array, focus: float) -> Array:
        """Return the defocus with the focus at one disparity."""
        defocus: Array
        with np.errstate(over="ignore"):  # the renderer checks for blur beyond float32
            if self.plane is not None:
                plane, blur = self.plane(focus)
                defocus = plane_defocus(disparity, blur, plane, (self.window.x, self.window.y))
            elif self.camera is None:
                assert self.blur is not None
                defocus = defocus_from_disparity(disparity, self.blur, focus)
            else:
                pitch = self.camera.sensor_width / self.window.display_width
                defocus = defocus_map(disparity, _thin_lens(self.camera, focus), pitch)
                if self.window.pixel_aspect > 1:  # the longer axis of the disc, here down, has the radius
                    defocus = defocus * np.float32(self.window.pixel_aspect)
            if any(self.tilt_gradient):
                corner = (self.window.x, self.window.y)
                plane = self._misalignment_plane
                defocus = defocus + plane_defocus(np.zeros_like(disparity), 1.0, plane, corner)
        return defocus


def focus_lens(
    depth: DepthMap,
    window: Window,
    focus: FocusSettings,
    camera: CameraSettings,
    image: Array | None = None,
    subject: Subject | None = None,
) -> FocusedLens:
    """Return the lens of a scene with its focus and blur strength.

    Args:
        depth: Depth map of the scene in the size of its picture, relative or metric.
        window: Position of its pixels in the shown picture.
        focus: Focus settings.
        camera: Camera settings.
        image: Scene-linear picture, (H, W, 3), whose colours separate the surfaces under pixels in focus.
        subject: Subject to focus on if neither settings nor file define the focus; see :func:`is_automatic`.

    Raises:
        ParameterError: A setting is missing or does not apply to such a map, or a pixel lies outside.
        LensError: The lens cannot focus there.

    Examples:
        >>> import numpy as np
        >>> values = np.full((2, 3), 0.75, np.float32)
        >>> depth = DepthMap(values=values, kind="relative", origin="input.disparity")
        >>> lens = focus_lens(depth, Window.whole(3, 2), FocusSettings(value=0.5), CameraSettings(blur=8))
        >>> float(lens.defocus(depth.values)[0, 0])  # pixels
        2.0
    """
    metric = depth.kind == "metric"
    check_lens(depth, window, focus, camera)
    if subject is not None and (focus.tilt_x or focus.tilt_y):
        x, y = subject.position
        focus = replace(focus, range=None, at=(x + window.x, y + window.y))
    if isinstance(focus.range, tuple):
        ends = [disparity_of_distance(end) if metric else end for end in focus.range]
        near, far = max(ends), min(ends)
    elif subject is None or focus.at is not None:
        near = far = _focus_disparity(depth, window, focus, image)
    elif focus.range == "off":
        near = far = subject.disparity
    else:
        near, far = subject.near, subject.far
    camera, assumptions = completed_blur(camera, depth, near, far, window)
    numbers = complete_camera(camera, depth.camera, depth.origin) if metric else None
    return FocusedLens(
        near=near,
        far=far,
        blur=None if metric else camera.blur,
        camera=numbers,
        plane=_tilted_plane(depth, window, focus, camera, numbers, image),
        window=window,
        subject=subject,
        assumptions=(*depth.assumptions, *assumptions),
    )


def check_lens(depth: DepthMap, window: Window, focus: FocusSettings, camera: CameraSettings) -> None:
    """Raise ``ParameterError`` unless :func:`focus_lens` can focus the map; takes no time.

    Args:
        depth: Depth map of the scene, of any size.
        window: Position of the picture's pixels in the shown picture.
        focus: Focus settings.
        camera: Camera settings.

    Examples:
        >>> depth = DepthMap(values=np.ones((2, 3), np.float32), kind="relative", origin="input.disparity")
        >>> check_lens(depth, Window.whole(3, 2), FocusSettings(at=(3, 0)), CameraSettings(blur=8))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.at: expected a pixel inside the picture of 3x2, got 3,0
    """
    metric = depth.kind == "metric"
    check_kind(focus, camera, metric=metric, origin=depth.origin)
    check_pixels(focus, window)


def disparity_at_pixel(
    pixel: tuple[int, int],
    depth: DepthMap,
    window: Window,
    name: str = "focus.at",
    image: Array | None = None,
) -> float:
    """Return the disparity of the surface under a pixel of the shown picture.

    See :func:`bokehnet.scene.focus_patch.surface_disparity`.

    Args:
        pixel: Column and row, from the upper left corner.
        depth: Depth map in the size of the picture.
        window: Position of its pixels in the shown picture.
        name: Setting that names the pixel, for the message.
        image: Scene-linear picture, (H, W, 3), whose colours separate surfaces; None uses the map alone.

    Raises:
        ParameterError: The file stores no such pixel.

    Examples:
        >>> values = np.array([[0, 0.25, 1]], np.float32)
        >>> depth = DepthMap(values=values, kind="relative", origin="input.disparity")
        >>> disparity_at_pixel((1, 0), depth, Window.whole(3, 1))
        0.25
    """
    column, row = stored_pixel(pixel, window, name)
    return surface_disparity(depth.values, column, row, image)


def disparity_of_distance(metres: float) -> float:
    """Return the disparity, 1/mm, of a distance in metres; infinity is 0.

    Examples:
        >>> disparity_of_distance(2), disparity_of_distance(math.inf)  # 1/mm
        (0.0005, 0.0)
    """
    if not metres > 0:
        raise ParameterError("focus.distance", expected="metres above 0", got=metres)
    return 1 / (1000 * metres)


def is_automatic(focus: FocusSettings, depth: DepthMap) -> bool:
    """Return whether neither settings nor file define the focus, so that it falls on the subject.

    Examples:
        >>> depth = DepthMap(values=np.zeros((2, 3), np.float32), kind="relative", origin="input.disparity")
        >>> is_automatic(FocusSettings(), depth), is_automatic(FocusSettings(value=0.5), depth)
        (True, False)
    """
    metric = depth.kind == "metric"
    in_file = depth.focus is not None
    if metric and depth.camera is not None:
        in_file = in_file or depth.camera.focus_distance is not None
    return not in_file and not has_focus(focus, metric)


def _focus_disparity(
    depth: DepthMap,
    window: Window,
    focus: FocusSettings,
    image: Array | None,
) -> float:
    """Return the disparity in focus; of a tilted plane, at its pivot or in the middle."""
    if focus.plane is not None:
        return float(_picked_plane(focus.plane, depth, window, image).at(*_middle(window)))
    if focus.at is not None:
        return disparity_at_pixel(focus.at, depth, window, image=image)
    if focus.value is not None:
        return focus.value
    if focus.distance is not None:
        return disparity_of_distance(focus.distance)
    if depth.kind == "metric" and depth.camera is not None and depth.camera.focus_distance is not None:
        return disparity_of_distance(depth.camera.focus_distance / 1000)
    if depth.focus is not None:
        return depth.focus
    raise no_focus_error(depth.kind == "metric", "; the picture's file contains no focus")


def _picked_plane(
    pixels: tuple[tuple[int, int], ...], depth: DepthMap, window: Window, image: Array | None
) -> FocusPlane:
    """Return the plane of disparities through three pixels."""
    values = [disparity_at_pixel(pixel, depth, window, "focus.plane", image) for pixel in pixels]
    return FocusPlane.through(pixels, values)


def _tilted_plane(
    depth: DepthMap,
    window: Window,
    focus: FocusSettings,
    camera: CameraSettings,
    numbers: LensNumbers | None,
    image: Array | None,
) -> Callable[[float], tuple[FocusPlane, float]] | None:
    """Return the function from the pivot's disparity to the plane in focus and the blur, pixels per unit."""
    tilt = (focus.tilt_x, focus.tilt_y)
    if focus.plane is None and not any(tilt):
        return None
    size, middle = (window.display_width, window.display_height), _middle(window)
    pixel = middle if focus.at is None else focus.at
    picked = None
    if focus.plane is not None:
        picked = _picked_plane(focus.plane, depth, window, image)
    check_rank("disparity", depth.values, 2, "(H, W)")
    if numbers is None:
        blur = camera.blur
        assert blur is not None
        return lambda disparity: (picked or relative_plane(tilt, pixel, disparity, size), blur)
    lens, pitch = _thin_lens(numbers, 0.0), numbers.sensor_width / window.display_width

    def at(disparity: float) -> tuple[FocusPlane, float]:
        length = lens.focal_length
        if picked is not None:
            plane = picked
            distance = distance_to_sensor(picked, focal_length=length, pixel_pitch=pitch, centre=middle)
        else:
            plane, distance = tilted_lens(
                tilt, pixel, disparity, focal_length=length, pixel_pitch=pitch, centre=middle
            )
        return plane, lens.pupil_radius * distance / pitch

    return at


def _thin_lens(camera: LensNumbers, focus: float) -> ThinLens:
    """Return the lens focused at a disparity in 1/mm."""
    distance = 1 / focus if focus > 0 else math.inf
    try:
        return ThinLens(focal_length=camera.focal_length, f_number=camera.f_number, focus_distance=distance)
    except LensError as error:
        if error.parameter != "focus_distance":
            raise
        raise LensError(
            f"cannot focus at {distance / 1000:g} m: expected more than {camera.focal_length:g} mm, the "
            "`camera.focal_length`",
            parameter="focus.distance",
        ) from error


def _middle(window: Window) -> tuple[float, float]:
    return (window.display_width - 1) / 2, (window.display_height - 1) / 2
