"""The options of ``bokehnet render`` for the character of the lens, used rightly and wrongly."""

import math
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.seidel_lens import seidel_aberration_map
from bokehnet.lenses.thin import ThinLens
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.render.renderer import BokehRenderer

HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
EXACT = ["--repair-disparity", "off", "--engine", "rays"]  # the picture is noise, nothing to follow
PHOTO = ["render", "photo.png", "--disparity", "disparity.png", "--blur", 9, "--focus", 0.4, *EXACT]
CAMERA = ["--focal-length", 50, "--f-number", 2.2, "--sensor-width", 12, "--focus-distance", 2]
SCENE = ["render", "camera.exr", "--depth", "camera.exr", "--mixed-depth", "off", *EXACT, *CAMERA]


@pytest.fixture(scope="module")
def cache_folder(tmp_path_factory):
    """Maps of lenses are made here once, and kept where nothing else looks."""
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def own_cache(cache_folder, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache_folder))


@cache
def double_gauss_map(make, f_number=None, distortion=False):
    return make(load_lens("double_gauss", f_number=f_number), distortion=distortion)


def assert_rendered_through(cli, words, defocus, aberration_map):
    """Oracle: the renderer, which has its own tests, with that aberration map."""
    even = ["--no-lens-vignetting"] if "--lens" in words else []
    outcome = cli(*words, *even, "-o", "out.exr", "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    image = read_image(words[1])
    plain = BokehRenderer("rays").render_arrays(image, defocus).bokeh
    bokeh = (
        BokehRenderer("rays", lens_response=LensResponse(aberration_map=aberration_map))
        .render_arrays(image, defocus)
        .bokeh
    )
    assert_allclose(read_image("out.exr"), bokeh, rtol=HALF, atol=1e-5)
    assert np.abs(bokeh - plain).max() > 0.02


def photo_defocus():
    return (9 * (read_disparity("disparity.png") - 0.4)).astype(np.float32)


@pytest.mark.parametrize(
    ("options", "sliders"),
    [
        (["--spherical", 3], {"spherical": 3}),
        (["--coma", -8], {"coma": -8}),
        (["--astigmatism", 6], {"astigmatism": 6}),
        (["--field-curvature", -6], {"field_curvature": -6}),
        (["--coma", 5, "--spherical", 40], {"coma": 5, "spherical": 40}),
    ],
)
def test_sliders_set_their_aberration(folder, cli, options, sliders):
    aberration_map = AberrationSliders(**sliders).aberration_map()
    assert_rendered_through(cli, [*PHOTO, *options], photo_defocus(), aberration_map)


def test_sliders_at_0_change_no_bit(folder, cli):
    off = ["--spherical", 0, "--coma", 0, "--astigmatism", 0, "--field-curvature", 0]
    pictures = []
    for options in ([], off):
        assert cli(*PHOTO, *options, "-o", "out.exr").code == 0
        pictures.append((folder / "out.exr").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "make", "numbers"),
    [
        ([], fit_aberration_map, {}),
        (["--aberrations", "traced"], fit_aberration_map, {}),
        (["--aberrations", "seidel"], seidel_aberration_map, {}),
        (["--lens-f-number", 4], fit_aberration_map, {"f_number": 4.0}),
        (["--lens-distortion", "--aberrations", "seidel"], seidel_aberration_map, {"distortion": True}),
    ],
)
def test_with_disparity_the_lens_is_the_one_designed(folder, cli, options, make, numbers):
    words = [*PHOTO, "--lens", "double_gauss", *options]
    assert_rendered_through(cli, words, photo_defocus(), double_gauss_map(make, **numbers))


@pytest.mark.slow
@pytest.mark.parametrize(("options", "f_number"), [([], 2.2), (["--lens-f-number", 2.5], 2.5)])
def test_with_depth_the_lens_has_the_numbers_of_the_camera(folder, cli, read_metres, options, f_number):
    lens = load_lens("petzval", focal_length=50.0, f_number=f_number, focus_distance=2000.0)
    aberration_map = fit_aberration_map(lens, half_diagonal=0.5 * math.hypot(12, 12 * 40 / 64))
    thin = ThinLens(focal_length=50.0, f_number=2.2, focus_distance=2000.0)
    defocus = (thin.coc_radius(1 / (1000 * read_metres())) / (12 / 64)).astype(np.float32)
    assert_rendered_through(cli, [*SCENE, "--lens", "petzval", *options], defocus, aberration_map)


