"""The camera behind a picture: as given, as files tell, and the full-frame one that a phone imitates."""

import math
from dataclasses import dataclass, fields, replace

from bokehnet.errors import ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.settings.settings import CameraSettings

__all__ = ["LensNumbers", "complete_camera", "full_frame_camera", "joined"]

_FILM_DIAGONAL = math.hypot(36, 24)  # mm

# Focal length in mm on that film where the file tells none: the main camera of most phones.
_USUAL_FOCAL_LENGTH = 26.0


@dataclass(frozen=True, kw_only=True, slots=True)
class LensNumbers:
    """A camera of which all is known that blur depends on.

    Attributes:
        focal_length: mm.
        f_number: Focal length over the diameter of the entrance pupil.
        sensor_width: What the width of the shown picture covers on the sensor, mm.

    Examples:
        >>> lens = LensNumbers(focal_length=50, f_number=2, sensor_width=36)
        >>> lens.focal_length / lens.f_number  # diameter of the entrance pupil, mm
        25.0
    """

    focal_length: float
    f_number: float
    sensor_width: float


def complete_camera(settings: CameraSettings, camera: Camera | None, origin: str) -> LensNumbers:
    """Return the numbers that were given, and those of the picture's files where none was.

    Args:
        settings: As given.
        camera: What the files say.
        origin: What needs them, for the message.

    Raises:
        ParameterError: Some are missing.

    Examples:
        >>> from bokehnet.io.metadata.camera import Camera
        >>> from bokehnet.settings.settings import CameraSettings
        >>> file = Camera(focal_length=50, sensor_width=36)
        >>> complete_camera(CameraSettings(f_number=2), file, "input.depth")
        LensNumbers(focal_length=50.0, f_number=2.0, sensor_width=36.0)
    """
    found = {}
    for item in fields(LensNumbers):
        given = getattr(settings, item.name)
        found[item.name] = getattr(camera, item.name, None) if given is None else given
    if missing := [f"`camera.{name}`" for name, value in found.items() if value is None]:
        *first, last = missing
        names = f"{', '.join(first)} and {last}" if first else last
        needs = f"`{origin}`" if "." in origin else origin
        raise ParameterError(
            missing[0].strip("`"),
            expected=f"numbers of the camera: {needs} needs {names}",
            shown="none; the picture's file tells none",
        )
    return LensNumbers(**{name: float(value) for name, value in found.items() if value is not None})


def full_frame_camera(camera: Camera | None, width: int, height: int) -> Camera:
    """Return the full-frame camera with the view of a phone's, at the f-number that its file tells.

    Equal diagonals make equal views, as for the focal lengths "in 35 mm" that files tell.

    Args:
        camera: As the photo tells; None where it does not.
        width: Of the picture, pixels.
        height: Of the picture, pixels.

    Examples:
        >>> phone = Camera(focal_length=6.86, f_number=1.8, sensor_width=9.8)
        >>> film = full_frame_camera(phone, 4000, 3000)
        >>> round(film.focal_length, 1), film.f_number, round(film.sensor_width, 1)  # mm, 1, mm
        (24.2, 1.8, 34.6)
    """
    sensor_width = _FILM_DIAGONAL * width / math.hypot(width, height)
    focal_length = _USUAL_FOCAL_LENGTH
    if camera is not None and camera.focal_length is not None and camera.sensor_width is not None:
        focal_length = camera.focal_length * sensor_width / camera.sensor_width
    f_number = None if camera is None else camera.f_number
    return Camera(focal_length=focal_length, f_number=f_number, sensor_width=sensor_width)


def joined(first: Camera | None, second: Camera | None) -> Camera | None:
    """What the first one says, and the second where the first is silent.

    Examples:
        >>> picture, depth = Camera(focal_length=35), Camera(focal_length=50, sensor_width=36)
        >>> joined(picture, depth)
        Camera(focal_length=35, f_number=None, focus_distance=None, sensor_width=36)
    """
    if first is None or second is None:
        return first or second
    silent = [item.name for item in fields(first) if getattr(first, item.name) is None]
    return replace(first, **{name: getattr(second, name) for name in silent})
