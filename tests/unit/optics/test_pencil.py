"""The pencil map. Authority: its formula, written out for single terms; symmetry about the axis."""

import math

import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.pencil import DESIGN_WAVELENGTH, TERMS, PencilMap, term


def single(i: int, j: int, k: int, f: float, g: float, **others) -> PencilMap:
    miss, bend = np.zeros((1, 2, len(TERMS))), np.zeros((1, 2, len(TERMS)))
    miss[0, :, term(i, j, k)] = f, g
    bend[0, :, term(i, j, k)] = -f, g
    return PencilMap(wavelengths=[DESIGN_WAVELENGTH], miss=miss, bend=bend, **others)


@pytest.mark.parametrize(("i", "j", "k"), TERMS)
def test_each_term_is_its_monomial(i, j, k):
    a, h = np.array([0.3, -0.6]), np.array([0.5, 0.2])
    monomial = (a @ a) ** i * (a @ h) ** j * (h @ h) ** k
    miss, run, passes = single(i, j, k, 0.7, -0.4)(a, h)
    np.testing.assert_allclose(miss, (0.7 * a - 0.4 * h) * monomial, rtol=1e-12)
    np.testing.assert_allclose(run, a + (-0.7 * a - 0.4 * h) * monomial, rtol=1e-12)
    assert passes


def test_a_turned_picture_is_turned_and_a_mirrored_one_mirrored():
    rng = np.random.default_rng(0)
    miss, bend = rng.normal(size=(2, 1, 2, len(TERMS)))
    pencil = PencilMap(wavelengths=[500.0], miss=miss, bend=bend)
    a, h = rng.uniform(-0.7, 0.7, (2, 5, 2))
    turn = np.array([[math.cos(0.8), -math.sin(0.8)], [math.sin(0.8), math.cos(0.8)]])
    for change in (turn, np.diag([1.0, -1.0])):
        for plain, changed in zip(pencil(a, h)[:2], pencil(a @ change.T, h @ change.T)[:2], strict=True):
            np.testing.assert_allclose(changed, plain @ change.T, atol=1e-12)


def test_tilt_divides_and_rims_cut():
    pencil = single(0, 0, 0, 0.0, 0.0, tilt=(0.2, -0.5), rims=((0.5, 0.9), (-0.3, 1.1)))
    a = np.array([[0.5, 0.5], [-0.6, 0.3], [0.0, 0.95], [0.7, -0.6]])
    _, run, passes = pencil(a, np.array([0.8, 0.0]))
    np.testing.assert_allclose(run, a / (1 + a @ [0.2, -0.5])[:, None])
    # From the rims' centres, (0.4, 0) and (-0.24, 0), these are (0.51, 0.89), (1.04, 0.47), (1.03, 0.98) and
    # (0.67, 1.12) away: two stand beyond the first rim, 0.9, one beyond the second, 1.1.
    np.testing.assert_array_equal(passes, [True, False, False, False])


def test_wavelengths_are_joined_by_straight_lines():
    miss = np.zeros((3, 2, len(TERMS)))
    miss[:, 0, 0] = 1.0, 3.0, 2.0
    pencil = PencilMap(wavelengths=[400.0, 500.0, 700.0], miss=miss, bend=0 * miss)
    found = pencil.at(np.array([300.0, 400.0, 450.0, 600.0, 700.0, 900.0]))[0][:, 0, 0]
    np.testing.assert_allclose(found, [1.0, 1.0, 2.0, 2.5, 2.0, 2.0])
    assert pencil.is_dispersive
    assert not single(1, 0, 0, 0.1, 0.0).is_dispersive


def test_sums_do_what_both_do():
    rng = np.random.default_rng(1)
    first = PencilMap(
        wavelengths=[400.0, 600.0], miss=rng.normal(size=(2, 2, 20)), bend=rng.normal(size=(2, 2, 20))
    )
    second = single(0, 1, 1, 0.3, 0.2, rims=((0.5, 1.0),), tilt=(0.1, 0.0))
    a, h = np.array([0.3, 0.4]), np.array([0.1, -0.7])
    both = (first + second)(a, h, 450.0)
    parts = first(a, h, 450.0), second.upright()(a, h, 450.0)
    np.testing.assert_allclose(both[0], parts[0][0] + parts[1][0])
    np.testing.assert_allclose(both[1] * (1 + 0.1 * a[0]), parts[0][1] + parts[1][1] - a)
    assert (first + second).rims == second.rims
    assert (first + second).tilt == second.tilt


def test_a_perfect_lens_is_perfect():
    pencil = PencilMap.perfect()
    assert pencil.is_perfect
    assert not single(0, 0, 0, 1e-9, 0.0).is_perfect
    assert not single(0, 0, 0, 0.0, 0.0, rims=((0.0, 2.0),)).is_perfect
    assert single(0, 0, 0, 0.0, 0.0, tilt=(0.1, 0.0)).upright().is_perfect


def test_tensors_have_gradients():
    pupil = torch.tensor([[0.3, 0.2]], dtype=torch.float64, requires_grad=True)
    field = torch.tensor([[0.5, -0.4]], dtype=torch.float64, requires_grad=True)
    pencil = single(1, 1, 0, 0.7, 0.3, tilt=(0.1, 0.2))
    assert torch.autograd.gradcheck(lambda a, h: pencil(a, h)[:2], (pupil, field))


def test_mistakes_are_named():
    zeros = np.zeros((1, 2, 20))
    with pytest.raises(ShapeError, match="miss"):
        PencilMap(wavelengths=[500.0, 600.0], miss=zeros, bend=zeros)
    with pytest.raises(ParameterError, match="rising"):
        PencilMap(wavelengths=[600.0, 500.0], miss=np.zeros((2, 2, 20)), bend=np.zeros((2, 2, 20)))
    with pytest.raises(ParameterError, match="finite"):
        PencilMap(wavelengths=[500.0], miss=zeros + np.nan, bend=zeros)
    with pytest.raises(ParameterError, match="rims"):
        PencilMap(wavelengths=[500.0], miss=zeros, bend=zeros, rims=((0.1, 0.0),))
