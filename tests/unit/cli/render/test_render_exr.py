"""``bokehnet render`` on EXR as compositors expect it: camera, alpha, units, other channels, windows."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity, read_map

WIDTH, HEIGHT = 64, 40  # of the pictures in the folder
FAST = ("--engine", "scatter", "--repair-disparity", "off")
DEPTH = ("render", "camera.exr", "--depth", "camera.exr", *FAST, "-o", "out.exr", "--save-maps", "maps")
LENS = ("--focal-length", 50, "--f-number", 2, "--sensor-width", 36)


def scatter_of(image, defocus, aperture=None):
    """Return the picture of the classical renderer."""
    return render_scatter(image, defocus, aperture).bokeh


@pytest.fixture
def defocus(folder, cli):
    """Run a command line that must succeed silently; the defocus of it."""

    def call(*arguments):
        outcome = cli(*arguments, "-q")
        assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
        return read_map("maps/defocus.exr")

    return call


def add_attributes(name, **attributes):
    """Write an EXR again with attributes in its header, without the code under test."""
    image = oiio.ImageBuf(name)
    for key, value in attributes.items():
        image.specmod().attribute(key, value)
    assert image.write(name)


def stored(name):
    image = oiio.ImageBuf(name)
    return dict(zip(image.spec().channelnames, np.moveaxis(image.get_pixels(oiio.FLOAT), 2, 0), strict=True))


def test_the_camera_in_the_file_fills_what_was_not_typed_and_options_win(defocus):
    """Oracle: the same numbers typed; focus is stored in metres, widths and lengths in mm."""
    expected = defocus(*DEPTH, *LENS, "--focus-distance", 1.5)
    stopped = defocus(*DEPTH, *LENS[:2], "--f-number", 4, *LENS[4:], "--focus-distance", 1.5)
    add_attributes("camera.exr", effectiveFocalLength=50.0, aperture=2.0, focus=1.5, cameraAperture=36.0)
    assert_allclose(defocus(*DEPTH), expected, rtol=1e-5)
    assert_allclose(defocus(*DEPTH, "--f-number", 4), stopped, rtol=1e-5)
    at_pixel = defocus(*DEPTH, "--focus-at", "30,5")
    assert at_pixel[5, 30] == pytest.approx(0, abs=1e-5)
    assert np.abs(at_pixel - expected).max() > 0.1


def test_the_camera_may_come_from_the_file_of_the_depth(defocus):
    expected = defocus(*DEPTH, *LENS, "--focus-distance", 1.5)
    add_attributes("camera.exr", effectiveFocalLength=50.0, aperture=2.0, focus=1.5, cameraAperture=36.0)
    result = defocus("render", "photo.png", *DEPTH[2:])
    assert_allclose(result, expected, rtol=1e-5)


def test_values_missing_in_the_file_are_assumed_and_stated(folder, cli):
    """Authority: a file without any camera is rendered on full frame at the aperture in the summary."""
    add_attributes("camera.exr", effectiveFocalLength=35.0)
    outcome = cli("render", "camera.exr", "--depth", "camera.exr", "-o", "out.exr", *FAST)
    assert outcome.code == 0, outcome.err
    assert "35 mm on full frame; f/" in outcome.err


@pytest.mark.parametrize(("unit", "factor"), [("cm", 100.0), ("ft", 1 / 0.3048), ("1/m", None)])
def test_depth_in_other_units(defocus, write_channels, unit, factor):
    expected = defocus(*DEPTH, *LENS, "--focus-distance", 1.5)
    metres = read_map("camera.exr", "Z")
    write_channels("z.exr", Z=1 / metres if factor is None else metres * np.float32(factor))
    words = ("render", "camera.exr", "--depth", "z.exr", "--depth-unit", unit, *DEPTH[4:], *LENS)
    assert_allclose(defocus(*words, "--focus-distance", 1.5), expected, rtol=1e-5)


def test_all_between_the_ends_of_a_focus_range_keeps_every_bit(folder, cli, write_channels):
    """Steps of depth at infinity, 2.5 m and 1 m; the range holds the last two, in either order."""
    words = ("render", "camera.exr", "--depth", "camera.exr", *FAST, "--save-maps", "maps", *LENS)
    results = []
    for ends in ("0.9,3", "3,0.9"):
        assert cli(*words, "-o", "out.exr", "--focus-range", ends).code == 0
        results.append(read_map("maps/defocus.exr"))
    defocus = results[0]
    assert_array_equal(*results)
    assert_array_equal(defocus[:, 20:], 0)
    assert cli(*words, "-o", "far.exr", "--focus-distance", 3).code == 0
    assert_allclose(defocus[:, :20], read_map("maps/defocus.exr")[:, :20], rtol=1e-6)
    reach = int(np.ceil(np.abs(defocus).max())) + 1
    assert_array_equal(read_image("out.exr")[:, 20 + reach :], read_image("camera.exr")[:, 20 + reach :])


def test_a_focus_range_of_relative_disparity(folder, cli):
    """Authority: blur times the distance of the disparity from the interval."""
    words = ("render", "photo.png", "--disparity", "disparity.png", *FAST, "--save-maps", "maps")
    assert cli(*words, "-o", "out.png", "--blur", 6, "--focus-range", "0.3,0.5").code == 0
    disparity = read_disparity("disparity.png")
    expected = 6 * (disparity - np.clip(disparity, 0.3, 0.5))
    assert_allclose(read_map("maps/defocus.exr"), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--blur", 6, "--focus-range", "0.3"], ["--focus-range: expected two numbers", "'0.3'"]),
        (["--blur", 6, "--focus-range", "0.3,nan"], ["--focus-range: expected two numbers"]),
        (["--blur", 6, "--focus-range", "0.3,1.5"], ["--focus-range", "0..1", "1.5"]),
        (
            ["--blur", 6, "--focus-range", "0.3,0.5", "--focus", 0.4],
            ["expected one of --focus and --focus-range, got both"],
        ),
        (["--blur", 6, "--focus", 0.4, "--disparity-range", "2,2"], ["two different numbers"]),
        (
            ["--blur", 6, "--focus", 0.4, "--depth-unit", "m"],
            ["--depth-unit: expected --depth for it to act on", "leave this out"],
        ),
        (["--blur", 6, "--focus", 0.4, "--mixed-depth", "maybe"], ["--mixed-depth", "auto, off, on"]),
        (
            ["--blur", 6, "--focus", 0.4, "--pixel-filter", "sinc"],
            ["--pixel-filter: expected auto, or one of box", "got 'sinc'"],
        ),
    ],
)
def test_mistakes_about_disparity(fails, arguments, words):
    fails(["render", "photo.png", "--disparity", "disparity.png", *FAST, *arguments], *words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--focus-range", "0,2"], ["--focus-range: expected metres above 0"]),
        (
            ["--focus-range", "0.03,2"],
            ["cannot focus at 0.03 m: expected more than 50 mm, the --focal-length"],
        ),
        (["--focus-distance", 2, "--depth-unit", "miles"], ["--depth-unit: expected one of", "miles"]),
        (["--focus-distance", -2], ["--focus-distance: expected metres above 0, got -2"]),
        (["--focus-distance", 2, "--invert"], ["--invert: expected --disparity for it to act on"]),
    ],
)
def test_mistakes_about_depth(fails, arguments, words):
    fails(["render", "photo.png", "--depth", "camera.exr", *LENS, *FAST, *arguments], *words)


def test_normalised_depth_is_inverted(folder, cli):
    """Authority: 1 - value is near-bright again."""
    words = ("render", "photo.png", *FAST, "--blur", 6, "--focus", 0.25, "--save-maps", "maps")
    assert cli(*words, "-o", "out.png", "--disparity", "disparity.png", "--invert").code == 0
    expected = 6 * (1 - read_disparity("disparity.png") - 0.25)
    assert_allclose(read_map("maps/defocus.exr"), expected, atol=1e-6)


def test_alpha_is_spread_as_the_light_is_and_other_channels_pass_through(folder, cli, write_channels):
    """Oracle: the scatter on a grey picture of alpha; premultiplied light has the same weights."""
    alpha = np.zeros((HEIGHT, WIDTH), np.float32)
    alpha[10:30, 24:40] = 1
    alpha[9, 24:40] = 0.5
    light = read_image("photo.png") * alpha[..., None]
    colours = dict(zip("RGB", np.moveaxis(light, 2, 0), strict=True))
    rng = np.random.default_rng(3)
    matte = rng.random((HEIGHT, WIDTH), dtype=np.float32)
    write_channels("layer.exr", **colours, A=alpha, Z=read_map("camera.exr", "Z"), matte=matte)
    words = ("render", "layer.exr", "--disparity", "disparity.png", *FAST, "--blur", 6, "--focus", 0)
    assert cli(*words, "-o", "out.exr", "--save-maps", "maps").code == 0
    before, after = stored("layer.exr"), stored("out.exr")
    assert set(after) == set(before)
    for name in ("Z", "matte"):
        assert_array_equal(after[name], before[name])
    defocus = read_map("maps/defocus.exr")
    expected = scatter_of(np.repeat(alpha[..., None], 3, -1), defocus)[..., 0]
    assert_allclose(after["A"], expected, atol=1e-6)
    assert_allclose(after["G"], scatter_of(light, defocus)[..., 1], atol=1e-6)
    assert after["A"][8, 30] > 0.01
    assert cli(*words, "-o", "out.png").code == 0
    assert oiio.ImageBuf("out.png").spec().nchannels == 4


def test_overscan_is_rendered_and_the_sensor_spans_the_shown_picture(folder, cli):
    """Oracle: the same pixels without overscan, through a sensor that is wider by as much."""
    image = oiio.ImageBuf("camera.exr")
    spec = image.specmod()
    spec.x, spec.y, spec.full_x, spec.full_y = -8, -4, 0, 0
    spec.full_width, spec.full_height = WIDTH - 16, HEIGHT - 8
    assert image.write("overscan.exr")
    words = ("--focal-length", 50, "--f-number", 2, "--save-maps", "maps", *FAST)
    over = ("render", "overscan.exr", "--depth", "overscan.exr", "-o", "out.exr", *words)
    assert cli(*over, "--sensor-width", 36, "--focus-at", "22,1").code == 0
    values = read_map("maps/defocus.exr")
    assert values.shape == (HEIGHT, WIDTH)
    plain = ("render", "camera.exr", "--depth", "camera.exr", "-o", "plain.exr", *words)
    assert cli(*plain, "--sensor-width", 36 * WIDTH / (WIDTH - 16), "--focus-at", "30,5").code == 0
    assert_allclose(values, read_map("maps/defocus.exr"), rtol=1e-5, atol=1e-6)
    written = oiio.ImageBuf("out.exr").spec()
    assert (written.x, written.y, written.full_width) == (-8, -4, WIDTH - 16)
    outcome = cli(*over, "--sensor-width", 36, "--focus-at", f"{WIDTH - 16},0")
    assert outcome.code == 1
    assert f"inside the picture of {WIDTH - 16}x{HEIGHT - 8}" in outcome.err


def test_mixed_depth_is_repaired_where_there_is_much_of_it(folder, cli, write_channels):
    """A column halfway in depth between two surfaces goes to one of them; "off" leaves it."""
    depth = np.full((HEIGHT, WIDTH), 2.0, np.float32)
    depth[:, 30:] = 8
    sharp = depth.copy()
    depth[:, 30] = 0.4 * 2 + 0.6 * 8
    write_channels("z.exr", Z=depth)
    words = ("render", "photo.png", "--depth", "z.exr", *FAST, *LENS, "--focus-distance", 2, "-o", "out.png")
    for mode, expected in (("auto", sharp), ("on", sharp), ("off", depth)):
        assert cli(*words, "--mixed-depth", mode, "--save-maps", "maps").code == 0
        defocus = read_map("maps/defocus.exr")
        assert_allclose(defocus, np.where(expected == 2, 0, defocus), atol=1e-5)
        radius = 50**2 / (2 * 1950) * (1 - 2 / expected) / 2 / (36 / WIDTH)  # c = f^2 (d - s) / (N (s - f) d)
        assert_allclose(-defocus, radius, atol=1e-4)


def test_a_picture_without_alpha_gets_none(folder, cli):
    write_image("plain.exr", read_image("photo.png"))
    words = ("render", "plain.exr", "--disparity", "disparity.png", *FAST, "--blur", 6, "--focus", 0)
    assert cli(*words, "-o", "out.exr").code == 0
    assert set(stored("out.exr")) == {"R", "G", "B"}
