"""Black bars, pixels that are not square, panoramas and stereo pairs."""

import math

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from bokehnet.errors import ParameterError
from bokehnet.io.frame import read_frame
from bokehnet.io.info import image_info
from bokehnet.io.window import Window
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.black_bars import BlackBars, find_black_bars
from bokehnet.scene.depth.depth_source import ConstantDisparity, MetricDepth, RelativeDisparity
from bokehnet.scene.scene import make_scene
from bokehnet.settings.settings import RenderSettings

HEIGHT, WIDTH, RADIUS = 80, 160, 8
RNG = np.random.default_rng(11)
SOFT = (0.2 + 0.1 * RNG.random((HEIGHT, WIDTH, 3))).astype(np.float32)
BLURRED = {"camera": {"blur": RADIUS}, "focus": {"value": 1}}


@pytest.fixture(scope="module")
def renderer():
    return BokehRenderer("scatter")


def settings(**changes):
    return RenderSettings().updated(BLURRED | changes)


def rendered(renderer, image, **changes):
    return renderer.render(make_scene(image, ConstantDisparity(value=0)), settings(**changes))


def lamp(row, column, light=100.0):
    image = np.full((HEIGHT, WIDTH, 3), 1e-4, np.float32)
    image[row, column] = light
    return image


# Black bars


def letterbox():
    image = SOFT.copy()
    image[:12] = image[-11:] = 0
    return image


@pytest.mark.parametrize("depth_of_bars", [0, 90, 255])
def test_the_depth_of_bars_does_not_stretch_that_of_the_picture(renderer, depth_of_bars):
    """Authority: the render of picture and map that were cropped first."""
    near = np.tile(np.linspace(60, 190, WIDTH, dtype=np.float32), (HEIGHT, 1))
    near[:12] = near[-11:] = depth_of_bars
    blurred = RenderSettings().updated({"camera": {"blur": RADIUS}, "focus": {"value": 0.3}})
    result = renderer.render(make_scene(letterbox(), RelativeDisparity(map=near)), blurred)
    alone = renderer.render(make_scene(SOFT[12:-11], RelativeDisparity(map=near[12:-11])), blurred)
    assert_array_equal(result.bokeh[12:-11], alone.bokeh)


@pytest.mark.parametrize(("width", "warnings"), [(WIDTH, 0), (WIDTH - 40, 1)])
def test_a_panorama_that_is_not_twice_as_wide_as_high_is_noted(renderer, width, warnings):
    """Authority: 360 over 180 degrees."""
    report = rendered(renderer, SOFT[:, :width], input={"projection": "equirect"}).report
    assert len([note for note in report.notes if "360 x 180 degrees" in note]) == warnings


def test_bars_stay_black_and_the_picture_next_to_them_is_that_without_bars(renderer):
    """Authority: the render of the picture that was cropped first."""
    result = rendered(renderer, letterbox())
    alone = rendered(renderer, SOFT[12:-11])
    assert result.bokeh.shape == SOFT.shape
    assert_array_equal(result.bokeh[12:-11], alone.bokeh)
    assert not result.bokeh[:12].any()
    assert not result.bokeh[-11:].any()
    assert result.report.assumptions[-1] == "black bars kept (top 12, bottom 11 px)"


def test_the_focus_is_a_pixel_of_the_whole_picture(renderer):
    values = np.tile(np.linspace(0, 1, HEIGHT, dtype=np.float32)[:, None], (1, WIDTH))
    scene = make_scene(letterbox(), RelativeDisparity(map=values))
    result = renderer.render(
        scene, RenderSettings().updated({"camera": {"blur": 4}, "focus": {"at": (80, 40)}})
    )
    assert result.report.focus_disparity == pytest.approx((40 - 12) / (HEIGHT - 11 - 1 - 12))


def pillarbox():
    image = SOFT.copy()
    image[:, :20] = image[:, -20:] = 0.0003  # compressed black
    return image


