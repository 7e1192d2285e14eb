"""The options of ``bokehnet render`` that act on the blurred picture, used rightly and wrongly."""

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.effects import BrownConrady, CameraEffects, DivisionModel, Grain, Viewport, Vignette
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity, read_map
from bokehnet.render.renderer import BokehRenderer

WIDTH, HEIGHT = 64, 40  # of the pictures in the folder
HALF = 2**-11  # relative rounding error of the half floats in the EXR that is written
WORDS = ["render", "photo.png", "--disparity", "disparity.png", "--blur", 9, "--focus", 0.4]
WORDS += ["--repair-disparity", "off", "--engine", "scatter"]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--distortion", -0.1], {"distortion": DivisionModel(strength=-0.1)}),
        (
            ["--distortion-brown", "-0.1,0.02"],
            {"distortion": BrownConrady(radial=(-0.1, 0.02, 0.0))},
        ),
        (
            ["--distortion-brown", "0.1,0,0.01,0.01,-0.02"],
            {"distortion": BrownConrady(radial=(0.1, 0.0, 0.01), decentring=(0.01, -0.02))},
        ),
        (["--cos4", 40], {"cos4": 40.0}),
        (["--optical-vignetting", 1.2], {"optical_vignetting": 1.2}),
        (["--vignette", 1.5], {"vignette": Vignette(stops=1.5)}),
        (
            ["--vignette", -1, "--vignette-radius", 0, "--vignette-softness", 0.5, "--vignette-roundness", 0],
            {"vignette": Vignette(stops=-1.0, radius=0.0, softness=0.5, roundness=0.0)},
        ),
        (["--grain", 3200], {"grain": Grain(iso=3200.0)}),
        (
            ["--grain", 800, "--grain-size", 0, "--grain-mono", "--grain-seed", 7],
            {"grain": Grain(iso=800.0, size=0.0, monochrome=True, seed=7)},
        ),
    ],
)
def test_options_are_the_effects_of_the_library(folder, cli, options, expected):
    """Oracle: CameraEffects, which has its own tests, on what BokehRenderer gives."""
    outcome = cli(*WORDS, *options, "-o", "out.exr", "--save-maps", "maps", "-q")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    defocus = 9 * (read_disparity("disparity.png") - np.float32(0.4))
    plain = BokehRenderer("scatter").render_arrays(read_image("photo.png"), defocus).bokeh
    bokeh = CameraEffects(**expected).apply(plain)
    assert_allclose(read_image("out.exr"), bokeh, rtol=HALF, atol=1e-5)
    assert np.abs(bokeh - plain).max() > 0.02
    assert_allclose(read_image("maps/classical.png"), np.clip(plain, 0, 1), atol=0.01)  # before the effects


OFF = ["--distortion", 0, "--distortion-brown", "0,0", "--cos4", 0, "--optical-vignetting", 0]
OFF += ["--vignette", 0, "--vignette-radius", 0.1, "--grain", 0, "--grain-size", 3, "--grain-mono"]


def test_at_strength_0_no_bit_changes(folder, cli):
    pictures = []
    for options in ([], OFF):
        assert cli(*WORDS, *options, "-o", "out.exr").code == 0
        pictures.append((folder / "out.exr").read_bytes())
    assert pictures[0] == pictures[1]


@pytest.mark.parametrize(
    "options",
    [["--distortion", -1e-6], ["--distortion-brown", "1e-6"], ["--cos4", 0.01], ["--vignette", 1e-5]],
)
def test_a_strength_of_next_to_nothing_changes_next_to_nothing(folder, cli, options):
    for name, words in (("plain.exr", []), ("out.exr", options)):
        assert cli(*WORDS, *words, "-o", name).code == 0
    assert_allclose(read_image("out.exr"), read_image("plain.exr"), rtol=2 * HALF, atol=1e-4)


def test_frames_have_a_grain_of_their_own_that_comes_back(folder, cli):
    """Oracle: the library, with the number of the frame."""
    words = [*WORDS, "--grain", 6400, "--frames", "7-8", "-o", "out.##.exr"]
    assert cli(*words).code == 0
    first = [read_image(f"out.0{number}.exr") for number in (7, 8)]
    assert np.abs(first[0] - first[1]).max() > 0.02
    defocus = 9 * (read_disparity("disparity.png") - np.float32(0.4))
    plain = BokehRenderer("scatter").render_arrays(read_image("photo.png"), defocus).bokeh
    expected = CameraEffects(grain=Grain(iso=6400.0)).apply(plain, frame=8)
    assert_allclose(first[1], expected, rtol=HALF, atol=1e-5)


def stored(name):
    image = oiio.ImageBuf(name)
    return dict(zip(image.spec().channelnames, np.moveaxis(image.get_pixels(oiio.FLOAT), 2, 0), strict=True))


