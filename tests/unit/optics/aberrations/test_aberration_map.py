"""The aberration map. Authority: its formula, written out for single terms; symmetry about the axis."""

import math

import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH, TERMS, AberrationMap, term


def single(i: int, j: int, k: int, f: float, g: float, **others) -> AberrationMap:
    transverse_aberration, pupil_aberration = np.zeros((1, 2, len(TERMS))), np.zeros((1, 2, len(TERMS)))
    transverse_aberration[0, :, term(i, j, k)] = f, g
    pupil_aberration[0, :, term(i, j, k)] = -f, g
    return AberrationMap(
        wavelengths=[DESIGN_WAVELENGTH],
        transverse_aberration=transverse_aberration,
        pupil_aberration=pupil_aberration,
        **others,
    )


@pytest.mark.parametrize(("i", "j", "k"), TERMS)
def test_each_term_is_its_monomial(i, j, k):
    a, h = np.array([0.3, -0.6]), np.array([0.5, 0.2])
    monomial = (a @ a) ** i * (a @ h) ** j * (h @ h) ** k
    transverse_aberration, run, passes = single(i, j, k, 0.7, -0.4)(a, h)
    np.testing.assert_allclose(transverse_aberration, (0.7 * a - 0.4 * h) * monomial, rtol=1e-12)
    np.testing.assert_allclose(run, a + (-0.7 * a - 0.4 * h) * monomial, rtol=1e-12)
    assert passes


def test_a_turned_picture_is_turned_and_a_mirrored_one_mirrored():
    rng = np.random.default_rng(0)
    transverse_aberration, pupil_aberration = rng.normal(size=(2, 1, 2, len(TERMS)))
    aberration_map = AberrationMap(
        wavelengths=[500.0], transverse_aberration=transverse_aberration, pupil_aberration=pupil_aberration
    )
    a, h = rng.uniform(-0.7, 0.7, (2, 5, 2))
    turn = np.array([[math.cos(0.8), -math.sin(0.8)], [math.sin(0.8), math.cos(0.8)]])
    for change in (turn, np.diag([1.0, -1.0])):
        for plain, changed in zip(
            aberration_map(a, h)[:2], aberration_map(a @ change.T, h @ change.T)[:2], strict=True
        ):
            np.testing.assert_allclose(changed, plain @ change.T, atol=1e-12)


def test_tilt_divides_and_rims_cut():
    aberration_map = single(
        0, 0, 0, 0.0, 0.0, tilt=(0.2, -0.5), vignetting_apertures=((0.5, 0.9), (-0.3, 1.1))
    )
    a = np.array([[0.5, 0.5], [-0.6, 0.3], [0.0, 0.95]])
    _, run, passes = aberration_map(a, np.array([0.8, 0.0]))
    np.testing.assert_allclose(run, a / (1 + a @ [0.2, -0.5])[:, None])
    centres, radii = np.array([[0.4, 0.0], [-0.24, 0.0]]), (0.9, 1.1)
    expected = [all(np.linalg.norm(p - c) <= r for c, r in zip(centres, radii, strict=True)) for p in a]
    assert expected == [False, False, False] or True in expected
    np.testing.assert_array_equal(passes, expected)


def test_wavelengths_are_joined_by_straight_lines():
    transverse_aberration = np.zeros((3, 2, len(TERMS)))
    transverse_aberration[:, 0, 0] = 1.0, 3.0, 2.0
    aberration_map = AberrationMap(
        wavelengths=[400.0, 500.0, 700.0],
        transverse_aberration=transverse_aberration,
        pupil_aberration=0 * transverse_aberration,
    )
    result = aberration_map.at(np.array([300.0, 400.0, 450.0, 600.0, 700.0, 900.0]))[0][:, 0, 0]
    np.testing.assert_allclose(result, [1.0, 1.0, 2.0, 2.5, 2.0, 2.0])
    assert aberration_map.is_dispersive
    assert not single(1, 0, 0, 0.1, 0.0).is_dispersive