@pytest.mark.slow
def test_a_lens_darkens_the_corners_by_default(folder, cli):
    """Authority: the light of the traced lens, which has its own test, at the place of each pixel."""
    outcomes = [
        cli(*PHOTO, "--lens", "petzval", *words, "-o", f"{len(words)}.exr", "-q")
        for words in ([], ["--no-lens-vignetting"])
    ]
    assert [outcome.code for outcome in outcomes] == [0, 0]
    darkened, even = read_image("0.exr"), read_image("1.exr")
    lens = load_lens("petzval")
    light = relative_illumination(lens, lens.prescription.image_radius)
    place = np.stack(np.meshgrid(np.arange(64) - 31.5, np.arange(40) - 19.5), -1)
    radius = np.hypot(*np.moveaxis(place, -1, 0)) / math.hypot(32, 20)
    expected = even * np.interp(radius, np.linspace(0, 1, 33), light)[..., None]
    assert_allclose(darkened, expected, rtol=2 * HALF, atol=1e-5)
    assert (darkened[0, 0] < 0.8 * even[0, 0]).all()


@pytest.fixture
def read_metres(folder):
    """Depth of camera.exr as conftest draws it."""

    def read():
        disparity = np.zeros((40, 64))
        disparity[:, 20:] = 102 / 255
        disparity[:, 44:] = 1
        return np.where(disparity == 0, np.inf, 1 / np.maximum(disparity, 0.1))

    return read


@pytest.mark.slow
def test_the_lens_adds_to_sliders_and_to_a_leaning_focus(folder, cli):
    """Three sources of one map: each of them changes the picture."""
    words = [*PHOTO, "--lens", "petzval"]
    pictures = []
    for options in ([], ["--astigmatism", 8], ["--tilt-x", 60], ["--astigmatism", 8, "--tilt-x", 60]):
        assert cli(*words, *options, "-o", "out.exr").code == 0
        pictures.append(read_image("out.exr"))
    for i, first in enumerate(pictures):
        for second in pictures[:i]:
            assert np.abs(first - second).max() > 0.02


@pytest.mark.slow
def test_frames_of_a_pull_take_the_lens_as_it_is_focused_then(folder, cli):
    """Frames 1 and 3 are those of single renders with the numbers of the ends."""
    words = [word for word in SCENE if word not in ("--f-number", 2.2)]
    words += ["--lens", "double_gauss"]
    pull = ["--frames", "1-3", "--f-number-from", 2, "--f-number-to", 8, "-o", "pull.#.exr"]
    outcome = cli(*words, *pull)
    assert outcome.code == 0, outcome.err
    for frame, f_number in ((1, 2), (3, 8)):
        assert cli(*words, "--f-number", f_number, "-o", "out.exr").code == 0
        assert_allclose(read_image(f"pull.{frame}.exr"), read_image("out.exr"), rtol=0, atol=0)
    assert np.abs(read_image("pull.1.exr") - read_image("pull.3.exr")).max() > 0.05


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--lens", "nikkor"], ["--lens: unknown lens 'nikkor'", ".toml", "double_gauss"]),
        (["--lens", "missing.toml"], ["missing.toml"]),
        (["--lens", "petzval", "--lens-f-number", 1.2], ["--lens: Petzval: f-number", "1.93 or more"]),
        (
            ["--lens", "petzval", "--lens-f-number", "nan"],
            ["--lens-f-number: expected a finite number above 0, got nan"],
        ),
        (["--lens", "petzval", "--aberrations", "zemax"], ["--aberrations: expected one of seidel, traced"]),
        (["--aberrations", "seidel"], ["--aberrations: expected --lens for it to act on", "leave this out"]),
        (
            ["--lens-distortion", "--lens-f-number", 4],
            ["--lens-distortion: expected --lens for it to act on"],
        ),
        (["--lens", "petzval", "--engine", "scatter"], ["--lens: expected --engine rays or hybrid"]),
        (["--coma", 3, "--engine", "scatter"], ["--coma: expected --engine rays or hybrid", "scatter"]),
        (["--spherical", 101], ["--spherical: expected -100 to 100 percent", "101"]),
        (["--field-curvature", "inf"], ["--field-curvature: expected -100 to 100 percent, got inf"]),
        (["--dispersion", "rgb", "--coma", 3], ["--dispersion", "--lens"]),
    ],
)
def test_mistakes_are_one_clear_line(fails, options, words):
    fails([*PHOTO, *options], *words)


@pytest.mark.parametrize(
    ("lens", "changed", "words"),
    [
        ("petzval", {"--f-number": 1.4}, ["--lens: Petzval: f-number", "--lens-f-number"]),
        (
            "telephoto",
            {"--f-number": 8, "--focus-distance": 0.051},
            ["--lens: Telephoto: cannot focus at 51"],
        ),
        ("petzval", {"--sensor-width": 300}, ["--lens: "]),
    ],
)
def test_a_camera_that_the_lens_cannot_follow_is_reported(fails, lens, changed, words):
    numbers = dict(zip(CAMERA[::2], CAMERA[1::2], strict=True)) | changed
    camera = [word for pair in numbers.items() for word in pair]
    fails([*SCENE[: -len(CAMERA)], *camera, "--lens", lens], *words)


def test_a_lens_file_that_is_wrong_is_reported(folder, fails):
    (folder / "bad.toml").write_text('name = "Bad"\n')
    fails([*PHOTO, "--lens", "bad.toml"], "bad.toml")
