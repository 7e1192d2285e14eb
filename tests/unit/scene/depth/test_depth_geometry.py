"""Depth along the ray and between planes. Authority: rays of a pinhole, projection of a graphics card."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.scene.depth.depth_source import MetricDepth, Photo
from bokehnet.settings.settings import CameraSettings

HEIGHT, WIDTH = 30, 48
IMAGE = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
PHOTO = Photo(image=IMAGE, window=Window.whole(WIDTH, HEIGHT))
LENS = CameraSettings(focal_length=24, sensor_width=36)


def distances(columns, rows, width, height):
    """Distance from the pinhole of a wall at 2 m, metres: the norm of the point under each pixel."""
    pitch = 36 / width
    x = (columns + 0.5 - width / 2) * pitch * 2 / 24
    y = (rows + 0.5 - height / 2) * pitch * 2 / 24
    return np.sqrt(x[None] ** 2 + y[:, None] ** 2 + 4)


def test_a_wall_stays_a_wall_along_the_ray():
    stored = distances(np.arange(WIDTH), np.arange(HEIGHT), WIDTH, HEIGHT)
    depth = MetricDepth(map=stored, measured="ray", view=LENS).depth_map(PHOTO)
    assert_allclose(depth.values, 1 / 2000, rtol=1e-6)
    assert depth.assumptions == ("distance along the ray", "depth in m")


def test_maps_of_another_size_and_crops_see_the_same_wall():
    small = distances(2 * np.arange(WIDTH // 2) + 0.5, 2 * np.arange(HEIGHT // 2) + 0.5, WIDTH, HEIGHT)
    assert_allclose(
        MetricDepth(map=small, measured="ray", view=LENS).depth_map(PHOTO).values, 5e-4, rtol=1e-6
    )
    window = Window(x=5, y=3, width=20, height=10, display_width=WIDTH, display_height=HEIGHT)
    crop = Photo(image=IMAGE[:10, :20], window=window, camera=Camera(focal_length=24.0, sensor_width=36.0))
    stored = distances(np.arange(5, 25), np.arange(3, 13), WIDTH, HEIGHT)
    assert_allclose(MetricDepth(map=stored, measured="ray").depth_map(crop).values, 5e-4, rtol=1e-6)


def test_rays_need_the_field_of_view():
    with pytest.raises(ParameterError, match=r"camera.focal_length: expected the field of view"):
        MetricDepth(map=np.full((4, 6), 2.0), measured="ray").depth_map(PHOTO)


@pytest.mark.parametrize(("near", "far"), [(0.1, 100.0), (0.1, np.inf), (100.0, 0.1), (np.inf, 0.1)])
def test_z_buffers_of_every_kind(near, far):
    """Authority: z = A + B / d with z = 0 at the first and 1 at the second plane; reversed ones included."""
    metres = np.geomspace(0.1, 100, WIDTH)[None].repeat(HEIGHT, 0)
    first, second = 1 / near, 1 / far
    stored = (1 / metres - first) / (second - first)
    depth = MetricDepth(map=stored, measured="zbuffer", near=near, far=far).depth_map(PHOTO)
    assert_allclose(1 / (1000 * depth.values.astype(float)), metres, rtol=2e-3)


def test_normalised_depth_between_planes(tmp_path):
    levels = np.tile(np.arange(0, 65536, 65535 // 47, dtype=np.uint16)[:WIDTH], (HEIGHT, 1))
    Image.fromarray(levels).save(tmp_path / "z.png")
    depth = MetricDepth(map=tmp_path / "z.png", near=1.0, far=9.0).depth_map(PHOTO)
    assert_allclose(1 / (1000 * depth.values), 1 + 8 * (levels / 65535), rtol=1e-5)
    assert depth.assumptions == ("depth from 1 to 9 m",)


def test_values_outside_the_planes_are_an_error():
    with pytest.raises(ParameterError, match=r"depth.kind: expected stored values of 0 to 1.*got 0 to 2"):
        MetricDepth(map=np.linspace(0, 2, 12).reshape(3, 4), measured="zbuffer", near=1, far=2).depth_map(
            PHOTO
        )


@pytest.mark.parametrize(
    ("unit", "scale"), [("mm", 1), ("0.2mm", 5), ("1/256m", 0.256), ("cm", 0.1), ("1/5000 m", 5)]
)
def test_integers_in_units_with_a_scale(tmp_path, unit, scale):
    """Authority: millimetres over the scale, rounded, as TUM (5000 a metre) and KITTI (256) store them."""
    millimetres = np.linspace(500, 9000, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    stored = np.rint(millimetres * scale).astype(np.uint16)
    for name in ("z.png", "z.tif", "z.npy"):
        path = tmp_path / name
        np.save(path, stored) if name.endswith("npy") else Image.fromarray(stored).save(path)
        depth = MetricDepth(map=path, unit=unit).depth_map(PHOTO)
        assert_allclose(1 / depth.values, stored / scale, rtol=1e-5)
        assert depth.assumptions == (f"depth in {unit}",)


@pytest.mark.parametrize(("unit", "is_doubtful"), [("m", True), ("mm", False)])
def test_integers_that_put_a_scene_beyond_a_kilometre_are_doubted(tmp_path, unit, is_doubtful):
    stored = np.linspace(900, 9000, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH).astype(np.uint16)
    Image.fromarray(stored).save(tmp_path / "z.png")
    notes = MetricDepth(map=tmp_path / "z.png", unit=unit).depth_map(PHOTO).notes
    assert any(" km; are they of another `depth.unit`" in note for note in notes) == is_doubtful


def test_integers_without_unit_are_refused_with_the_way_out(tmp_path):
    Image.fromarray(np.full((4, 6), 900, np.uint16)).save(tmp_path / "z.png")
    with pytest.raises(ImageFileError, match=r"integers up to 65535; give their unit as `depth.unit`"):
        MetricDepth(map=tmp_path / "z.png").depth_map(PHOTO)


def test_negated_depth_is_refused():
    with pytest.raises(ImageFileError, match="multiply it by -1"):
        MetricDepth(map=-np.ones((4, 6))).depth_map(PHOTO)
