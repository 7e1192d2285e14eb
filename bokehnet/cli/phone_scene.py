"""The depth map that a phone has put into its photo, blurred as by a full-frame camera.

A phone's own lens, a few millimetres long, blurs next to nothing. What people mean by ``--f-number`` is the
camera that has the same view on 36 x 24 mm of film, which is what portrait modes of phones imitate too.
"""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.cli.scene_map import SceneMap
from bokehnet.errors import ParameterError

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.io.camera import Camera
    from bokehnet.io.frame import Frame
    from bokehnet.io.phone_depth import PhoneDepth

__all__ = ["full_frame_camera", "read_phone_scene"]

_FILM_DIAGONAL = math.hypot(36, 24)  # mm

# Focal length in mm on that film where the file tells none: the main camera of most phones.
_USUAL_FOCAL_LENGTH = 26.0

# Distance of the nearest point, mm, where a phone tells no distances; the farthest is at infinity.
_NEAREST = 1000.0

# Side of the middle of the photo, over that of the photo, that is sharp when nobody says what shall be.
_MIDDLE = 1 / 5


def read_phone_scene(path: Path, frame: "Frame", relative: bool) -> "tuple[Frame, SceneMap]":
    """Return a photo, as it was before the phone blurred it where the file keeps that, and its own map.

    Args:
        path: The photo.
        frame: What it shows.
        relative: Whether the map is to be relative disparity, 0 to 1; else 1/mm.

    Raises:
        ParameterError: The photo holds no map.
        ImageFileError: The map is damaged.
    """
    from bokehnet.io.phone_depth import read_phone_depth
    from bokehnet.io.window import Window

    found = read_phone_depth(path)
    if found is None:
        raise ParameterError(
            f"expected one of --disparity and --depth, found neither, and {path} holds no depth map"
        )
    if found.all_in_focus is not None:
        height, width = found.all_in_focus.shape[:2]
        frame = replace(frame, image=found.all_in_focus, alpha=None, window=Window.whole(width, height))
    disparity, focus = _rescaled(found, relative)
    scene = SceneMap(
        disparity=disparity,
        metric=not relative,
        source="the photo's own depth",
        window=frame.window,
        camera=full_frame_camera(frame.camera, frame.window.width, frame.window.height),
        focus=_middle(disparity) if focus is None else focus,
    )
    return frame, scene


def full_frame_camera(camera: "Camera | None", width: int, height: int) -> "Camera":
    """Return the full-frame camera with the view of a phone's, at the f-number that its file tells.

    Equal diagonals make equal views, as for the focal lengths "in 35 mm" that files tell.

    Args:
        camera: As the photo tells; None where it does not.
        width: Of the picture, pixels.
        height: Of the picture, pixels.
    """
    from bokehnet.io.camera import Camera

    sensor_width = _FILM_DIAGONAL * width / math.hypot(width, height)
    focal_length = _USUAL_FOCAL_LENGTH
    if camera is not None and camera.focal_length is not None and camera.sensor_width is not None:
        focal_length = camera.focal_length * sensor_width / camera.sensor_width
    f_number = None if camera is None else camera.f_number
    return Camera(focal_length=focal_length, f_number=f_number, sensor_width=sensor_width)


def _rescaled(found: "PhoneDepth", relative: bool) -> "tuple[np.ndarray, float | None]":
    """Map and focus of a phone, in 1/mm or relative."""
    values, focus = found.disparity, found.focus_disparity
    low, high = float(values.min()), float(values.max())
    if found.metric and relative:
        span = high - low or 1.0
        return (values - low) / span, None if focus is None else min(max((focus - low) / span, 0.0), 1.0)
    if not found.metric and not relative:
        return values / _NEAREST, None if focus is None else focus / _NEAREST
    return values, focus


def _middle(disparity: "np.ndarray") -> float:
    """Median of the middle of a map."""
    import numpy as np

    height, width = disparity.shape
    top, left = (int(size * (1 - _MIDDLE) / 2) for size in (height, width))
    return float(np.median(disparity[top : height - top, left : width - left]))