def test_alpha_moves_with_the_light_and_other_channels_stay(folder, cli, write_channels):
    """Oracle: the library on light and alpha together; nothing comes where alpha is 0."""
    alpha = np.zeros((HEIGHT, WIDTH), np.float32)
    alpha[10:30, 24:40] = 1
    light = read_image("photo.png") * alpha[..., None]
    colours = dict(zip("RGB", np.moveaxis(light, 2, 0), strict=True))
    write_channels("layer.exr", **colours, A=alpha, Z=read_map("camera.exr", "Z"))
    words = ["render", "layer.exr", *WORDS[2:]]
    options = ["--distortion", 0.3, "--vignette", 2, "--grain", 6400]
    assert cli(*words, "-o", "plain.exr").code == 0
    assert cli(*words, *options, "-o", "out.exr").code == 0
    plain, result = stored("plain.exr"), stored("out.exr")
    effects = CameraEffects(
        distortion=DivisionModel(strength=0.3), vignette=Vignette(stops=2.0), grain=Grain(iso=6400.0)
    )
    expected = effects.apply(np.stack([plain[name] for name in "RGBA"], -1))
    for number, name in enumerate("RGBA"):
        assert_allclose(result[name], expected[..., number], atol=1e-5)
    assert_array_equal(result["Z"], plain["Z"])
    assert np.abs(result["A"] - plain["A"]).max() > 0.2
    assert_array_equal(result["G"][result["A"] == 0], 0)


def test_overscan_is_used_in_place_of_a_crop_and_windows_stay(folder, cli):
    """Oracle: the library, with the position of the stored pixels in the shown picture."""
    image = oiio.ImageBuf("camera.exr")
    spec = image.specmod()
    spec.x, spec.y, spec.full_x, spec.full_y = -8, -4, 0, 0
    spec.full_width, spec.full_height = WIDTH - 16, HEIGHT - 8
    assert image.write("overscan.exr")
    words = ["render", "overscan.exr", *WORDS[2:]]
    assert cli(*words, "-o", "plain.exr").code == 0
    assert cli(*words, "--distortion", -0.1, "--vignette", 1, "--grain", 1600, "-o", "out.exr").code == 0
    plain, result = stored("plain.exr"), stored("out.exr")
    effects = CameraEffects(
        distortion=DivisionModel(strength=-0.1), vignette=Vignette(stops=1.0), grain=Grain(iso=1600.0)
    )
    view = Viewport(width=WIDTH - 16, height=HEIGHT - 8, left=-8, top=-4)
    expected = effects.apply(np.stack([plain[name] for name in "RGB"], -1), view=view)
    for number, name in enumerate("RGB"):
        assert_allclose(result[name], expected[..., number], atol=1e-5)
    written = oiio.ImageBuf("out.exr").spec()
    assert (written.x, written.y, written.full_width) == (-8, -4, WIDTH - 16)
    assert_array_equal(result["Z"], plain["Z"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--distortion", -2], ["error: --distortion: expected -0.9 to 0.9, got -2"]),
        (["--distortion", "nan"], ["--distortion", "nan"]),
        (["--distortion", 0.1, "--distortion-brown", "0.1"], ["one of --distortion and --distortion-brown"]),
        (
            ["--distortion-brown", "a,b"],
            ["--distortion-brown: expected finite K1[,K2[,K3[,P1,P2]]] such", "'a,b'"],
        ),
        (["--distortion-brown", "1,2,3,4"], ["--distortion-brown: expected finite K1", "'1,2,3,4'"]),
        (["--distortion-brown", "inf"], ["--distortion-brown: expected finite K1", "'inf'"]),
        (
            ["--distortion-brown", "-0.5"],
            ["--distortion-brown: expected", "folds over itself", "take smaller"],
        ),
        (
            ["--distortion-brown", "0,0,0,0.5,0"],
            ["--distortion-brown: expected", "folds over itself", "take smaller"],
        ),
        (["--cos4", 90], ["error: --cos4: expected 0 to 80 degrees, got 90"]),
        (["--cos4", "nan"], ["--cos4", "nan"]),
        (["--optical-vignetting", -1], ["--optical-vignetting: expected 0 to 1.5, got -1"]),
        (["--vignette", 11], ["error: --vignette: expected -10 to 10 stops, got 11"]),
        (["--vignette", 1, "--vignette-radius", 3], ["--vignette-radius: expected 0 to 2, got 3"]),
        (["--vignette", 1, "--vignette-softness", 0], ["--vignette-softness: expected 0.01 to 2"]),
        (["--vignette", 1, "--vignette-roundness", 2], ["--vignette-roundness: expected 0 to 1"]),
        (["--vignette-softness", 0.5], ["--vignette-softness: expected --vignette for it to act on"]),
        (["--grain", -5], ["error: --grain: expected a number of at least 0 ISO, got -5"]),
        (["--grain", "nan"], ["--grain: expected a finite number"]),
        (["--grain", 100, "--grain-size", 51], ["--grain-size: expected 0 to 50 pixels, got 51"]),
        (
            ["--grain", 100, "--grain-seed", -1],
            ["--grain-seed: expected a whole number of at least 0, got -1"],
        ),
        (["--grain-mono"], ["--grain-mono: expected --grain for it to act on"]),
        (["--grain-size", 2], ["--grain-size: expected --grain for it to act on"]),
    ],
)
def test_a_mistake_is_reported_with_the_name_of_the_option(fails, options, words):
    fails([*WORDS, *options], *words)
