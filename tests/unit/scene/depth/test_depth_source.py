"""Depth sources: arrays and files must agree."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import BokehnetError, ImageFileError, ModelFileError, ParameterError, ShapeError
from bokehnet.io.depth.units import DEPTH_UNITS
from bokehnet.io.image import read_image
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.phone_depth import PhoneDepth
from bokehnet.io.window import Window
from bokehnet.scene.depth.depth_source import (
    ConstantDisparity,
    DefocusMap,
    EmbeddedDepth,
    MetricDepth,
    NetworkDepth,
    Photo,
    RelativeDisparity,
    depth_source,
)
from bokehnet.scene.scene import make_scene, read_scene
from bokehnet.settings.settings import CameraSettings, DepthSettings, InputSettings, RenderSettings
from tests.unit.io.depth import phone_files as files

METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}  # of each unit
BYTES = np.tile(np.linspace(0, 255, 16).astype(np.uint8), (12, 1))


@pytest.fixture
def shown(photo):
    """Return a picture for a depth source: an array without a file."""
    return Photo(image=photo, window=Window.whole(64, 40))


@pytest.fixture
def network(folder, write_red_network):
    """tiny.onnx, which returns the red channel that it sees, as disparity or, by metric.toml, as depth."""
    write_red_network(folder)
    return folder


def both(path, values, shown, make):
    """The maps of one source from its file and from an array."""
    from_file, from_array = make(path).depth_map(shown), make(values).depth_map(shown)
    assert_array_equal(from_file.values, from_array.values)
    assert from_file.values.dtype == from_array.values.dtype == np.float32
    assert (from_file.kind, from_file.origin) == (from_array.kind, from_array.origin)
    assert from_file.filtered == from_array.filtered
    return from_file


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, lambda raw: (raw + 500) / 3000),
        ({"invert": True}, lambda raw: 1 - (raw + 500) / 3000),
        ({"value_range": (0, 1000)}, lambda raw: raw / 1000),
        ({"value_range": (1000, 0), "invert": True}, lambda raw: raw / 1000),
    ],
)
def test_relative_disparity(folder, write_channels, steps, shown, options, expected):
    raw = 3000 * steps - 500
    write_channels("raw.exr", Y=raw)
    result = both("raw.exr", raw, shown, lambda arguments: RelativeDisparity(map=arguments, **options))
    assert (result.kind, result.origin, result.camera) == ("relative", "input.disparity", None)
    assert_allclose(result.values, expected(raw.astype(np.float64)), atol=1e-6)


def test_relative_disparity_that_is_flat_keeps_its_value(folder, write_channels, shown):
    for value, kept in ((0.3, 0.3), (7, 1), (-7, 0)):
        flat = np.full((40, 64), value, np.float32)
        write_channels("flat.exr", Y=flat)
        result = both("flat.exr", flat, shown, lambda arguments: RelativeDisparity(map=arguments))
        assert_allclose(result.values, kept)


def test_disparity_as_it_is_stored_is_not_stretched(folder, write_channels, steps, shown):
    write_channels("half.exr", Y=0.5 * steps)
    result = both(
        "half.exr", 0.5 * steps, shown, lambda arguments: RelativeDisparity(map=arguments, as_stored=True)
    )
    assert_array_equal(result.values, 0.5 * steps)
    write_channels("beyond.exr", Y=2 * steps)
    with pytest.raises(
        ImageFileError, match=r"beyond.exr: expected stored disparity in 0..1.*found 0 to 2; set"
    ):
        RelativeDisparity(map="beyond.exr", as_stored=True).depth_map(shown)
    with pytest.raises(ParameterError, match=r"^disparity: expected stored values of 0 to 1, got 0 to 2"):
        RelativeDisparity(map=2 * steps, as_stored=True).depth_map(shown)


@pytest.mark.parametrize("unit", DEPTH_UNITS)
def test_metric_depth_in_every_unit(folder, write_channels, steps, shown, unit):
    """Authority: the definitions of the units; disparity is 1 over millimetres, sky 0."""
    with np.errstate(divide="ignore"):
        metres = 1 / steps
    stored = steps if unit == "1/m" else (metres / METRES[unit]).astype(np.float32)
    write_channels("z.exr", Z=stored)
    result = both("z.exr", stored, shown, lambda arguments: MetricDepth(map=arguments, unit=unit))
    assert (result.kind, result.origin) == ("metric", "input.depth")
    assert result.filtered == ("disparity" if unit == "1/m" else "depth")
    assert_allclose(result.values, steps / 1000, rtol=1e-6)


def test_the_camera_of_an_array_is_the_one_that_is_given(photo, steps):
    camera = Camera(focal_length=50.0)
    scene = make_scene(photo, MetricDepth(map=1 + steps), camera=camera)
    assert scene.depth.camera == camera


@pytest.mark.parametrize("relative", [None, False, True])
@pytest.mark.parametrize("units", [None, "m"])
def test_the_map_inside_a_photo(folder, relative, units):
    """Oracle: the file, against what the reader of such files gives, as an array."""
    from bokehnet.io.phone_depth import read_phone_depth

    content = files.gdepth_photo(files.encode(BYTES, "PNG"), near=0.5, far=2, units=units)
    (folder / "portrait.jpg").write_bytes(content)
    picture = read_image("portrait.jpg")
    from_file = read_scene("portrait.jpg", source=EmbeddedDepth(relative=relative)).depth
    held = EmbeddedDepth(map=read_phone_depth("portrait.jpg"), relative=relative)
    from_array = make_scene(picture, held).depth
    assert_array_equal(from_file.values, from_array.values)
    expected = "relative" if (units is None if relative is None else relative) else "metric"
    assert from_file.kind == from_array.kind == expected
    assert from_file.fits_any_size
    assert from_file.focus is from_array.focus is None  # no focus in the file: the subject decides
    disparity = 1 - BYTES / 255  # RangeInverse: linear in 1/distance, 0 is near
    if expected == "relative":
        assert_allclose(from_file.values, disparity, atol=0.01)
    elif units == "m":
        assert_allclose(from_file.values, (0.5 + disparity * 1.5) / 1000, atol=1e-5)
    else:
        assert_allclose(from_file.values, disparity / 1000, atol=1e-5)  # the nearest is 1 m away


def test_the_picture_from_before_the_phone_blurred_it_takes_the_photos_place(photo):
    before = np.full((20, 32, 3), 0.5, np.float32)
    held = PhoneDepth(disparity=np.full((10, 16), 0.25, np.float32), metric=False, all_in_focus=before)
    scene = make_scene(photo, EmbeddedDepth(map=held), alpha=np.ones((40, 64)))
    assert_array_equal(scene.image, before)
    assert scene.alpha is None
    assert scene.depth.all_in_focus is None
    assert (scene.window.display_width, scene.window.display_height) == (32, 20)


@pytest.mark.parametrize(("convention", "kind"), [("tiny.toml", "relative"), ("metric.toml", "metric")])
def test_a_network_guesses_the_same_for_arrays_and_files(network, convention, kind):
    """The network returns what it sees: the red channel, as sRGB, or ten times that in metres."""
    source = NetworkDepth(model="tiny.onnx", convention=convention)
    picture = read_image("photo.exr")
    from_file, from_array = read_scene("photo.exr", source=source).depth, make_scene(picture, source).depth
    assert_array_equal(from_file.values, from_array.values)
    assert from_file.kind == from_array.kind == kind
    assert from_file.origin == "input.depth_model"
    assert from_file.values.shape == (40, 64)
    if kind == "relative":
        assert 0 <= from_file.values.min() < 0.2
        assert 0.8 < from_file.values.max() <= 1
    else:
        assert (1 / from_file.values).max() < 10_500


def test_a_constant_is_everywhere(photo):
    depth = make_scene(photo, ConstantDisparity(value=0.25)).depth
    assert (depth.kind, depth.values.shape) == ("relative", (40, 64))
    assert_array_equal(depth.values, np.float32(0.25))


def test_a_defocus_map_is_taken_as_it_is(folder, write_channels, steps, shown):
    radii = 40 * steps - 12
    write_channels("defocus.exr", Y=radii)
    result = both("defocus.exr", radii, shown, lambda arguments: DefocusMap(map=arguments))
    assert (result.kind, result.origin) == ("defocus", "input.defocus")
    assert_array_equal(result.values, radii)


def test_a_channel_is_picked(folder, shown, steps):
    with np.errstate(divide="ignore"):
        far = 1 / steps + 2
    result = MetricDepth(map="depth.exr", channel="far").depth_map(shown).values
    assert_allclose(result, 1 / (1000 * far), rtol=1e-6)
    for make in (MetricDepth, DefocusMap, RelativeDisparity):
        with pytest.raises(ImageFileError, match="no channel 'Q'"):
            make(map="depth.exr", channel="Q").depth_map(shown)


@pytest.mark.parametrize("make", [RelativeDisparity, MetricDepth, DefocusMap])
@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        (np.ones((4, 4, 3), np.float32), ShapeError),
        (np.ones(4, np.float32), ShapeError),
        (np.ones((0, 4), np.float32), ShapeError),
        (np.array([["a"]]), ParameterError),
        (np.array([[None]]), ParameterError),
        (np.full((4, 4), np.nan, np.float32), BokehnetError),
        (np.full((4, 4), -np.inf, np.float32), BokehnetError),
        ([[1.0]], ParameterError),
        (None, ParameterError),
        (5, ParameterError),
        ("missing.exr", ImageFileError),
        (".", ImageFileError),
        ("empty.png", ImageFileError),
        ("photo.toml", ImageFileError),
    ],
)
def test_an_invalid_map_is_reported(folder, shown, make, arguments, kind):
    (folder / "empty.png").touch()
    (folder / "photo.toml").write_text("hello")
    with pytest.raises(kind) as caught:
        make(map=arguments).depth_map(shown)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_invalid_values_of_a_map_are_reported_with_their_position(folder, write_channels, shown):
    for value in (0, -2.5, math.nan):
        depth = np.full((40, 64), 2, np.float32)
        depth[3, 7] = value
        write_channels("bad.exr", Z=depth)
        for original in (depth, "bad.exr"):
            with pytest.raises(ImageFileError, match="x=7, y=3"):
                MetricDepth(map=original).depth_map(shown)


@pytest.mark.parametrize(
    ("source", "kind", "words"),
    [
        (ConstantDisparity(value=1.5), ParameterError, "input.constant_disparity: expected a relative"),
        (ConstantDisparity(value=math.nan), ParameterError, "input.constant_disparity"),
        (ConstantDisparity(value="near"), ParameterError, "input.constant_disparity"),
        (RelativeDisparity(map=np.ones((4, 4)), value_range=(2, 2)), ParameterError, "two different numbers"),
        (RelativeDisparity(map=np.ones((4, 4)), value_range=(0, math.inf)), ParameterError, "different"),
        (MetricDepth(map=np.ones((4, 4)), unit="parsec"), ParameterError, "unit: expected one of"),
        (NetworkDepth(model="missing.onnx"), ModelFileError, "missing.onnx: expected an ONNX file"),
        (NetworkDepth(model="photo.exr"), ModelFileError, "photo.exr: not a usable ONNX file"),
        (NetworkDepth(model="photo.exr", convention="mine"), BokehnetError, "'mine'"),
        (EmbeddedDepth(), ParameterError, "neither, and the picture has no depth map"),
    ],
)
def test_a_source_without_an_answer_reports_the_reason(folder, shown, source, kind, words):
    with pytest.raises(kind, match=words):
        source.depth_map(shown)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, EmbeddedDepth(relative=False)),
        ({"camera": CameraSettings(blur=5)}, EmbeddedDepth(relative=True)),
        (
            {
                "input": InputSettings(disparity="a.exr", channel="Q"),
                "depth": DepthSettings(
                    invert=True, value_range=(1, 3), as_stored=True, coding="jet", no_data=4, holes="error"
                ),
            },
            ("a.exr", "Q", True, (1, 3), True, "jet", 4, "error"),
        ),
        (
            {
                "input": InputSettings(depth="a.exr"),
                "depth": DepthSettings(unit="ft", coding="rgb24", kind="ray", no_data=4, holes="error"),
            },
            ("a.exr", None, "ft", "rgb24", "ray", None, None, 4, "error", CameraSettings()),
        ),
        (
            {
                "input": InputSettings(depth="a.exr", channel="Z"),
                "depth": DepthSettings(kind="zbuffer", near=0.1, far=9),
            },
            ("a.exr", "Z", None, "auto", "zbuffer", 0.1, 9, None, None, CameraSettings()),
        ),
        ({"input": InputSettings(defocus="a.exr", channel="Z")}, ("a.exr", "Z")),
        ({"input": InputSettings(depth_model="a.onnx")}, ("a.onnx", "depth-anything-v2", 0, False, None)),
        (
            {"input": InputSettings(depth_model="a.onnx", depth_convention="midas")},
            ("a.onnx", "midas", 0, False, None),
        ),
        ({"input": InputSettings(constant_disparity=0.5)}, (0.5,)),
    ],
)
def test_settings_select_the_source_and_pass_all_values(settings, expected):
    result = depth_source(RenderSettings(**settings))
    if isinstance(expected, EmbeddedDepth):
        assert (type(result), result.map, result.relative) == (EmbeddedDepth, None, expected.relative)
        return
    values = tuple(getattr(result, field.name) for field in dataclasses.fields(result))
    values = tuple(str(value) if hasattr(value, "parts") else value for value in values)
    assert values == expected
