"""``bokehnet render`` used rightly; what it says to mistakes is in test_render_mistakes.py."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter

from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.engine_registry import ENGINES
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.maps import read_disparity, read_map
from bokehnet.render.renderer import BokehRenderer

WIDTH, HEIGHT = 64, 40  # of the pictures in the folder
HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
CAMERA = ("--focal-length", 50, "--f-number", 2, "--sensor-width", 36)
SCATTER = ("--engine", "scatter")
EXACT = ("--repair-disparity", "off")  # the picture is noise, nothing to follow
RELATIVE = ("render", "photo.png", "--disparity", "disparity.png", *EXACT)
METRIC = ("render", "photo.png", "--depth", "camera.exr", *CAMERA, *EXACT)


def scatter_of(image, defocus, aperture=None):
    """Return the picture of the classical renderer."""
    return render_scatter(image, defocus, aperture).bokeh


@pytest.fixture
def rendered(folder, cli):
    """Run a command line that must succeed silently, and return the picture and the defocus map it wrote."""

    def call(*arguments):
        outcome = cli(*arguments, *SCATTER, "-o", "out.exr", "--save-maps", "maps", "-q")
        assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
        return read_image("out.exr"), read_map("maps/defocus.exr")

    return call


def textbook_defocus(metres, focus):
    """Signed radius, pixels, of a thin lens, 50 mm at f/2; c = f^2 |d - s| / (N d (s - f)); sky its limit."""
    share = np.where(np.isinf(metres), 1.0, (metres - focus) / np.where(np.isinf(metres), 1.0, metres))
    return -(50.0**2) * share / (2 * (1000 * focus - 50)) / 2 / (36 / WIDTH)


def test_disparity_blur_and_focus_give_the_scatter_of_the_bokehme_formula(rendered):
    """Oracle: defocus = blur * (disparity - focus), Peng et al. 2022, into the scatter renderer."""
    bokeh, defocus = rendered(*RELATIVE, "--blur", 6, "--focus", 0.4)
    expected = (6 * (read_disparity("disparity.png") - 0.4)).astype(np.float32)
    assert_allclose(defocus, expected, atol=1e-6)
    assert_allclose(bokeh, scatter_of(read_image("photo.png"), expected), rtol=HALF, atol=1e-5)


@pytest.mark.parametrize(("pixel", "focus"), [("0,0", 0.0), ("30,5", 102 / 255), ("63, 39", 1.0)])
def test_focus_at_equals_focus_on_the_value_of_that_pixel(rendered, pixel, focus):
    by_pixel = rendered(*RELATIVE, "--blur", 6, "--focus-at", pixel)
    by_value = rendered(*RELATIVE, "--blur", 6, "--focus", focus)
    for result, expected in zip(by_pixel, by_value, strict=True):
        assert_allclose(result, expected, rtol=2 * HALF, atol=1e-5)


@pytest.mark.parametrize("focus", [1.0, 3.0])
def test_depth_and_camera_give_the_textbook_circle_of_confusion_in_pixels(rendered, focus):
    """Authority: c = f^2 |d - s| / (N d (s - f)) halved over the pixel pitch; sky is its limit."""
    _, defocus = rendered(*METRIC, "--focus-distance", focus)
    assert_allclose(defocus, textbook_defocus(read_map("camera.exr", "Z"), focus), rtol=1e-5, atol=1e-5)


def test_focus_at_on_a_depth_map_equals_the_focus_distance_of_that_pixel(rendered):
    _, defocus = rendered(*METRIC, "--focus-at", "30,5")
    metres = read_map("camera.exr", "Z")
    assert_allclose(defocus, textbook_defocus(metres, float(metres[5, 30])), rtol=1e-5, atol=1e-5)


def test_focus_at_on_the_sky_focuses_at_infinity(rendered):
    """Authority: the limit c = f^2 / (N d) of the textbook formula for s to infinity."""
    _, defocus = rendered(*METRIC, "--focus-at", "0,0")
    metres = read_map("camera.exr", "Z")
    assert_allclose(defocus, 50**2 / (2 * 1000 * metres) / 2 / (36 / WIDTH), rtol=1e-5, atol=1e-6)


def test_channel_picks_the_map(rendered):
    _, defocus = rendered(*METRIC, "--channel", "far", "--focus-distance", 1)
    assert_allclose(defocus, textbook_defocus(read_map("camera.exr", "Z") + 2, 1.0), rtol=1e-5, atol=1e-5)


def test_picture_and_depth_may_come_from_one_exr(rendered):
    bokeh, _ = rendered("render", "camera.exr", "--depth", "camera.exr", *CAMERA, "--focus-distance", 1)
    assert bokeh.shape == (HEIGHT, WIDTH, 3)


def test_resize_disparity_brings_a_smaller_map_to_the_picture(rendered):
    """The steps of the map lie on even pixels, so the half-size map says the same as the full one."""
    write_map("small.png", read_map("disparity.png")[::2, ::2])
    small = ("render", "photo.png", "--disparity", "small.png", "--resize-disparity", *EXACT)
    _, defocus = rendered(*small, "--blur", 6, "--focus", 0.4)
    _, expected = rendered(*RELATIVE, "--blur", 6, "--focus", 0.4)
    assert_allclose(defocus, expected, atol=1e-6)


def test_resize_disparity_keeps_an_infinite_sky_of_a_depth_map(rendered, write_channels):
    """Infinity cannot be interpolated as depth; as disparity it is 0."""
    write_channels("small.exr", Z=read_map("camera.exr", "Z")[::2, ::2])
    small = ("render", "photo.png", "--depth", "small.exr", *CAMERA, "--resize-disparity", *EXACT)
    _, defocus = rendered(*small, "--focus-distance", 3)
    assert_allclose(defocus, textbook_defocus(read_map("camera.exr", "Z"), 3.0), rtol=1e-5, atol=1e-5)


def test_what_is_in_focus_and_out_of_reach_of_blur_keeps_every_bit(folder, cli):
    """Focus on the middle step, columns 20 to 43; its neighbours blur by at most 3 pixels."""
    outcome = cli(*RELATIVE, "--blur", 5, "--focus-at", "30,5", "-o", "out.png", *SCATTER)
    assert outcome.code == 0
    before, after = (read_image(name) for name in ("photo.png", "out.png"))
    assert_array_equal(after[:, 24:40], before[:, 24:40])
    assert np.abs(after - before)[:, :16].mean() > 0.05


def test_no_blur_gives_the_picture_back(folder, cli):
    assert cli(*RELATIVE, "--blur", 0, "--focus", 0, "-o", "out.png", *SCATTER).code == 0
    assert_array_equal(read_image("out.png"), read_image("photo.png"))


@pytest.mark.parametrize("engine", ["scatter", "fast"])
def test_a_blur_larger_than_the_picture_is_fine(folder, cli, random_weights, engine):
    """A disc over the whole picture, and normalised: the result lies between the extremes of the input."""
    weights = ("--weights", random_weights) if engine == "fast" else ()
    options = ("--engine", engine, *weights, "--save-maps", "maps")
    assert cli(*RELATIVE, "--blur", 5000, "--focus", 0.7, "-o", "out.exr", *options).code == 0
    classical, before = read_image("maps/classical.png"), read_image("photo.png")
    assert classical.std(axis=(0, 1)).max() < before.std(axis=(0, 1)).min() / 4
    assert before.min() <= classical.min() <= classical.max() <= before.max()


def test_an_engine_with_networks_writes_what_the_renderer_gives_and_all_maps(folder, cli, random_weights):
    """Oracle: BokehRenderer, which has its own tests, called directly."""
    fast = ("--engine", "fast", "--weights", random_weights, "--save-maps", "deep/maps")
    outcome = cli(*RELATIVE, "--blur", 6, "--focus", 0.4, "-o", "out.exr", *fast, "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    image, disparity = read_image("photo.png"), read_disparity("disparity.png")
    expected = BokehRenderer("fast", weights=random_weights).render_arrays(
        image, 6 * (disparity - np.float32(0.4))
    )
    assert_allclose(read_image("out.exr"), expected.bokeh, rtol=HALF, atol=1e-5)
    maps = folder / "deep" / "maps"
    names = {"classical.png", "defocus.exr", "defocus.png", "error_map.png", "neural.png", "settings.toml"}
    assert {path.name for path in maps.iterdir()} == names
    assert_allclose(read_map(maps / "error_map.png"), expected.error_map, atol=0.5 / 255 + 1e-6)
    grey = 0.5 + 0.5 * read_map(maps / "defocus.exr") / 3.6  # the largest radius is 6 * 0.6
    assert_allclose(read_map(maps / "defocus.png"), grey, atol=0.5 / 255 + 1e-6)


def test_max_memory_renders_in_strips_to_the_same_picture(folder, cli, monkeypatch):
    """Oracle: the whole picture at once, which needs 2 MB (70 bytes a pixel)."""
    monkeypatch.setattr("bokehnet.render.exposure.memory_bounds.PROGRAM", 0)
    tall = np.random.default_rng(1).random((600, 48, 3), dtype=np.float32)
    write_image("tall.png", tall)
    write_map("tall_map.png", np.linspace(0, 1, 600 * 48).reshape(600, 48))
    words = (
        "render",
        "tall.png",
        "--disparity",
        "tall_map.png",
        *EXACT,
        *SCATTER,
        "--blur",
        6,
        "--focus",
        0.4,
    )
    assert cli(*words, "-o", "whole.exr").code == 0
    assert cli(*words, "-o", "strips.exr", "--max-memory", "1.9M").code == 0
    assert_allclose(read_image("strips.exr"), read_image("whole.exr"), rtol=2 * HALF, atol=1e-5)
    assert "--max-memory: expected at least" in cli(*words, "-o", "out.exr", "--max-memory", "20k").err
    assert "--max-memory: expected a size such as" in cli(*words, "-o", "out.exr", "--max-memory", "much").err


def test_scatter_has_no_neural_half_to_save(folder, cli):
    assert cli(*RELATIVE, "--blur", 6, "--focus", 0, "-o", "a.jpg", *SCATTER, "--save-maps", "maps").code == 0
    names = {"classical.png", "defocus.exr", "defocus.png", "error_map.png", "settings.toml"}
    assert {path.name for path in (folder / "maps").iterdir()} == names


def test_the_program_renders_in_a_process_of_its_own(folder, cli_process):
    photo, disparity, output = (folder / name for name in ("photo.png", "disparity.png", "out.png"))
    words = ("render", photo, "--disparity", disparity, "--blur", 6, "--focus", 0.4, "-o", output)
    outcome = cli_process(*words, *SCATTER)
    assert (outcome.code, outcome.out) == (0, "")
    assert outcome.err.splitlines()[-1].startswith(f"bokehnet: {output}: 64x40, scatter, focus at 0.4, ")
    assert read_image(output).shape == (HEIGHT, WIDTH, 3)
    outcome = cli_process(*words, "--engine", "magic")
    assert (outcome.code, outcome.out) == (1, "")
    engines = ", ".join(sorted(ENGINES))
    message = f"bokehnet: error: --engine: expected one of {engines}, got 'magic'"
    assert outcome.err == f"{message}; see bokehnet render --help engine\n"


@pytest.mark.parametrize("name", ["jimenez", "bokehme_scatter"])
def test_a_method_of_the_literature_is_no_engine_of_render(folder, cli, name):
    outcome = cli("render", "photo.png", "--disparity", "disparity.png", "--engine", name, "-o", "out.png")
    assert outcome.code == 1
    assert f"a method of the literature: bokehnet compare --engines rays,{name} runs it;" in outcome.err
    assert not (folder / "out.png").exists()


def test_refine_disparity_sharpens_soft_edges_before_focus_is_taken(folder, rendered):
    """Oracle: the repair by hand, which has its own tests; "off" leaves the map as it is."""
    soft = gaussian_filter(read_disparity("disparity.png"), 2.0).astype(np.float32)
    write_map("soft.exr", soft)
    words = ("render", "photo.png", "--disparity", "soft.exr", "--blur", 6, "--focus-at", "10,10")
    original = read_disparity("soft.exr")
    refined = DisparityRepair()(read_image("photo.png"), original)
    assert np.abs(refined - original).max() > 0.1
    decided = DisparityRepair()(read_image("photo.png"), original, "auto")
    for mode, values in (("off", original), ("on", refined), ("auto", decided)):
        _, defocus = rendered(*words, "--repair-disparity", mode)
        assert_allclose(defocus, 6 * (values - values[10, 10]), atol=1e-4)  # focus: median of a patch


def test_without_output_the_result_is_next_to_the_picture_and_never_replaces_a_file(folder, cli):
    """Rule: photo_bokeh.png, then photo_bokeh_2.png; the same picture as with -o."""
    words = (*RELATIVE, *SCATTER, "--blur", 6, "--focus", 0.4, "-q")
    for again in ((), ("--overwrite",)):  # a named output is replaced in any case
        assert cli(*words, "-o", "wanted.png", *again).code == 0
    for name in ("photo_bokeh.png", "photo_bokeh_2.png"):
        before = {path.name: path.read_bytes() for path in folder.iterdir()}
        assert cli(*words).code == 0
        after = {path.name: path.read_bytes() for path in folder.iterdir()}
        assert after.pop(name) == before["wanted.png"]
        assert after == before
