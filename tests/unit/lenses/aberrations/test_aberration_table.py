"""Tables of aberrations: what they say, against formulas and the maps that they were written from."""

import dataclasses

import numpy as np
import pytest

from bokehnet.errors import ConfigError
from bokehnet.lenses import load_lens
from bokehnet.lenses.aberrations.aberration_table import aberration_table, parse_aberration_table
from bokehnet.lenses.seidel_lens import WAVELENGTHS, seidel_aberration_map
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aberrations.zernike import zernike


def read(text):
    return parse_aberration_table(text, "a.csv")


def test_seven_numbers_for_each_of_64_wavelengths_go_out_and_in():
    """Asberg 2020: seven parameters for 64 wavelengths; what is read is what was written."""
    lens = seidel_aberration_map(load_lens("double_gauss", f_number=4.0), distortion=True)
    lens = dataclasses.replace(lens, vignetting_apertures=((0.5, 1.1), (-0.7, 1.2)))
    text = aberration_table(lens, {"name": "Double Gauss"})
    assert text.startswith("# name = Double Gauss\n# rim = 0.5, 1.1\n")
    assert text.splitlines()[3].startswith(
        "wavelength,spherical,coma,astigmatism,field_curvature,distortion,axial,lateral"
    )
    assert len(text.splitlines()) == 4 + len(WAVELENGTHS)
    result = read(text)
    np.testing.assert_allclose(result.transverse_aberration, lens.transverse_aberration, atol=1e-10)
    np.testing.assert_allclose(result.pupil_aberration, lens.pupil_aberration, atol=1e-10)
    assert result.vignetting_apertures == lens.vignetting_apertures


def test_seidels_columns_are_the_sliders():
    """:class:`AberrationSliders`: coma is a third of its tail, the field is that of the medial focus."""
    sliders = AberrationSliders(
        spherical=0.6, coma=0.9, astigmatism=0.4, field_curvature=0.3, focusing="paraxial"
    )
    result = read("wavelength,spherical,coma,astigmatism,field_curvature\n587.56,0.6,0.3,0.4,-0.1\n")
    np.testing.assert_allclose(
        result.transverse_aberration, sliders.aberration_map().transverse_aberration, atol=1e-15
    )


@pytest.mark.parametrize("number", [2, 4, 6, 8, 10, 11, 12, 16, 22])
def test_zernikes_columns_are_gradients_of_the_polynomials(number):
    """Differences of :func:`zernike` over the pupil, the field along x, in the corner."""
    result = read(f"wavelength,zernike_{number}\n550,100\n")
    rng = np.random.default_rng(0)
    pupil, step = rng.uniform(-0.6, 0.6, (40, 2)), 1e-5
    shifts = step * np.eye(2)
    expected = np.stack(
        [
            (zernike(number, pupil + shift)[-1] - zernike(number, pupil - shift)[-1]) / (2 * step)
            for shift in shifts
        ],
        -1,
    )
    miss, _, _ = result(pupil, np.tile([1.0, 0.0], (40, 1)), 550.0)
    np.testing.assert_allclose(miss, expected, atol=1e-7)


def test_single_terms_are_those_of_the_map():
    result = read("wavelength,image_g_012,pupil_f_100\n500,2,5\n600,4,5\n")
    miss, moved, _ = result(np.array([0.5, 0.0]), np.array([1.0, 0.5]), 550.0)
    np.testing.assert_allclose(miss, 0.03 * 0.5 * 1.25**2 * np.array([1.0, 0.5]))
    np.testing.assert_allclose(moved, [0.5 + 0.05 * 0.25 * 0.5, 0])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["a.csv: expected names of columns", "0 rows"]),
        ("spherical\n1\n", ["line 1", "one column wavelength, found none"]),
        ("wavelength,coma,coma\n500,1,1\n", ["'coma' twice"]),
        ("wavelength,sphere\n500,1\n", ["line 1", "got 'sphere'", "field_curvature", "zernike_N"]),
        ("wavelength,coma\n500,x\n", ["line 2: coma: expected a number, got 'x'"]),
        ("wavelength,coma\n500,inf\n", ["line 2: coma: expected a number up to"]),
        ("wavelength,coma\n500\n", ["line 2: expected 2 numbers, found 1"]),
        ("wavelength,coma\n500,1\n400,1\n", ["wavelength: expected rising numbers"]),
        ("# rim = 1\nwavelength,coma\n500,1\n", ["line 1: rim: expected a shift and a radius, got '1'"]),
        ("# rim = 1, 0\nwavelength,coma\n500,1\n", ["rim", "a radius other than 0"]),
        ("wavelength,zernike_5\n500,1\n", ["zernike_5", "symmetric about the field"]),
        ("wavelength,zernike_28\n500,1\n", ["zernike_28", "seventh order"]),
        ("wavelength,image_f_400\n500,1\n", ["image_f_400: expected three powers"]),
    ],
)
def test_mistakes_are_one_line(text, words):
    with pytest.raises(ConfigError) as caught:
        read(text)
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)
