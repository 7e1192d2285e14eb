"""From settings to the lens opening, the lens and the camera. Authority: the classes of the rooms below."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.effects import BrownConrady, CameraEffects, DivisionModel, Grain, Vignette
from bokehnet.errors import ConfigError, LensError, ParameterError
from bokehnet.io.image import write_image
from bokehnet.io.window import Window
from bokehnet.lenses.catalog import load_lens
from bokehnet.lenses.seidel_lens import seidel_aberration_map
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.optics.tone import Highlights
from bokehnet.render.look import (
    make_aperture,
    make_effects,
    make_highlights,
    make_lens_response,
    picture_aberrations,
)
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.camera import LensNumbers
from bokehnet.scene.focus import FocusedLens
from bokehnet.scene.prescription import prescription_lens
from bokehnet.settings.settings import (
    ApertureSettings,
    ColorSettings,
    EffectSettings,
    HighlightSettings,
    LensSettings,
    RenderSettings,
)

WINDOW = Window.whole(64, 40)


def response(lens=None, **color):
    return make_lens_response(lens or LensSettings(), ColorSettings(**color))


def test_the_default_look_changes_nothing():
    assert make_aperture(ApertureSettings()) == Aperture()
    assert make_effects(EffectSettings()) is None
    assert make_highlights(HighlightSettings()) is None
    assert response().is_ideal
    assert response(LensSettings(spherical=-0.0, coma=0.0)).is_ideal
    assert response().wavelength_sampling == WavelengthSampling()
    assert prescription_lens(LensSettings()) is None
    BokehRenderer().check(RenderSettings())


def test_every_field_of_the_aperture_arrives():
    settings = ApertureSettings(
        blades=7, curvature=0.3, rotation=-20, squeeze=1.5, cats_eye=0.4, spherical_profile=0.5,
        obstruction=0.2, onion=0.6, onion_rings=9, grain=0.7, grain_seed=3,
    )  # fmt: skip
    assert make_aperture(settings) == Aperture(
        blades=7, curvature=0.3, rotation=-20, squeeze=1.5, cats_eye=0.4, spherical_profile=0.5,
        obstruction=0.2, onion=0.6, onion_rings=9, grain=0.7, grain_seed=3,
    )  # fmt: skip


def test_effects_of_strength_0_change_nothing():
    assert make_effects(EffectSettings(brown=(0, 0, 0, 0, 0), vignette=0, grain=0, grain_size=2)) is None
    assert make_effects(EffectSettings(vignette=0, vignette_radius=1, vignette_softness=0.5)) is None


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"distortion": -0.1}, {"distortion": DivisionModel(strength=-0.1)}),
        ({"brown": (-0.1,)}, {"distortion": BrownConrady(radial=(-0.1, 0.0, 0.0))}),
        (
            {"brown": [0.1, 0, 0.01, 0.01, -0.02]},
            {"distortion": BrownConrady(radial=(0.1, 0, 0.01), decentring=(0.01, -0.02))},
        ),
        ({"cos4": 40}, {"cos4": 40.0}),
        ({"optical_vignetting": 1.2}, {"optical_vignetting": 1.2}),
        (
            {"vignette": -1, "vignette_radius": 0, "vignette_softness": 0.5, "vignette_roundness": 0},
            {"vignette": Vignette(stops=-1.0, radius=0.0, softness=0.5, roundness=0.0)},
        ),
        ({"vignette": 1.5}, {"vignette": Vignette(stops=1.5)}),
        ({"vignette": 0, "vignette_color_loss": 0.4}, {"vignette": Vignette(stops=0.0, color_loss=0.4)}),
        (
            {"grain": 800, "grain_size": 0, "grain_mono": True, "grain_seed": 7},
            {"grain": Grain(iso=800.0, size=0.0, monochrome=True, seed=7)},
        ),
        ({"grain": 800}, {"grain": Grain(iso=800.0)}),
    ],
)
def test_effects_are_those_of_the_library(settings, expected):
    assert make_effects(EffectSettings(**settings)) == CameraEffects(**expected)


def test_highlights_are_those_of_the_library():
    assert make_highlights(HighlightSettings(threshold=0.7)) == Highlights(threshold=0.7)
    assert make_highlights(HighlightSettings(threshold=0, gain=3)) == Highlights(threshold=0, gain=3)


def test_a_lens_response_holds_what_was_given():
    result = response(LensSettings(coma=2), axial=2, dispersion="rgb", equaliser=(1, 2, 1))
    assert isinstance(result.chromatic_aberration, ChromaticAberration)
    assert (result.chromatic_aberration.axial, result.chromatic_aberration.lateral) == (2, 0)
    assert result.wavelength_sampling == WavelengthSampling(dispersion="rgb", equaliser=(1, 2, 1))
    expected = AberrationSliders(coma=2.0).aberration_map()
    assert_allclose(result.aberration_map.transverse_aberration, expected.transverse_aberration)


def test_glass_comes_with_the_picture_and_not_with_the_response():
    color = ColorSettings(dispersion="rgb")
    RenderSettings(lens=LensSettings(name="petzval"), color=color)  # a lens parts the colours
    result = make_lens_response(LensSettings(name="petzval"), color)
    assert result.wavelength_sampling == WavelengthSampling(dispersion="rgb")
    assert result.aberration_map.is_perfect


@pytest.mark.parametrize("text", ["1,0.5,0,2", "1 0.5\n0\n\n 2\n", "1,\n0.5,0,2,\n", "\ufeff1 0.5 0 2"])
def test_gains_are_read_from_files(tmp_path, text):
    path = tmp_path / "gains.txt"
    path.write_text(text, encoding="utf-8")
    assert response(axial=1, equaliser=path).wavelength_sampling.equaliser == (1, 0.5, 0, 2)
    assert response(axial=1, equaliser=(3,)).wavelength_sampling.equaliser == (3,)


@pytest.mark.parametrize(
    ("content", "kind", "words"),
    [
        (None, ParameterError, "color.equaliser: expected numbers separated by commas, or a file with them"),
        (b"", ParameterError, "color.equaliser: expected 1 to 64 gains, got 0"),
        (b"1 x", ConfigError, "expected numbers separated by commas, spaces or line ends"),
        (b"\xff\xfe", ConfigError, "expected numbers separated by commas, spaces or line ends"),
        (b"1,-2", ParameterError, "color.equaliser: expected"),
        (b"1,nan", ParameterError, "color.equaliser: expected"),
        (b"0,0", ParameterError, "color.equaliser: expected gains that leave light"),
        (b"1 " * 65, ParameterError, "color.equaliser: expected 1 to 64 gains, got 65"),
    ],
)
def test_a_gain_file_without_gains_is_reported(tmp_path, content, kind, words):
    path = tmp_path / "gains.txt"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(kind, match=words):
        response(axial=1, equaliser=path)


@pytest.mark.parametrize(
    ("color", "parameter", "words"),
    [
        ({"axial": 1, "axial_map": "steep"}, "color.axial_map", "'steep'"),
        ({"lateral": 1, "lateral_map": "power:x"}, "color.lateral_map", "power:x"),
        ({"axial": 1, "glass": "jam"}, "color.glass", "unknown glass 'jam'.*achromat, linear"),
        ({"axial": 1, "equaliser": (0, 0, 0)}, "color.equaliser", "none for red"),
        ({"axial": 1, "equaliser": (1,) * 65}, "color.equaliser", "1 to 64 gains"),
    ],
)
def test_unknown_names_are_reported_with_their_field(color, parameter, words):
    with pytest.raises(ParameterError, match=words) as caught:
        response(**color)
    assert caught.value.parameter == parameter


@pytest.mark.parametrize(
    ("effects", "parameter"),
    [({"brown": (-0.5,)}, "effects.brown"), ({"brown": (0, 0, 0, 0.5, 0)}, "effects.brown")],
)
def test_a_picture_that_folds_is_reported_with_its_field(effects, parameter):
    with pytest.raises(ParameterError, match="folds over itself") as caught:
        make_effects(EffectSettings(**effects))
    assert caught.value.parameter == parameter


@pytest.mark.parametrize(("value", "words"), [(0.0, "light inside the aperture"), (-1.0, "from 0 up")])
def test_an_empty_aperture_picture_is_reported_with_its_field(tmp_path, value, words):
    write_image(tmp_path / "dark.exr", np.full((8, 8, 3), value))
    with pytest.raises(ParameterError, match=words) as caught:
        make_aperture(ApertureSettings(image=tmp_path / "dark.exr"))
    assert caught.value.parameter == "aperture.image"


@pytest.mark.parametrize(
    ("lens", "words"),
    [
        ({"name": "nikkor"}, "`lens.name`: unknown lens 'nikkor'"),
        ({"name": "petzval", "f_number": 1.2}, "`lens.name`: Petzval: f-number"),
    ],
)
def test_an_impossible_lens_is_reported_before_any_picture(lens, words):
    with pytest.raises(LensError, match=words):
        BokehRenderer().check(RenderSettings(lens=LensSettings(**lens)))


def test_a_camera_wider_than_the_lens_gets_the_way_out():
    with pytest.raises(LensError, match=r"Petzval: f-number.*`lens.f_number` sets that of the lens only"):
        prescription_lens(LensSettings(name="petzval"), f_number=1.4)
    assert prescription_lens(LensSettings(name="petzval", f_number=4), f_number=1.4).f_number == 4


def focused(camera=None, near=0.5):
    return FocusedLens(near=near, far=near, blur=9, camera=camera, plane=None, window=WINDOW)


def test_with_relative_disparity_the_lens_is_the_one_designed():
    settings = LensSettings(name="double_gauss", aberrations="seidel")
    aberrations = picture_aberrations(settings, focused(), WINDOW)
    expected = seidel_aberration_map(load_lens("double_gauss"))
    assert_allclose(aberrations.transverse_aberration, expected.transverse_aberration)


def test_with_metric_depth_the_lens_has_the_numbers_of_the_camera():
    camera = LensNumbers(focal_length=50, f_number=2.2, sensor_width=12)
    settings = LensSettings(name="double_gauss", aberrations="seidel")
    aberrations = picture_aberrations(settings, focused(camera, near=1 / 2000), WINDOW)
    lens = load_lens("double_gauss", focal_length=50.0, f_number=2.2, focus_distance=2000.0)
    expected = seidel_aberration_map(lens, half_diagonal=0.5 * math.hypot(12, 12 * 40 / 64))
    assert_allclose(aberrations.transverse_aberration, expected.transverse_aberration)
    assert (
        np.abs(
            aberrations.transverse_aberration
            - seidel_aberration_map(load_lens("double_gauss")).transverse_aberration
        ).max()
        > 0
    )


def test_without_a_lens_and_a_tilt_nothing_is_added():
    assert picture_aberrations(LensSettings(), focused(), WINDOW) is None
