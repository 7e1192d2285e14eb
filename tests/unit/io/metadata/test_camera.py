import math

import numpy as np
import pytest

from bokehnet.io.frame import read_frame
from bokehnet.io.metadata.camera import Camera, camera_from_exif, camera_from_exr
from tests.unit.io.exr.exr_files import write_exr


def test_standard_attributes_of_openexr():
    """OpenEXR, "Standard Attributes": lengths in mm, focus in m, the pitch of photosites in um."""
    attributes = {
        "nominalFocalLength": 40.0,
        "aperture": 2.8,
        "focus": 3.5,
        "sensorOverallDimensions": (27.99, 19.22),
    }
    assert camera_from_exr(attributes) == Camera(
        focal_length=40, f_number=2.8, focus_distance=3500, sensor_width=27.99
    )
    used = {"sensorPhotositePitch": 8.25, "sensorAcquisitionRectangle": (256, 140, 3135, 1759)}
    camera = camera_from_exr({**attributes, **used, "effectiveFocalLength": 40.6})
    assert camera.focal_length == 40.6
    assert camera.sensor_width == pytest.approx(2880 * 0.00825)
    assert camera_from_exr({"focus": math.inf}) == Camera(focus_distance=math.inf)


@pytest.mark.parametrize(
    ("aperture", "focal_length", "fov"),
    [(24.9294, 51.9469, 26.9862), (36.000004, 24, 73.719574)],
)
def test_vray_lengths_are_mm_of_the_width(aperture, focal_length, fov):
    """Two published V-Ray headers: the field of view in degrees that stands beside the lengths."""
    camera = camera_from_exr(
        {
            "cameraAperture": aperture,
            "cameraFocalLength": focal_length,
            "cameraFNumber": 8.0,
            "cameraTargetDistance": 1e18,  # in units of the scene
        }
    )
    assert camera.focus_distance is None
    assert camera.f_number == 8
    result = 2 * math.degrees(math.atan(camera.sensor_width / 2 / camera.focal_length))
    assert result == pytest.approx(fov, abs=0.03)


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        (
            {"CameraFocalLength": 35.0, "CameraFilmApertureHorizontal": 36.0},
            {"focal_length": 35.0, "sensor_width": 36.0},
        ),
        ({"Lens": "50.00"}, {"focal_length": 50.0}),
        ({"Lens": "Cooke S4"}, None),
        (
            {"rs/camera/FStop": 4.0, "rs/camera/aperture": (36.0, 24.0)},
            {"f_number": 4.0, "sensor_width": 36.0},
        ),
        (
            {
                "unreal/camera/FinalImage/fstop": "2.8",
                "unreal/camera/FinalImage/focalLength": "35.0",
                "unreal/camera/FinalImage/focalDistance": "250.0",
                "unreal/camera/FinalImage/sensorWidth": "23.76",
            },
            {"f_number": 2.8, "focal_length": 35.0, "focus_distance": 2500.0, "sensor_width": 23.76},
        ),
        ({}, None),
        ({"aperture": 0.0, "focus": -1.0, "cameraFocalLength": math.nan, "cameraAperture": math.inf}, None),
        (
            {"aperture": "1.2.3", "sensorPhotositePitch": 5.0, "sensorAcquisitionRectangle": (9, 0, 3, 0)},
            None,
        ),
    ],
)
def test_other_writers_and_what_is_no_number(attributes, expected):
    """Names and units: see :func:`camera_from_exr`."""
    assert camera_from_exr(attributes) == (None if expected is None else Camera(**expected))


def test_the_width_of_a_phones_sensor_follows_from_the_35_mm_equivalent():
    """A sensor of 4:3 with 9.5 mm diagonal; CIPA DCG-001 compares diagonals with 43.27 mm."""
    diagonal, focal_length = 9.5, 5.43
    tags = {
        "Exif:FocalLength": focal_length,
        "FNumber": 1.8,
        "Exif:FocalLengthIn35mmFilm": focal_length * math.hypot(36, 24) / diagonal,
        "Exif:SubjectDistance": 1.25,
    }
    landscape = camera_from_exif(tags, 4000, 3000)
    assert landscape == Camera(
        focal_length=5.43, f_number=1.8, focus_distance=1250, sensor_width=pytest.approx(diagonal * 0.8)
    )
    assert camera_from_exif(tags, 3000, 4000).sensor_width == pytest.approx(diagonal * 0.6)


@pytest.mark.parametrize(
    ("resolution", "unit", "width"),
    [(6000 / 36 * 25.4, 2, 36), (6000 / 36 * 25.4, None, 36), (6000 / 36 * 10, 3, 36), (6000 / 36, 4, 36)],
)
def test_sensor_width_follows_from_the_focal_plane_resolution(resolution, unit, width):
    """CIPA DC-008, FocalPlaneResolutionUnit: 2 inch (the default), 3 cm."""
    tags = {"Exif:FocalPlaneXResolution": resolution}
    if unit:
        tags["Exif:FocalPlaneResolutionUnit"] = unit
    assert camera_from_exif(tags, 6000, 4000).sensor_width == pytest.approx(width)
    assert camera_from_exif(tags, 4000, 6000).sensor_width == pytest.approx(width * 2 / 3)


@pytest.mark.parametrize(("distance", "expected"), [(0.0, None), (4294967295.0, math.inf), (2.0, 2000.0)])
def test_the_subjects_distance_may_be_unknown_or_infinite(distance, expected):
    """CIPA DC-008, SubjectDistance: numerator 0 is unknown, 0xFFFFFFFF infinity."""
    camera = camera_from_exif({"Exif:SubjectDistance": distance, "FNumber": 2.0}, 3, 2)
    assert camera.focus_distance == expected


def test_no_camera_is_none():
    assert camera_from_exif({"Make": "x"}, 3, 2) is None


def test_the_camera_of_files_is_found(tmp_path, store):
    tags = {"Exif:FocalLength": 5.4, "FNumber": 1.8, "Exif:FocalLengthIn35mmFilm": 26}
    stored = np.zeros((30, 40, 3), np.uint8)
    path = store("a.jpg", stored, **{name.replace(":", "__"): value for name, value in tags.items()})
    camera = read_frame(path).camera
    assert camera.focal_length == pytest.approx(5.4)
    assert camera.f_number == pytest.approx(1.8)
    assert camera.sensor_width == pytest.approx(math.hypot(36, 24) * 5.4 / 26 * 0.8, rel=1e-4)
    channels = {c: ("half", np.zeros((4, 5))) for c in "RGB"}
    attributes = {"focus": 2.0, "effectiveFocalLength": 35.0, "Lens": "85.00"}
    camera = read_frame(
        write_exr(tmp_path / "a.exr", {"channels": channels, "attributes": attributes})
    ).camera
    assert camera == Camera(focal_length=35, focus_distance=2000)
