"""The options of ``bokehnet render`` that weigh light, used rightly and wrongly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.engines.options import RenderOptions
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from bokehnet.light.recovery import recover_light
from bokehnet.optics.tone import Highlights
from bokehnet.render.renderer import BokehRenderer

HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
EXACT = ["--repair-disparity", "off"]  # the picture is noise, nothing to follow
WORDS = ["render", "photo.png", "--disparity", "disparity.png", "--blur", 9, "--focus", 0.4, *EXACT]
SCATTER = [*WORDS, "--engine", "scatter"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--gamma", 2.5], {"gamma": 2.5}),
        (["--highlights", 0.7], {"highlights": Highlights(threshold=0.7)}),
        (["--highlights", 0.7, "--highlight-gain", 20], {"highlights": Highlights(threshold=0.7, gain=20)}),
        (
            ["--gamma", 0.5, "--highlights", 0, "--highlight-gain", 3],
            {"gamma": 0.5, "highlights": Highlights(threshold=0, gain=3)},
        ),
    ],
)
def test_options_are_those_of_the_renderer(folder, cli, options, expected):
    """Oracle: BokehRenderer, which has its own tests, called directly."""
    outcome = cli(*SCATTER, *options, "-o", "out.exr", "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    image, disparity = read_image("photo.png"), read_disparity("disparity.png")
    defocus = 9 * (disparity - np.float32(0.4))
    plain = BokehRenderer("scatter").render_arrays(image, defocus).bokeh
    bokeh = BokehRenderer("scatter").render_arrays(image, defocus, options=RenderOptions(**expected)).bokeh
    assert_allclose(read_image("out.exr"), bokeh, rtol=HALF, atol=1e-5)
    assert np.abs(bokeh - plain).max() > 0.02


def test_gamma_1_and_no_highlights_change_no_bit(folder, cli):
    pictures = []
    for options in ([], ["--gamma", 1]):
        assert cli(*SCATTER, *options, "-o", "out.exr").code == 0
        pictures.append((folder / "out.exr").read_bytes())
    assert pictures[0] == pictures[1]


def test_highlights_are_kept_by_exr_and_clipped_by_png(folder, cli):
    """A sharp white picture: the gain is in the EXR, the PNG stays white."""
    write_image("photo.png", np.ones((40, 64, 3)))
    for name, expected in (("out.exr", 6.0), ("out.png", 1.0)):
        assert cli(*SCATTER, "--highlights", 0.8, "--highlight-gain", 6, "-o", name).code == 0
        assert_allclose(read_image(name), expected, rtol=1e-3)


def test_an_engine_with_networks_takes_highlights(folder, cli, random_weights):
    fast = [*WORDS, "--engine", "fast", "--weights", random_weights]
    assert cli(*fast, "--highlights", 0.7, "-o", "out.exr", "--save-maps", "maps").code == 0
    assert cli(*SCATTER, "--highlights", 0.7, "-o", "scatter.png").code == 0
    assert_array_equal(read_image("maps/classical.png"), read_image("scatter.png"))


@pytest.mark.parametrize("look", [("--onion", 1), ("--cats-eye", 1)])
def test_recovered_lamps_are_drawn_like_lamps_of_known_light(folder, cli, look):
    """Oracle: the render of a picture that holds the recovered light, without any recovery."""
    picture = 0.003 * (1 + np.random.default_rng(0).random((40, 64, 3)))
    picture[6:9, 6:9] = picture[20:23, 40:43] = 1
    write_image("photo.png", picture)
    write_image("disparity.png", np.full((40, 64, 3), 0.02))
    recovered = recover_light(read_image("photo.png"), read_disparity("disparity.png"))
    write_image("light.exr", recovered.image)
    assert recovered.largest > 4
    assert cli(*WORDS, *look, "-o", "auto.exr").code == 0
    assert cli(*WORDS[:1], "light.exr", *WORDS[2:], *look, "-o", "known.exr").code == 0
    assert cli(*WORDS, "-o", "plain.exr").code == 0
    auto, known, plain = (read_image(f"{name}.exr") for name in ("auto", "known", "plain"))
    assert_allclose(auto, known, rtol=0.02, atol=1e-3)
    assert np.abs(auto - plain).max() > 0.05


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--gamma", 0.1], ["error: --gamma: expected 0.2 to 5", "got 0.1"]),
        (["--gamma", 6], ["--gamma", "got 6"]),
        (["--gamma", "nan"], ["--gamma", "nan"]),
        (["--gamma", "high"], ["--gamma: expected 0.2 to 5, got 'high'"]),
        (
            ["--highlights", 1],
            ["error: --highlights: expected auto, off, or at least 0 and below 1, got '1'"],
        ),
        (["--highlights", -0.5], ["--highlights", "-0.5"]),
        (["--highlights", "nan"], ["--highlights", "nan"]),
        (["--highlights", "of"], ["--highlights: expected auto, off, or at least 0 and below 1, got 'of'"]),
        (
            ["--highlights", "off", "--highlight-strength", 2],
            ["--highlight-strength: expected --highlights auto for it to act on, got 2"],
        ),
        (
            ["--highlights", 0.9, "--highlight-gain", 0.5],
            ["--highlight-gain: expected a number of at least 1, got 0.5"],
        ),
        (["--highlights", 0.9, "--highlight-gain", "inf"], ["--highlight-gain", "finite"]),
        (
            ["--highlight-gain", 4],
            ["--highlight-gain: expected a number as --highlights for it to act on, got 4"],
        ),
    ],
)
def test_a_mistake_is_reported_with_the_name_of_the_option(fails, options, words):
    fails([*SCATTER, *options], *words)


def test_gamma_is_beyond_networks(fails, random_weights):
    fast = [*WORDS, "--engine", "fast", "--weights", random_weights]
    fails(
        [*fast, "--gamma", 2.2, "--save-maps", "maps"],
        "--gamma: expected 1",
        "got 2.2",
        "use the engine scatter",
    )
