"""A leaning plane of focus in ``bokehnet render``, used rightly and wrongly."""

import math

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.io.image import read_image, write_map
from bokehnet.io.maps import read_disparity, read_map
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.focus_plane import FocusPlane, plane_aberration_map

WIDTH, HEIGHT = 64, 40  # of the pictures in the folder
HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
FAST = ("--engine", "scatter")
EXACT = ("--repair-disparity", "off", "--mixed-depth", "off")  # the picture is noise, nothing to follow
MAP = ("render", "photo.png", "--disparity", "disparity.png", *EXACT)
RELATIVE = (*MAP, "--blur", 6)
CAMERA = ("--focal-length", 50, "--f-number", 2, "--sensor-width", 36)
METRIC = ("render", "photo.png", "--depth", "camera.exr", *CAMERA, *EXACT)
X, Y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))


def scatter_of(image, defocus, aperture=None):
    """Return the picture of the classical renderer."""
    return render_scatter(image, defocus, aperture).bokeh


@pytest.fixture
def defocus(folder, cli):
    """Run a command line that must succeed silently, and return the defocus map that it wrote."""

    def call(*arguments):
        outcome = cli(*arguments, *FAST, "-o", "out.exr", "--save-maps", "maps", "-q")
        assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
        return read_map("maps/defocus.exr")

    return call


@pytest.fixture
def steps():
    return read_disparity("disparity.png")  # relative, as the folder has it


def lens_equation(disparity, tilt, pixel, focus, pitch=36 / WIDTH):
    """Defocus by the thin lens equation along a tilted axis: where a pixel's rays meet, then R d / pitch.

    For both signs of the tilt this lens is traced in tests/reference/test_tilt_shift_render.py.
    """
    about_x, about_y = map(math.radians, tilt)
    axis = math.sin(about_y), -math.sin(about_x) * math.cos(about_y), math.cos(about_x) * math.cos(about_y)
    places = [pitch * (a - b) for a, b in zip(pixel, ((WIDTH - 1) / 2, (HEIGHT - 1) / 2), strict=True)]
    # 1 / z = axis . (place / d, 1) / f - 1 / d is solved for d at the pixel.
    distance = (1 - (axis[0] * places[0] + axis[1] * places[1]) / 50) / (axis[2] / 50 - focus)
    across, down = pitch * (X - (WIDTH - 1) / 2), pitch * (Y - (HEIGHT - 1) / 2)
    sharp = (axis[0] * across / distance + axis[1] * down / distance + axis[2]) / 50 - 1 / distance
    return 50 / 2 / 2 * distance / pitch * (disparity - sharp)


def test_no_tilt_changes_no_bit(folder, cli):
    pictures = []
    for options in ((), ("--tilt-x", 0, "--tilt-y", "0.0")):
        assert cli(*RELATIVE, "--focus", 0.4, *options, "-o", "out.exr").code == 0
        pictures.append((folder / "out.exr").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    ("options", "pixel", "focus"),
    [(("--focus", 0.4), (31.5, 19.5), 0.4), (("--focus-at", "50,9"), (50, 9), 1.0)],
)
def test_relative_focus_changes_by_the_tangent_across_the_picture(defocus, steps, options, pixel, focus):
    """Authority: the formula in ``relative_plane``, written out."""
    result = defocus(*RELATIVE, *options, "--tilt-x", -30, "--tilt-y", 20)
    sharp = focus + math.tan(math.radians(20)) / WIDTH * (X - pixel[0])
    sharp += math.tan(math.radians(30)) / HEIGHT * (Y - pixel[1])
    assert_allclose(result, 6 * (steps - sharp), atol=1e-5)


def test_three_pixels_are_sharp_and_all_of_their_plane(defocus, steps):
    result = defocus(*RELATIVE, "--focus-plane", "4,3", "30,30", "60,5")
    assert_allclose([result[3, 4], result[30, 30], result[5, 60]], 0, atol=1e-5)
    focus = steps - result / 6
    assert_allclose(np.diff(focus, 2, axis=0), 0, atol=1e-6)
    assert_allclose(np.diff(focus, 2, axis=1), 0, atol=1e-6)


