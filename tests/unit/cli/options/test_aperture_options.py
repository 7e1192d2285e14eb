"""The options of ``bokehnet render`` that shape the lens opening, used rightly and wrongly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.io.color.srgb import luminance
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.aperture import Aperture

HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
EXACT = ["--repair-disparity", "off"]  # the picture is noise, nothing to follow
WORDS = ["render", "photo.png", "--disparity", "disparity.png", "--blur", 9, "--focus", 0.4, *EXACT]
SCATTER = [*WORDS, "--engine", "scatter"]


def scatter_of(image, defocus, aperture=None):
    """Return the picture of the classical renderer."""
    return render_scatter(image, defocus, aperture).bokeh


@pytest.fixture
def letter(folder):
    """A picture of an F in colours, letter.png, and its transmission by the Rec.709 formula."""
    grey = np.zeros((16, 12))
    grey[3:13, 3:5] = grey[3:5, 3:9] = grey[7:9, 3:7] = 1
    colours = grey[..., None] * np.array([0.9, 0.5, 0.2])
    write_image("letter.png", colours)
    return read_image("letter.png") @ np.array([0.2126, 0.7152, 0.0722])


def assert_rendered_with(cli, options, aperture):
    """Oracle: the scatter renderer with that aperture, which has its own tests."""
    outcome = cli(*SCATTER, *options, "-o", "out.exr", "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    defocus = (9 * (read_disparity("disparity.png") - 0.4)).astype(np.float32)
    image = read_image("photo.png")
    assert_allclose(read_image("out.exr"), scatter_of(image, defocus, aperture), rtol=HALF, atol=1e-5)
    if not aperture.is_disc:
        assert np.abs(read_image("out.exr") - scatter_of(image, defocus)).max() > 0.01


@pytest.mark.parametrize(
    ("options", "aperture"),
    [
        ([], Aperture()),
        (["--blades", 0], Aperture()),
        (["--blades", 6], Aperture(blades=6)),
        (["--blades", 5, "--blade-curvature", 0.4], Aperture(blades=5, curvature=0.4)),
        (["--blades", 5, "--aperture-rotation", -30], Aperture(blades=5, rotation=-30)),
        (["--squeeze", 0.5], Aperture(squeeze=0.5)),
        (["--cats-eye", 0.8], Aperture(cats_eye=0.8)),
        (["--rim", 0.9], Aperture(spherical_profile=0.9)),
        (["--obstruction", 0.5], Aperture(obstruction=0.5)),
        (["--onion", 0.8, "--onion-rings", 3], Aperture(onion=0.8, onion_rings=3)),
        (["--disc-grain", 1, "--disc-grain-seed", 5], Aperture(grain=1, grain_seed=5)),
        (
            ["--blades", 7, "--rim", -0.5, "--squeeze", 1.5],
            Aperture(blades=7, spherical_profile=-0.5, squeeze=1.5),
        ),
    ],
)
def test_each_option_sets_its_part_of_the_aperture(folder, cli, options, aperture):
    assert_rendered_with(cli, options, aperture)


def test_a_picture_of_the_aperture_counts_by_its_luminance_in_linear_light(letter, cli):
    assert_rendered_with(cli, ["--aperture-image", "letter.png"], Aperture(picture=letter))
    turned = ["--aperture-image", "letter.png", "--aperture-rotation", 90]
    assert_rendered_with(cli, turned, Aperture(picture=letter, rotation=90))


def test_luminance_is_that_of_rec_709():
    """Authority: ITU-R BT.709: weights of the primaries, which add up to white."""
    assert_allclose(luminance(np.eye(3)), [0.2126, 0.7152, 0.0722])
    assert luminance(np.ones(3)) == pytest.approx(1)


def test_the_rays_take_the_aperture_too(folder, cli):
    pictures = []
    for options in ([], ["--blades", 4]):
        assert cli(*WORDS, *options, "-o", "out.exr").code == 0
        pictures.append(read_image("out.exr"))
    assert np.abs(pictures[1] - pictures[0]).max() > 0.01


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--blades", 2], ["error: --blades: expected 0 (disc) or 3 to 16, got 2"]),
        (["--blades", 17], ["--blades", "got 17"]),
        (["--blades", "six"], ["--blades: expected 0 (disc) or 3 to 16, got 'six'"]),
        (["--blades", 5, "--blade-curvature", 1.1], ["--blade-curvature: expected 0 to 1, got 1.1"]),
        (["--blades", 5, "--blade-curvature", "nan"], ["--blade-curvature", "nan"]),
        (
            ["--blade-curvature", 0.5],
            ["--blade-curvature: expected --blades for it to act on", "leave this out"],
        ),
        (
            ["--blades", 0, "--blade-curvature", 0],
            ["--blade-curvature: expected --blades for it to act on", "leave this out"],
        ),
        (
            ["--aperture-rotation", 15],
            ["--aperture-rotation: expected --blades or --aperture-image for it to act on", "no direction"],
        ),
        (["--blades", 5, "--aperture-rotation", "inf"], ["--aperture-rotation", "finite"]),
        (["--squeeze", 0], ["--squeeze", "0.1 to 10", "got 0"]),
        (["--cats-eye", -0.1], ["--cats-eye", "0 to 1.5", "-0.1"]),
        (["--rim", 1.5], ["--rim", "-1 to 1", "1.5"]),
        (["--obstruction", 1], ["--obstruction", "0 to 0.95", "got 1"]),
        (["--onion", 1.1], ["--onion: expected 0 to 1, got 1.1"]),
        (["--onion", 0.5, "--onion-rings", 50], ["--onion-rings: expected 1 to 40, got 50"]),
        (["--onion-rings", 5], ["--onion-rings: expected --onion for it to act on"]),
        (["--disc-grain", -1], ["--disc-grain: expected 0 to 1, got -1"]),
        (
            ["--disc-grain", 0.5, "--disc-grain-seed", -2],
            ["--disc-grain-seed", "a whole number of at least 0, got -2"],
        ),
        (["--disc-grain-seed", 2], ["--disc-grain-seed: expected --disc-grain for it to act on"]),
        (["--aperture-image", "missing.png"], ["missing.png: no such file"]),
        (["--aperture-image", "."], ["."]),
    ],
)
def test_a_mistake_is_reported_with_the_name_of_the_option(fails, options, words):
    fails([*SCATTER, *options], *words)


@pytest.mark.parametrize(
    ("value", "words"), [(0.0, ["light inside the aperture", "none"]), (-1.0, ["from 0 up"])]
)
def test_an_aperture_picture_without_light(fails, folder, value, words):
    write_image("dark.exr", np.full((8, 8, 3), value))
    fails([*SCATTER, "--aperture-image", "dark.exr"], "error: --aperture-image: expected", *words)


def test_an_engine_with_networks_takes_shapes_from_its_classical_half(folder, cli, random_weights):
    fast = [*WORDS, "--engine", "fast", "--weights", random_weights]
    assert cli(*fast, "--blades", 6, "-o", "six.exr").code == 0
    assert cli(*fast, "-o", "disc.exr").code == 0
    assert np.abs(read_image("six.exr") - read_image("disc.exr")).max() > 1e-3
