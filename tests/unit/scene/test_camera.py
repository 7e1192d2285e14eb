import math

import pytest

from bokehnet.errors import ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.scene.camera import LensNumbers, complete_camera, full_frame_camera, merged_camera
from bokehnet.settings.settings import CameraSettings

DIAGONAL = math.hypot(36, 24)


@pytest.mark.parametrize("size", [(4000, 3000), (3000, 4000)])
def test_the_full_frame_camera_has_the_view_of_the_phones(size):
    """Authority: equal field of view over the diagonal, 2 atan(diagonal / 2 f)."""
    width, height = size
    phone = Camera(focal_length=5.0, f_number=1.7, sensor_width=6.4 * width / 4000)
    camera = full_frame_camera(phone, width, height)
    diagonal = math.hypot(1, height / width)
    assert camera.sensor_width * diagonal == pytest.approx(DIAGONAL)
    assert camera.focal_length / camera.sensor_width == pytest.approx(phone.focal_length / phone.sensor_width)
    assert camera.f_number == 1.7


@pytest.mark.parametrize("phone", [None, Camera(focal_length=5.0), Camera(sensor_width=6.4)])
def test_without_a_focal_length_the_phone_has_26_mm(phone):
    camera = full_frame_camera(phone, 4000, 3000)
    assert (camera.focal_length, camera.f_number) == (26, None)
    assert camera.sensor_width == pytest.approx(DIAGONAL * 0.8)


def test_what_is_given_wins_over_what_files_say():
    file = Camera(focal_length=35.0, f_number=4.0, sensor_width=24.0)
    result = complete_camera(CameraSettings(f_number=2, sensor_width=36), file, "input.depth")
    assert result == LensNumbers(focal_length=35, f_number=2, sensor_width=36)


@pytest.mark.parametrize(
    ("arguments", "file", "missing"),
    [
        ({}, None, "`camera.focal_length`, `camera.f_number` and `camera.sensor_width`"),
        ({"f_number": 2}, Camera(focal_length=50), "needs `camera.sensor_width`"),
        ({"f_number": 2}, Camera(), "`camera.focal_length` and `camera.sensor_width`"),
    ],
)
def test_a_value_missing_in_both_is_requested(arguments, file, missing):
    with pytest.raises(ParameterError) as caught:
        complete_camera(CameraSettings(**arguments), file, "input.depth")
    assert missing in str(caught.value)
    assert "`input.depth` needs" in str(caught.value)
    assert caught.value.parameter.startswith("camera.")


def test_the_first_file_wins_over_the_second():
    first, second = Camera(focal_length=50.0), Camera(focal_length=35.0, f_number=2.0)
    assert merged_camera(first, second) == Camera(focal_length=50.0, f_number=2.0)
    assert merged_camera(None, second) == merged_camera(second, None) == second
    assert merged_camera(None, None) is None