@pytest.mark.parametrize("tilt", [(7, 0), (-7, 0), (0, 7), (4, -3)])
@pytest.mark.parametrize(
    ("options", "pixel", "focus"),
    [(("--focus-distance", 2), (31.5, 19.5), 1 / 2000), (("--focus-at", "30,5"), (30, 5), 0.4 / 1000)],
)
def test_metric_focus_is_that_of_the_tilted_lens(defocus, tilt, options, pixel, focus):
    """Authority: the thin lens equation along the axis of the lens."""
    result = defocus(*METRIC, *options, "--tilt-x", tilt[0], "--tilt-y", tilt[1])
    expected = lens_equation(1 / (1000 * read_map("camera.exr", "Z")), tilt, pixel, focus)
    assert_allclose(result, expected, rtol=1e-4, atol=1e-4)


def test_three_pixels_of_a_depth_map_tilt_the_lens(defocus, folder, write_channels):
    """Oracle: --tilt-x; a slanted wall that this tilt has in focus is picked, and all of it is sharp."""
    axis_y, axis_z = -math.sin(math.radians(-6)), math.cos(math.radians(-6))
    distance = 1 / (axis_z / 50 - 1 / 2000)
    sharp = (axis_y * 36 / WIDTH * (Y - 19.5) / distance + axis_z) / 50 - 1 / distance
    write_channels("wall.exr", Z=(1 / sharp / 1000).astype(np.float32))
    words = ("render", "photo.png", "--depth", "wall.exr", *CAMERA, *EXACT)
    assert np.abs(defocus(*words, "--focus-distance", 2, "--tilt-x", -6)).max() < 0.01
    assert np.abs(defocus(*words, "--focus-plane", "3,3", "60,9", "20,35")).max() < 0.01
    assert np.abs(defocus(*words, "--focus-distance", 2)).max() > 0.5
    # And what is not on the wall is blurred as by the lens of that tilt.
    wall = np.where(X > 50, 0.7, 1 / sharp / 1000).astype(np.float32)
    write_channels("wall.exr", Z=wall)
    by_tilt = defocus(*words, "--focus-distance", 2, "--tilt-x", -6)
    by_pixels = defocus(*words, "--focus-plane", "3,3", "40,9", "20,35")
    assert by_tilt.max() > 1
    assert_allclose(by_pixels, by_tilt, rtol=1e-3, atol=0.02)


def test_both_ends_of_a_focus_range_are_tilted(defocus, steps):
    result = defocus(*RELATIVE, "--focus-range", "0.6,0.2", "--tilt-y", 45)
    lean = (X - 31.5) / WIDTH
    expected = np.maximum(steps - 0.6 - lean, 0) + np.minimum(steps - 0.2 - lean, 0)
    assert_allclose(result, 6 * expected, atol=1e-5)
    assert (result == 0).any()


def test_pixels_are_those_of_the_shown_picture(folder, defocus):
    """Oracle: the same stored pixels without overscan, through a sensor that is wider by as much."""
    image = oiio.ImageBuf("camera.exr")
    spec = image.specmod()
    spec.x, spec.y, spec.full_x, spec.full_y = -8, -4, 0, 0
    spec.full_width, spec.full_height = WIDTH - 16, HEIGHT - 8
    assert image.write("overscan.exr")
    lens = ("--focal-length", 50, "--f-number", 2, *EXACT)
    over = ("render", "overscan.exr", "--depth", "overscan.exr", *lens, "--sensor-width", 36)
    plain = ("render", "camera.exr", "--depth", "camera.exr", *lens)
    wide = (*plain, "--sensor-width", 36 * WIDTH / (WIDTH - 16))
    for first, second in (
        (("--focus-at", "22,1", "--tilt-x", 5), ("--focus-at", "30,5", "--tilt-x", 5)),
        (("--focus-plane", "20,0", "40,0", "9,20"), ("--focus-plane", "28,4", "48,4", "17,24")),
    ):
        result = defocus(*over, *first)
        assert_allclose(result, defocus(*wide, *second), rtol=1e-4, atol=1e-4)
        assert np.ptp(result) > 0.5


def test_rays_make_the_discs_conic_and_the_scatter_leaves_them_round(folder, cli, steps):
    """Oracles: the engines called directly, the rays with the aberration map of the plane."""
    lean = ("--focus", 0.5, "--tilt-y", 60)
    plane = FocusPlane.around((31.5, 19.5), 0.5, (math.tan(math.radians(60)) / WIDTH, 0))
    picture = read_image("photo.png")
    defocus = (18 * (steps - plane.at(X, Y))).astype(np.float32)
    pictures = {}
    for engine in ("rays", "scatter"):
        assert cli(*MAP, "--blur", 18, *lean, "--engine", engine, "-o", "out.exr").code == 0
        pictures[engine] = read_image("out.exr")
    assert_allclose(pictures["scatter"], scatter_of(picture, defocus), rtol=HALF, atol=1e-4)
    conic = rays(picture, defocus, lens_response=LensResponse(aberration_map=plane_aberration_map(plane, 18)))
    near = np.isclose(pictures["rays"], conic, rtol=HALF, atol=1e-4)
    assert (~near).mean() < 0.002  # where rounding puts a step of the defocus beyond a threshold
    assert np.abs(conic - rays(picture, defocus)).max() > 0.02