def ringing():
    """A letterbox as JPEG leaves it: single pixels of up to 24 levels in the bars next to the picture."""
    image, rng = letterbox(), np.random.default_rng(5)
    noise = 0.009 * rng.random((12, WIDTH, 1)) * (rng.random((12, WIDTH, 1)) < 0.3)
    image[8:12] = noise[8:]
    image[-11:-8] = noise[:3]
    return image


@pytest.mark.parametrize(
    ("image", "bars"),
    [
        (letterbox(), BlackBars(top=12, bottom=11)),
        (pillarbox(), BlackBars(left=20, right=20)),
        (ringing(), BlackBars(top=12, bottom=11)),
        (SOFT, None),
        (np.zeros_like(SOFT), None),
        (np.where(np.random.default_rng(3).random((HEIGHT, WIDTH, 1)) < 0.1, letterbox(), 0), None),  # night
        (np.where(np.arange(HEIGHT)[:, None, None] < 12, 0, SOFT), None),  # above only: a night sky
        (
            np.where(np.hypot(*(np.mgrid[:HEIGHT, :WIDTH] - [[[40]], [[80]]])) < 30, 0.5, 0)[..., None]
            * SOFT,
            None,
        ),
        (lamp(40, 80), None),
    ],
)
def test_only_certain_bars_count(image, bars):
    assert find_black_bars(np.asarray(image, np.float32)) == bars


# Pixels that are not square


def write_wide(path, dpi):
    """An EXR with pixels twice as wide as high, or a TIFF of this resolution across and down."""
    if path.suffix == ".tif":
        Image.fromarray(np.zeros((8, 12, 3), np.uint8)).save(path, dpi=dpi)
        return
    spec = oiio.ImageSpec(12, 8, 3, oiio.FLOAT)
    spec.attribute("PixelAspectRatio", 2.0)
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(np.zeros((8, 12, 3), np.float32))
    out.close()


@pytest.mark.parametrize("aspect", [2.0, 0.5, 1.0])
def test_discs_are_round_on_the_screen(renderer, tmp_path, aspect):
    """Authority: width in stored pixels times the aspect of a pixel equals the height."""
    image = lamp(40, 80)
    window = Window(
        x=0, y=0, width=WIDTH, height=HEIGHT, display_width=WIDTH, display_height=HEIGHT, pixel_aspect=aspect
    )
    scene = make_scene(image, ConstantDisparity(value=0), window=window)
    disc = renderer.render(scene, settings()).bokeh[..., 0] > 0.1
    wide, high = int(disc.any(axis=0).sum()), int(disc.any(axis=1).sum())
    assert wide * aspect == pytest.approx(high, abs=1.5)
    assert max(wide, high) == pytest.approx(2 * RADIUS + 1, abs=1)


def test_the_lens_gives_the_same_height_with_any_pixels():
    """Authority: pixels twice as wide as high keep the sensor's width, so a disc has twice as many rows."""
    camera = {"focal_length": 50, "f_number": 2, "sensor_width": 36}
    heights = {}
    for aspect in (1.0, 2.0):
        window = Window(
            x=0,
            y=0,
            width=WIDTH,
            height=HEIGHT,
            display_width=WIDTH,
            display_height=HEIGHT,
            pixel_aspect=aspect,
        )
        scene = make_scene(SOFT, MetricDepth(map=np.full((HEIGHT, WIDTH), 2.0)), window=window)
        changes = RenderSettings().updated({"camera": camera, "focus": {"distance": 1.5}})
        heights[aspect] = float(np.abs(BokehRenderer("scatter").prepare(scene, changes).defocus).max())
    assert heights[2.0] == pytest.approx(2 * heights[1.0])


