"""Refractive indices against Schott's data sheets."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.errors import LensError
from bokehnet.optics.spectral.glass import C_LINE, D_LINE, F_LINE, AbbeGlass, SchottGlass, make_glass

# nd and Vd as printed in Schott's data sheets of 2015 and 2019.
SHEETS = {
    "N-BK7": (1.51680, 64.17),
    "N-BASF2": (1.66446, 36.00),
    "N-LAF33": (1.78582, 44.05),
    "N-LAK12": (1.67790, 55.20),
    "N-SF11": (1.78472, 25.68),
    "N-SK16": (1.62041, 60.32),
    "N-ZK7": (1.50847, 61.19),
    "F2": (1.62004, 36.37),
    "LF5": (1.58144, 40.85),
    "SF1": (1.71736, 29.51),
    "SF4": (1.75520, 27.58),
    "SF5": (1.67270, 32.21),
    "SF6": (1.80518, 25.43),
}


@pytest.mark.parametrize("name", SHEETS)
def test_index_and_abbe_number_are_those_of_the_data_sheet(name):
    nd, nf, nc = (make_glass(name).index(line) for line in (D_LINE, F_LINE, C_LINE))
    assert nd == pytest.approx(SHEETS[name][0], abs=6e-6)
    assert (nd - 1) / (nf - nc) == pytest.approx(SHEETS[name][1], abs=6e-3)


def test_bk7_at_587_6_nm_is_1_5168_by_both_formulas():
    """Schott's catalogue of 1966 and its data sheet of today."""
    old = SchottGlass((2.2718929, -1.0108077e-2, 1.0592509e-2, 2.0816965e-4, -7.6472538e-6, 4.9240991e-7))
    assert old.index(587.6) == pytest.approx(1.5168, abs=1e-5)
    assert make_glass("N-BK7").index(587.6) == pytest.approx(1.5168, abs=1e-5)
    wavelength = np.linspace(400, 700, 31)
    assert_allclose(old.index(wavelength), make_glass("N-BK7").index(wavelength), atol=2e-5)


@pytest.mark.parametrize("name", SHEETS)
def test_two_numbers_describe_a_glass_within_the_documented_error(name):
    glass, nd, vd = make_glass(name), *SHEETS[name]
    stand_in = AbbeGlass(nd, vd)
    assert stand_in.index(D_LINE) == pytest.approx(nd, abs=1e-12)
    assert stand_in.index(F_LINE) - stand_in.index(C_LINE) == pytest.approx((nd - 1) / vd)
    wavelength = np.linspace(430, 700, 28)
    assert_allclose(stand_in.index(wavelength), glass.index(wavelength), atol=6e-4)
    assert_allclose(stand_in.index(400.0), glass.index(400.0), atol=2e-3)


@pytest.mark.parametrize("glass", [make_glass("SF6"), AbbeGlass(1.7, 40.0)])
def test_tensors_get_the_same_index_and_a_gradient(glass):
    wavelength = torch.linspace(420, 680, 5, dtype=torch.float64, requires_grad=True)
    assert_allclose(glass.index(wavelength).detach().numpy(), glass.index(wavelength.detach().numpy()))
    assert torch.autograd.gradcheck(glass.index, (wavelength,))


def test_an_unknown_glass_is_an_error_that_lists_the_known():
    with pytest.raises(LensError, match=r"'BK77'.*N-BK7"):
        make_glass("BK77")