def test_a_pull_moves_a_tilted_plane(folder, cli):
    """Oracle: the single frames. The last one is written as --focus-to says."""
    words = (*RELATIVE, *FAST, "--tilt-x", 25)
    pull = ("--frames", "1-3", "--focus-from", 0.2, "--focus-to", 0.8)
    assert cli(*words, *pull, "-o", "out.##.exr").code == 0
    for frame, focus in ((1, 0.2), (2, 0.5), (3, 0.8)):
        assert cli(*words, "--focus", focus, "-o", "single.exr").code == 0
        assert_array_equal(read_image("single.exr"), read_image(f"out.{frame:02d}.exr"))


def test_three_pixels_go_with_a_pull_of_the_blur(folder, cli):
    """The plane is found anew on the map of each frame."""
    for frame in (1, 2):
        write_map(f"z.{frame}.png", np.roll(read_map("disparity.png"), 5 * frame, axis=1))
    words = ("render", "photo.png", *EXACT, *FAST, "--focus-plane", "4,3", "30,30", "60,5")
    pull = ("--frames", "1-2", "--blur-from", 4, "--blur-to", 8, "--steady", "off")
    assert cli(*words, "--disparity", "z.#.png", *pull, "-o", "out.#.exr").code == 0
    for frame, blur in ((1, 4), (2, 8)):
        still = ("--disparity", f"z.{frame}.png", "--blur", blur, "-o", "single.exr")
        assert cli(*words, *still).code == 0
        assert_array_equal(read_image("single.exr"), read_image(f"out.{frame}.exr"))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--focus", 0.4, "--tilt-x", 85], ["error: --tilt-x: expected -80 to 80 degrees, got 85"]),
        (["--focus", 0.4, "--tilt-y", "nan"], ["error: --tilt-y: expected -80 to 80 degrees, got nan"]),
        (["--focus", 0.4, "--tilt-y", "much"], ["--tilt-y: expected -80 to 80 degrees, got 'much'"]),
        (
            ["--constant-disparity", 0.5, "--tilt-x", 5],
            ["got both"],
        ),
        (
            ["--focus-plane", "1,1", "2,2", "30,30"],
            ["--focus-plane: expected three pixels off one line"],
        ),
        (["--focus-plane", "1,1", "2,x", "3,9"], ["--focus-plane: expected two whole numbers X,Y", "'2,x'"]),
        (
            ["--focus-plane", "1,1", "9,2", "70,30"],
            ["--focus-plane: expected a pixel inside the picture of 64x40, got 70,30"],
        ),
        (
            ["--focus-plane", "1,1", "9,2", "4,9", "--tilt-x", 3],
            ["--focus-plane: expected three pixels, or --tilt-x and --tilt-y, got both"],
        ),
        (
            ["--focus-plane", "1,1", "9,2", "4,9", "--focus", 0.4],
            ["expected one of --focus and --focus-plane, got both; leave one out"],
        ),
    ],
)
def test_a_mistake_is_reported_with_the_name_of_the_option(fails, options, words):
    fails([*RELATIVE, *FAST, *options], *words)


def test_a_plane_tilted_beyond_all_rays_is_reported(fails):
    words = (*MAP, "--blur", 60, "--focus", 0.5, "--tilt-x", 45)
    fails(words, "error: --tilt-x: expected a defocus that changes by up to", "tilt less or blur less")


def test_impossible_lens_settings_are_reported(fails, write_channels):
    fails([*METRIC, "--focus-distance", 0.0501, "--tilt-x", 20], "tilted lens: cannot focus at 50.1 mm")
    # At the left 60 mm away, at the right 2 m: it passes far less than 50 mm beside the lens.
    write_channels("steep.exr", Z=np.where(X < 32, 0.06, 2).astype(np.float32))
    steep = ("render", "photo.png", "--depth", "steep.exr", *CAMERA, *EXACT)
    fails([*steep, "--focus-plane", "31,3", "31,30", "32,5"], "focus plane: no tilt of a lens of 50 mm")