@pytest.mark.parametrize(
    ("name", "dpi", "aspect"),
    [
        ("a.exr", None, 2.0),
        ("a.tif", (72, 144), 2.0),
        ("b.tif", (300, 300), 1.0),
        ("c.tif", (1, 300), 1.0),  # a fault
    ],
)
def test_files_name_their_pixel_aspect_ratio(tmp_path, name, dpi, aspect):
    write_wide(tmp_path / name, dpi)
    assert read_frame(tmp_path / name).window.pixel_aspect == pytest.approx(aspect)
    assert image_info(tmp_path / name).pixel_aspect == pytest.approx(aspect)


# Panoramas


@pytest.mark.slow
def test_light_crosses_the_seam_of_a_panorama(renderer):
    """Authority: the panorama turned by half its width, whose seam is elsewhere."""
    image = SOFT.copy()
    image[35:45, -4:] = image[35:45, :2] = 3
    changes = {"input": {"projection": "equirect"}}
    turned = rendered(renderer, np.roll(image, WIDTH // 2, axis=1), **changes).bokeh
    assert_allclose(
        np.roll(rendered(renderer, image, **changes).bokeh, WIDTH // 2, axis=1), turned, atol=2e-3
    )


@pytest.mark.parametrize(
    "row", [10, pytest.param(20, marks=pytest.mark.slow), pytest.param(40, marks=pytest.mark.slow)]
)
def test_discs_of_a_panorama_widen_towards_the_poles(renderer, row):
    """Authority: the circle on the sphere, all directions within the radius of the lamp's; second moments."""
    light = rendered(renderer, lamp(row, 80), input={"projection": "equirect"}).bokeh[..., 0]
    light = np.maximum(light - 1e-4, 0)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    step = math.pi / HEIGHT
    latitude, own = (0.5 - (y + 0.5) / HEIGHT) * math.pi, (0.5 - (row + 0.5) / HEIGHT) * math.pi
    cosine = np.sin(latitude) * math.sin(own) + np.cos(latitude) * math.cos(own) * np.cos((x - 80) * step)
    circle = np.arccos(np.clip(cosine, -1, 1)) <= RADIUS * step

    def moments(weights):
        total = weights.sum()
        return [math.sqrt((weights * (at - mid) ** 2).sum() / total) for at, mid in ((x, 80), (y, row))]

    assert moments(light) == pytest.approx(moments(circle.astype(float)), rel=0.15)


# Stereo


@pytest.mark.parametrize(("stereo", "axis"), [("side-by-side", 1), ("top-bottom", 0)])
def test_each_eye_is_rendered_alone(renderer, stereo, axis):
    """Authority: the render of each half."""
    result = rendered(renderer, SOFT, input={"stereo": stereo}).bokeh
    halves = [rendered(renderer, half).bokeh for half in np.split(SOFT, 2, axis=axis)]
    assert_allclose(result, np.concatenate(halves, axis=axis), atol=1e-6)


def test_half_of_a_pair_side_by_side_spans_the_sensor(renderer):
    """Authority: the same eye alone."""
    metres = np.full((HEIGHT, WIDTH), 2.0)
    camera = {"camera": {"focal_length": 50, "f_number": 2, "sensor_width": 36}, "focus": {"distance": 1.5}}
    alone = make_scene(SOFT[:, :80], MetricDepth(map=metres[:, :80]))
    pair = make_scene(SOFT, MetricDepth(map=metres))
    both = RenderSettings().updated(camera | {"input": {"stereo": "side-by-side"}})
    assert_allclose(
        renderer.render(pair, both).bokeh[:, :80],
        renderer.render(alone, RenderSettings().updated(camera)).bokeh,
        atol=1e-5,
    )


def test_layouts_and_known_edges_exclude_each_other(renderer):
    scene = make_scene(SOFT, ConstantDisparity(value=0), supersampled=2)
    with pytest.raises(ParameterError, match=r"input.stereo: expected flat or none"):
        renderer.render(scene, settings(input={"stereo": "top-bottom"}))
