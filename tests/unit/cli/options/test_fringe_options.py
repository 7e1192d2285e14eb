"""The options of ``bokehnet render`` for colour fringes, used rightly and wrongly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration, make_curve
from bokehnet.optics.aberrations.field_maps import inversion, square
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.render.renderer import BokehRenderer

HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
EXACT = ["--repair-disparity", "off"]  # the picture is noise, nothing to follow
WORDS = ["render", "photo.png", "--disparity", "disparity.png", "--blur", 9, "--focus", 0.4, *EXACT]
RAYS = [*WORDS, "--engine", "rays"]


@pytest.mark.parametrize(
    ("options", "lens_response"),
    [
        (["--axial-fringe", 5], LensResponse(chromatic_aberration=ChromaticAberration(axial=5))),
        (
            ["--lateral-fringe", -4, "--lateral-map", "square", "--fringe-glass", "achromat"],
            LensResponse(
                chromatic_aberration=ChromaticAberration(
                    lateral=-4, lateral_map=square, curve=make_curve("achromat")
                )
            ),
        ),
        (
            [
                "--axial-fringe",
                5,
                "--axial-map",
                "inversion",
                "--dispersion",
                "rgb",
                "--equaliser",
                "1,0.2,3",
            ],
            LensResponse(
                chromatic_aberration=ChromaticAberration(axial=5, axial_map=inversion),
                wavelength_sampling=WavelengthSampling(dispersion="rgb", equaliser=(1, 0.2, 3)),
            ),
        ),
    ],
)
def test_options_are_those_of_the_renderer(folder, cli, options, lens_response):
    """Oracle: BokehRenderer, which has its own tests, called directly."""
    outcome = cli(*RAYS, *options, "-o", "out.exr", "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    image, disparity = read_image("photo.png"), read_disparity("disparity.png")
    defocus = 9 * (disparity - np.float32(0.4))
    plain = BokehRenderer("rays").render_arrays(image, defocus).bokeh
    bokeh = BokehRenderer("rays", lens_response=lens_response).render_arrays(image, defocus).bokeh
    assert_allclose(read_image("out.exr"), bokeh, rtol=HALF, atol=1e-5)
    assert np.abs(bokeh - plain).max() > 0.02


def test_strengths_of_0_change_no_bit(folder, cli):
    pictures = []
    for options in ([], ["--axial-fringe", 0, "--lateral-fringe", 0, "--dispersion", "continuous"]):
        assert cli(*RAYS, *options, "-o", "out.exr").code == 0
        pictures.append((folder / "out.exr").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--axial-fringe", 200], ["--axial-fringe: expected -100 to 100 percent", "got 200"]),
        (["--lateral-fringe", "nan"], ["--lateral-fringe: expected -100 to 100 percent, got nan"]),
        (["--lateral-fringe", "wide"], ["--lateral-fringe: expected -100 to 100 percent, got 'wide'"]),
        (["--axial-map", "square"], ["--axial-map: expected --axial-fringe for it to act on"]),
        (
            ["--axial-fringe", 1, "--lateral-map", "cube"],
            ["--lateral-map: expected --lateral-fringe for it to act on"],
        ),
        (["--axial-fringe", 1, "--axial-map", "steep"], ["--axial-map: expected names of", "got 'steep'"]),
        (
            ["--lateral-fringe", 1, "--lateral-map", "power:x"],
            ["--lateral-map: expected a number", "power:x"],
        ),
        (
            ["--fringe-glass", "F2"],
            ["--fringe-glass: expected --axial-fringe or --lateral-fringe for it to act on"],
        ),
        (["--axial-fringe", 1, "--fringe-glass", "jam"], ["--fringe-glass: unknown glass 'jam'", "achromat"]),
        (["--axial-fringe", 1, "--dispersion", "prism"], ["--dispersion: expected one of continuous, rgb"]),
        (
            ["--dispersion", "rgb"],
            ["--dispersion: expected colour fringes from --axial-fringe, ", "or --lens"],
        ),
        (["--equaliser", "1,2"], ["--equaliser: expected colour fringes from --axial-fringe, ", "or --lens"]),
        (["--axial-fringe", 1, "--equaliser", "1,-2"], ["--equaliser: expected numbers from 0 up", "'1,-2'"]),
        (["--axial-fringe", 1, "--equaliser", "0,0,0"], ["--equaliser", "none for red"]),
        (["--axial-fringe", 1, "--equaliser", "1,x"], ["--equaliser: expected numbers separated", "1,x"]),
        (
            ["--axial-fringe", 1, "--equaliser", "none.txt"],
            ["--equaliser", "or a file with them", "none.txt"],
        ),
        (["--axial-fringe", 1, "--equaliser", "photo.png"], ["photo.png: expected numbers separated by"]),
        (["--axial-fringe", 1, "--equaliser", "."], ["cannot read .", "irectory"]),
        (
            ["--axial-fringe", 1, "--engine", "scatter"],
            ["--axial-fringe: expected --engine rays or hybrid", "got 'scatter'"],
        ),
    ],
)
def test_a_mistake_is_reported_with_the_name_of_the_option(fails, options, words):
    fails([*RAYS, *options], *words)


def test_an_empty_file_of_gains_is_reported(folder, fails):
    (folder / "empty.txt").write_text("")
    fails(
        [*RAYS, "--axial-fringe", 1, "--equaliser", "empty.txt"], "--equaliser: expected 1 to 64 gains, got 0"
    )
