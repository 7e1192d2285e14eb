"""Presets that name a kind of lens, against lenses of that kind that are traced."""

import dataclasses

import numpy as np
import pytest

from bokehnet import RenderSettings, load_preset
from bokehnet.lenses import PrescriptionLens, load_lens
from bokehnet.lenses.aberrations.point_spread import PsfGrid, aberration_psf, correlation, traced_psf
from bokehnet.lenses.seidel_lens import reduce_lens
from bokehnet.optics.aberrations.chromatic_aberration import make_curve
from bokehnet.optics.spectral.glass import C_LINE, D_LINE, F_LINE
from bokehnet.render.look import make_lens_response

SIDE = 61
ONE = {"wavelengths": np.array([D_LINE]), "colors": np.ones((1, 1)), "size": SIDE}
AXIS = (0.0, 0.0)


def settings_of(name: str) -> RenderSettings:
    return load_preset(name).over(RenderSettings())


def overcorrected_triplet() -> PrescriptionLens:
    """The Cooke triplet with its flint made flatter towards the rim, so that the rim focuses too far."""
    design = load_lens("cooke_triplet").prescription
    rows = list(design.surfaces)
    rows[2] = dataclasses.replace(rows[2], conic=2.0)
    return PrescriptionLens(
        prescription=dataclasses.replace(design, surfaces=tuple(rows)), focus_distance=1500.0
    )


@pytest.mark.parametrize(("depth", "least"), [(1e6, 0.84), (900.0, 0.9)])
def test_soap_bubbles_have_their_rim_where_spherical_aberration_puts_it(depth, least):
    """Traced: an overcorrected triplet, behind focus (a bright rim) and in front of it (a core)."""
    lens, settings = overcorrected_triplet(), settings_of("soap-bubble")
    half = lens.prescription.image_radius
    third_order = reduce_lens(lens, wavelengths=[D_LINE]).image.spherical[0]
    assert settings.lens.spherical == pytest.approx(100 * third_order, rel=0.05)
    assert settings.aperture.spherical_profile == 0  # the rim would be drawn twice
    defocus = float(lens.coc_radius(1 / depth)) / half
    pitch = 3.2 * abs(defocus) / SIDE
    expected = traced_psf(lens, PsfGrid(pitch=pitch * half, **ONE), depth=depth, field=AXIS)
    aberrations = make_lens_response(settings.lens, settings.color).aberration_map
    shown = aberration_psf(aberrations, PsfGrid(pitch=pitch, **ONE), defocus=defocus, field=AXIS)
    assert correlation(shown, expected) > least


def test_a_portrait_lens_has_its_red_and_blue_together():
    """Born and Wolf 4.7.2: crown and flint bring F and C to one focus; the rest is green from purple.

    Its fringe is no stronger than that of the double Gauss of the catalogue, as wide open as 85/1.2.
    """
    color = settings_of("portrait-85").color
    blue, green, red = make_curve(color.glass)(np.array([F_LINE, 546.0, C_LINE]))
    assert blue == pytest.approx(red, abs=0.01)
    assert green > blue + 0.05
    lens = load_lens("double_gauss", focal_length=85.0)
    traced = reduce_lens(lens, half_diagonal=21.6, wavelengths=[400.0, 490.0, D_LINE, 700.0]).blur
    assert color.axial < 100 * np.ptp(traced) * lens.min_f_number / 1.2
