"""The slider that is nearest to a barrel."""

import numpy as np
import pytest

from bokehnet.lenses import load_lens
from bokehnet.lenses.aberration_fit import fit_aberration_map
from bokehnet.lenses.cats_eye import nearest_cats_eye
from bokehnet.lenses.relative_illumination import relative_illumination
from bokehnet.optics.vignette import rim_factor


@pytest.mark.parametrize("slider", [0.0, 0.4, 1.1])
def test_a_barrel_that_is_a_slider_is_that_slider(slider):
    found, differs = nearest_cats_eye([(slider, 1.0)] if slider else [])
    assert found == pytest.approx(slider, abs=0.006)
    assert differs < 0.005


def test_a_barrel_on_both_sides_is_a_slider_of_twice_the_shift():
    """Geometry: discs at -s and s meet in the shape that discs at 0 and 2 s meet in, about another middle."""
    found, differs = nearest_cats_eye([(0.3, 1.0), (-0.3, 1.0)])
    assert found == pytest.approx(0.6, rel=0.02)
    assert differs < 0.02


def test_a_narrow_barrel_is_no_slider():
    _, differs = nearest_cats_eye([(0.0, 0.7)])
    assert differs > 0.1


def test_the_slider_of_a_traced_lens_leaves_the_light_that_its_rims_leave():
    """Traced: the light of the Petzval lens over cos^4, in the mean over its picture."""
    lens = load_lens("petzval")
    slider, _ = nearest_cats_eye(fit_aberration_map(lens, wavelengths=()).vignetting_apertures)
    radius = lens.prescription.image_radius
    shares = np.sqrt((np.arange(32) + 0.5) / 32)
    place = np.linspace(0, 1, 33)
    light = np.interp(shares, place, relative_illumination(lens, radius))
    slope = shares * radius / (lens.sensor_position - lens.paraxial.exit.position)
    wanted = (light * (1 + slope**2) ** 2).mean()
    assert rim_factor(np.stack([shares, 0 * shares], -1), slider).mean() == pytest.approx(wanted, rel=0.03)
