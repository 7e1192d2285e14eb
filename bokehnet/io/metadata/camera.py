"""Camera data in a file: OpenEXR attributes of renderers and cameras, and EXIF."""

import fnmatch
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from bokehnet.io.exr.header import Value

__all__ = ["Camera", "camera_from_exif", "camera_from_exr"]

_M, _CM, _UM = 1000.0, 10.0, 0.001  # mm in each

# Attribute names in order of preference (the first number above 0 is used), and mm (or 1) per unit.
# Focus distances in the units of a renderer's scene are omitted: the unit is not in the file.
_FOCAL_LENGTH = {
    "effectiveFocalLength": 1.0,  # OpenEXR
    "nominalFocalLength": 1.0,
    "CameraFocalLength": 1.0,  # Arnold
    "cameraFocalLength": 1.0,  # V-Ray
    "IFM_focalLength": 1.0,  # Iray
    "unreal/camera/*/focalLength": 1.0,
    "Exif:FocalLength": 1.0,  # OpenImageIO
    "Lens": 1.0,  # Blender
}
_F_NUMBER = {
    "aperture": 1.0,  # OpenEXR
    "cameraFNumber": 1.0,  # V-Ray
    "rs/camera/FStop": 1.0,  # Redshift
    "unreal/camera/*/fstop": 1.0,
}
_FOCUS_DISTANCE = {
    "focus": _M,  # OpenEXR; infinity is allowed
    "unreal/camera/*/focalDistance": _CM,
}
_SENSOR_WIDTH = {
    "sensorOverallDimensions": 1.0,  # OpenEXR
    "CameraFilmApertureHorizontal": 1.0,  # Arnold
    "cameraAperture": 1.0,  # V-Ray
    "rs/camera/aperture": 1.0,  # Redshift
    "unreal/camera/*/sensorWidth": 1.0,
}

_FILM_DIAGONAL = math.hypot(36, 24)
_MM_PER_EXIF_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}  # FocalPlaneResolutionUnit: inch, cm, mm, um
_EXIF_INFINITY = float(2**32 - 1)


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Camera data of a file; None for missing values.

    Attributes:
        focal_length: Focal length, mm.
        f_number: Focal length over the diameter of the entrance pupil.
        focus_distance: Distance in focus, mm, may be infinite.
        sensor_width: Sensor width that corresponds to the width of the upright display window, mm.
    """

    focal_length: float | None = None
    f_number: float | None = None
    focus_distance: float | None = None
    sensor_width: float | None = None


def camera_from_exr(attributes: Mapping[str, Value]) -> Camera | None:
    """Return the camera data in the attributes of an EXR header; None if there are none.

    Args:
        attributes: Numbers, tuples of numbers (the first one counts) and texts by name, as stored.

    Source:
        OpenEXR, "Standard Attributes" (effectiveFocalLength and nominalFocalLength in mm, aperture in
        f-stops, focus in m, sensorPhotositePitch in um, sensorOverallDimensions in mm), openexr.com.
        Blender, ``BKE_stamp_info_callback`` ("Lens"). Unreal Engine, ``UMoviePipelineImagePassBase``
        ("unreal/camera/.../", focus in cm). V-Ray, Arnold, Redshift and Iray: headers of published
        files and the public Nuke scripts that read them; for V-Ray the field of view in the same header
        confirms that both lengths are in mm and that the aperture is the width.
    """
    camera = Camera(
        focal_length=_first(attributes, _FOCAL_LENGTH),
        f_number=_first(attributes, _F_NUMBER),
        focus_distance=_first(attributes, _FOCUS_DISTANCE, infinite=True),
        sensor_width=_photosites(attributes) or _first(attributes, _SENSOR_WIDTH),
    )
    return None if camera == Camera() else camera


def camera_from_exif(tags: Mapping[str, Value], width: int, height: int) -> Camera | None:
    """Return the camera data in EXIF tags, named as by OpenImageIO; None if there are none.

    The width of the sensor follows from the 35 mm equivalent, which survives resizing, otherwise from the
    resolution of the focal plane.

    Args:
        tags: Numbers by name.
        width: Width of the upright picture, pixels.
        height: Height of the upright picture, pixels.

    Source:
        CIPA DC-008, "Exchangeable image file format (Exif)", 2019. CIPA DCG-001, "Guideline for noting
        digital camera specifications in catalogs", 2005: the 35 mm equivalent compares diagonals.
    """
    focal_length = _number(tags.get("Exif:FocalLength"))
    focus = _number(tags.get("Exif:SubjectDistance"))
    equivalent = _number(tags.get("Exif:FocalLengthIn35mmFilm"))
    resolution = _number(tags.get("Exif:FocalPlaneXResolution"))
    unit = _MM_PER_EXIF_UNIT.get(int(_number(tags.get("Exif:FocalPlaneResolutionUnit")) or 2))
    sensor_width = None
    if focal_length and equivalent:
        sensor_width = _FILM_DIAGONAL * focal_length / equivalent * width / math.hypot(width, height)
    elif resolution and unit:
        sensor_width = width * unit / resolution
    camera = Camera(
        focal_length=focal_length,
        f_number=_number(tags.get("FNumber")),
        focus_distance=focus and (math.inf if focus >= _EXIF_INFINITY else focus * _M),
        sensor_width=sensor_width,
    )
    return None if camera == Camera() else camera


def _first(
    attributes: Mapping[str, Value], patterns: Mapping[str, float], *, infinite: bool = False
) -> float | None:
    """Return the first usable number among the attributes of these names in mm, or None."""
    for pattern, unit in patterns.items():
        for name in fnmatch.filter(attributes, pattern) if "*" in pattern else [pattern]:
            number = _number(attributes.get(name), infinite=infinite)
            if number is not None:
                return number * unit
    return None


def _photosites(attributes: Mapping[str, Value]) -> float | None:
    """Return the width of the used photosites, mm."""
    pitch = _number(attributes.get("sensorPhotositePitch"))
    used = attributes.get("sensorAcquisitionRectangle")
    if pitch is None or not isinstance(used, tuple) or len(used) != 4 or used[2] <= used[0]:
        return None
    return (used[2] - used[0] + 1) * pitch * _UM


def _number(value: Value | None, *, infinite: bool = False) -> float | None:
    """Return a number above 0, also from a text such as "50.00" or "50 mm", or None."""
    if isinstance(value, tuple):
        value = value[0] if value else None
    if isinstance(value, str):
        match = re.fullmatch(r"\s*(?:[fF]/)?([0-9.]+(?:[eE][-+]?[0-9]+)?|inf)\s*(?:mm)?\s*\0*", value)
        try:
            value = float(match[1]) if match else None
        except ValueError:
            return None
    if value is None or not value > 0 or (math.isinf(value) and not infinite):
        return None
    return float(value)