def test_sums_do_what_both_do():
    rng = np.random.default_rng(1)
    first = AberrationMap(
        wavelengths=[400.0, 600.0],
        transverse_aberration=rng.normal(size=(2, 2, 20)),
        pupil_aberration=rng.normal(size=(2, 2, 20)),
    )
    second = single(0, 1, 1, 0.3, 0.2, vignetting_apertures=((0.5, 1.0),), tilt=(0.1, 0.0))
    a, h = np.array([0.3, 0.4]), np.array([0.1, -0.7])
    both = (first + second)(a, h, 450.0)
    parts = first(a, h, 450.0), second.without_tilt()(a, h, 450.0)
    np.testing.assert_allclose(both[0], parts[0][0] + parts[1][0])
    np.testing.assert_allclose(both[1] * (1 + 0.1 * a[0]), parts[0][1] + parts[1][1] - a)
    assert (first + second).vignetting_apertures == second.vignetting_apertures
    assert (first + second).tilt == second.tilt


def test_a_perfect_lens_is_perfect():
    aberration_map = AberrationMap.perfect()
    assert aberration_map.is_perfect
    assert not single(0, 0, 0, 1e-9, 0.0).is_perfect
    assert not single(0, 0, 0, 0.0, 0.0, vignetting_apertures=((0.0, 2.0),)).is_perfect
    assert single(0, 0, 0, 0.0, 0.0, tilt=(0.1, 0.0)).without_tilt().is_perfect


def test_tensors_have_gradients():
    pupil = torch.tensor([[0.3, 0.2]], dtype=torch.float64, requires_grad=True)
    field = torch.tensor([[0.5, -0.4]], dtype=torch.float64, requires_grad=True)
    aberration_map = single(1, 1, 0, 0.7, 0.3, tilt=(0.1, 0.2))
    assert torch.autograd.gradcheck(lambda a, h: aberration_map(a, h)[:2], (pupil, field))


def test_mistakes_are_named():
    zeros = np.zeros((1, 2, 20))
    with pytest.raises(ShapeError, match="transverse_aberration"):
        AberrationMap(wavelengths=[500.0, 600.0], transverse_aberration=zeros, pupil_aberration=zeros)
    with pytest.raises(ParameterError, match="rising"):
        AberrationMap(
            wavelengths=[600.0, 500.0],
            transverse_aberration=np.zeros((2, 2, 20)),
            pupil_aberration=np.zeros((2, 2, 20)),
        )
    with pytest.raises(ParameterError, match="finite"):
        AberrationMap(wavelengths=[500.0], transverse_aberration=zeros + np.nan, pupil_aberration=zeros)
    with pytest.raises(ParameterError, match="vignetting_apertures"):
        AberrationMap(
            wavelengths=[500.0],
            transverse_aberration=zeros,
            pupil_aberration=zeros,
            vignetting_apertures=((0.1, 0.0),),
        )


def test_the_map_of_the_axis_has_its_rays_everywhere():
    """Authority: the same map at the field position (0, 0)."""
    rng = np.random.default_rng(0)
    transverse_aberration, pupil_aberration = 0.1 * rng.normal(size=(2, 2, 2, len(TERMS)))
    whole = AberrationMap(
        wavelengths=[450.0, 650.0],
        transverse_aberration=transverse_aberration,
        pupil_aberration=pupil_aberration,
        vignetting_apertures=((0.5, 0.9), (0.0, -0.3)),
        tilt=(0.2, -0.1),
    )
    a, h = rng.uniform(-0.7, 0.7, (2, 50, 2))
    on_axis = whole.on_axis()
    for wavelength in (450.0, 520.0):
        expected = whole(a, np.zeros_like(h), wavelength)
        assert not np.allclose(whole(a, h, wavelength)[0], expected[0])
        for got, axis in zip(on_axis(a, h, wavelength), expected, strict=True):
            np.testing.assert_allclose(got, axis, atol=1e-12)
