"""Camera of a picture: from settings, from file metadata, and the full-frame equivalent of a phone."""

import math
from dataclasses import dataclass, fields, replace

from bokehnet.errors import ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.settings.settings import CameraSettings

__all__ = [
    "DEFAULT_FOCAL_LENGTH",
    "LensNumbers",
    "complete_camera",
    "full_frame_camera",
    "has_view",
    "merged_camera",
]

_FILM_DIAGONAL = math.hypot(36, 24)  # mm

# Default full-frame focal length, mm, without metadata: the main camera of most phones.
DEFAULT_FOCAL_LENGTH = 26.0


@dataclass(frozen=True, kw_only=True, slots=True)
class LensNumbers:
    """Complete data of a camera that the blur depends on.

    Attributes:
        focal_length: Focal length, mm.
        f_number: Focal length over the diameter of the entrance pupil.
        sensor_width: Width of the shown picture on the sensor, mm.

    Examples:
        >>> lens = LensNumbers(focal_length=50, f_number=2, sensor_width=36)
        >>> lens.focal_length / lens.f_number  # diameter of the entrance pupil, mm
        25.0
    """

    focal_length: float
    f_number: float
    sensor_width: float


def complete_camera(settings: CameraSettings, camera: Camera | None, origin: str) -> LensNumbers:
    """Return the camera data of the settings, completed by those of the picture's files.

    Args:
        settings: Camera settings.
        camera: Camera data of the files.
        origin: Setting that needs them, for the message.

    Raises:
        ParameterError: Some data are missing.

    Examples:
        >>> from bokehnet.io.metadata.camera import Camera
        >>> from bokehnet.settings.settings import CameraSettings
        >>> file = Camera(focal_length=50, sensor_width=36)
        >>> complete_camera(CameraSettings(f_number=2), file, "input.depth")
        LensNumbers(focal_length=50.0, f_number=2.0, sensor_width=36.0)
    """
    numbers = {}
    for item in fields(LensNumbers):
        value = getattr(settings, item.name)
        numbers[item.name] = getattr(camera, item.name, None) if value is None else value
    if missing := [f"`camera.{name}`" for name, value in numbers.items() if value is None]:
        *first, last = missing
        names = f"{', '.join(first)} and {last}" if first else last
        needs = f"`{origin}`" if "." in origin else origin
        raise ParameterError(
            missing[0].strip("`"),
            expected=f"camera data: {needs} needs {names}",
            shown="none; the picture's file has none",
        )
    return LensNumbers(**{name: float(value) for name, value in numbers.items() if value is not None})


def full_frame_camera(camera: Camera | None, width: int, height: int) -> Camera:
    """Return the full-frame camera with a phone's field of view, at the f-number of the photo's file.

    Equal diagonals define equal views, as for the 35 mm equivalent focal lengths in files.

    Args:
        camera: Camera data of the photo's file; None if it has none.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.

    Examples:
        >>> phone = Camera(focal_length=6.86, f_number=1.8, sensor_width=9.8)
        >>> film = full_frame_camera(phone, 4000, 3000)
        >>> round(film.focal_length, 1), film.f_number, round(film.sensor_width, 1)  # mm, 1, mm
        (24.2, 1.8, 34.6)
    """
    sensor_width = _FILM_DIAGONAL * width / math.hypot(width, height)
    focal_length = DEFAULT_FOCAL_LENGTH
    if camera is not None and camera.focal_length is not None and camera.sensor_width is not None:
        focal_length = camera.focal_length * sensor_width / camera.sensor_width
    f_number = None if camera is None else camera.f_number
    return Camera(focal_length=focal_length, f_number=f_number, sensor_width=sensor_width)


def has_view(camera: Camera | None) -> bool:
    """Return whether the data of a file define the field of view.

    Examples:
        >>> has_view(Camera(focal_length=6.86, sensor_width=9.8)), has_view(Camera(focal_length=6.86))
        (True, False)
    """
    return camera is not None and camera.focal_length is not None and camera.sensor_width is not None


def merged_camera(first: Camera | None, second: Camera | None) -> Camera | None:
    """Return the first camera, with its unknown fields taken from the second.

    Examples:
        >>> picture, depth = Camera(focal_length=35), Camera(focal_length=50, sensor_width=36)
        >>> merged_camera(picture, depth)
        Camera(focal_length=35, f_number=None, focus_distance=None, sensor_width=36)
    """
    if first is None or second is None:
        return first or second
    unknown = [item.name for item in fields(first) if getattr(first, item.name) is None]
    return replace(first, **{name: getattr(second, name) for name in unknown})
