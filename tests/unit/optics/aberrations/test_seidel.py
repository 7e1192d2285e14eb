"""Seidel sums of single surfaces against what is known in closed form, and the map made of them."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH, AberrationMap
from bokehnet.optics.aberrations.seidel import (
    SeidelCoefficients,
    SeidelSums,
    surface_sums,
    uniform_irradiance,
)

EXACT = {"rtol": 1e-12, "atol": 1e-15}
NAMES = ("spherical", "coma", "astigmatism", "petzval", "distortion")


def as_rows(sums):
    return np.array([getattr(sums, name) for name in NAMES])


def pencil_of(transverse_aberration):
    return AberrationMap(
        wavelengths=np.array([DESIGN_WAVELENGTH]),
        transverse_aberration=transverse_aberration[None],
        pupil_aberration=0 * transverse_aberration[None],
    )


def miss_of(table, pupil, field):
    return pencil_of(table)(pupil, field)[0]


def random_points(count=50):
    rng = np.random.default_rng(0)
    return rng.uniform(-1, 1, (count, 2)), rng.uniform(-1, 1, (count, 2))


def test_a_surface_forms_no_spherical_aberration_or_coma_at_its_aplanatic_points():
    """Authority: Welford 1986, 6.5: for a point at r (1 + n'/n) behind the vertex, any stop."""
    before, behind, radius = 1.0, 1.6, 40.0
    distance = radius * (1 + behind / before)
    marginal = (3.0, -3.0 / distance * before)
    sums = surface_sums(marginal, (2.0, 0.1), 1 / radius, 0.0, before, behind)
    assert_allclose([sums.spherical, sums.coma, sums.astigmatism], 0, atol=1e-15)
    assert abs(sums.petzval) > 1e-4


def test_a_surface_images_its_centre_without_spherical_aberration_and_distorts_what_its_chief_ray_meets():
    """Authority: rays to the centre are not bent. The fifth sum is finite, where Welford's form divides by 0.

    With the marginal angle 0 the limit of Welford's form is taken from both sides.
    """
    radius, before, behind, chief = 25.0, 1.0, 1.5, (1.0, 0.2)

    def sums(height):
        return surface_sums((height, -2.0 / radius), chief, 1 / radius, 0.0, before, behind)

    def welford(height):
        nu, c = -2.0 / radius, 1 / radius
        a, a_chief = nu + c * height, chief[1] + c * chief[0]
        pupil_aberration = (nu - (behind - before) * c * height) / behind**2 - nu / before**2
        lagrange = chief[1] * height - nu * chief[0]
        both = a_chief**2 * height * pupil_aberration + lagrange**2 * c * (1 / behind - 1 / before)
        return -a_chief / a * both

    assert sums(2.0).spherical == pytest.approx(0, abs=1e-15)
    assert sums(2.1).distortion == pytest.approx(welford(2.1), rel=1e-12)
    assert sums(2.0).distortion == pytest.approx(0.5 * (welford(1.999) + welford(2.001)), rel=1e-6)


def test_an_ellipsoid_of_the_right_conic_focuses_parallel_light_without_spherical_aberration():
    """Authority: Descartes' oval for infinity, conic -(n / n')^2."""
    for before, behind in ((1.0, 1.7), (1.7, 1.0)):
        conic = -((before / behind) ** 2)
        sums = surface_sums((5.0, 0.0), (0.0, 0.1), 1 / 60, conic / 60**3, before, behind)
        sphere = surface_sums((5.0, 0.0), (0.0, 0.1), 1 / 60, 0.0, before, behind)
        assert abs(sums.spherical) < 1e-12 * abs(sphere.spherical)


def test_a_thin_lens_has_the_spherical_aberration_of_the_lens_makers_formula():
    """Authority: Welford 1986, 12.3: S1 = y^4 K^3 / 4 (...) by bending and conjugates, here of infinity."""
    n, power, height = 1.5, 0.01, 4.0
    for bending in (-2.0, 0.0, 1.0, 3.0):
        first = power * (bending + 1) / (2 * (n - 1))
        second = power * (bending - 1) / (2 * (n - 1))
        front = surface_sums((height, 0.0), (0.0, 0.1), first, 0.0, 1.0, n)
        arriving = -(n - 1) * first * height
        back = surface_sums((height, arriving), (0.0, 0.1), second, 0.0, n, 1.0)
        magnification = -1.0  # conjugates (u + u') / (u - u') of an object at infinity
        expected = (height**4 * power**3 / 4) * (
            (n / (n - 1)) ** 2
            + (n + 2) / (n * (n - 1) ** 2) * (bending + 2 * (n * n - 1) / (n + 2) * magnification) ** 2
            - n / (n + 2) * magnification**2
        )
        assert (front + back).spherical == pytest.approx(expected, rel=1e-12)


def test_a_shifted_stop_changes_the_sums_as_the_stop_shift_equations_say():
    """Authority: Welford 1986, 8.5, for a surface with a conic; q is the change of the chief ray."""
    marginal, chief, q = np.array([5.0, -0.05]), np.array([-1.0, 0.2]), 0.3
    surface = (1 / 30, -0.7 / 30**3, 1.0, 1.6)
    old = surface_sums(marginal, chief, *surface)
    new = surface_sums(marginal, chief + q * marginal, *surface)
    s1, s2, s3, s4, s5 = as_rows(old)
    shifted = [s1, s2 + q * s1, s3 + 2 * q * s2 + q**2 * s1, s4]
    shifted.append(s5 + q * (3 * s3 + s4) + 3 * q**2 * s2 + q**3 * s1)
    assert_allclose(as_rows(new), shifted, **EXACT)


def test_sums_of_tensors_are_those_of_numbers():
    rays = (4.0, -0.03), (1.5, 0.2)
    glass = (0.02, -0.5, 1.0, np.array([1.5, 1.52]))
    tensors = [tuple(torch.tensor(x, dtype=torch.float64) for x in ray) for ray in rays]
    sums = surface_sums(*tensors, *(torch.as_tensor(x, dtype=torch.float64) for x in glass))
    expected = surface_sums(*rays, *glass)
    for name in NAMES:
        assert_allclose(getattr(sums, name).numpy(), getattr(expected, name), **EXACT)


def test_rays_miss_by_the_gradient_of_the_wavefront():
    """Oracle: central differences of W, which is exact for polynomials of the fourth degree up to h^2."""
    sums = SeidelSums(0.3, -0.2, 0.5, 0.7, -0.4)
    lagrange = -1.7

    def wavefront(a, h):
        aa, ah, hh = (a * a).sum(-1), (a * h).sum(-1), (h * h).sum(-1)
        return (
            sums.spherical / 8 * aa**2
            + sums.coma / 2 * aa * ah
            + sums.astigmatism / 2 * ah**2
            + (sums.astigmatism + sums.petzval) / 4 * aa * hh
            + sums.distortion / 2 * ah * hh
        )

    pupil, field = random_points()
    step = 1e-4
    gradient = np.stack(
        [
            (wavefront(pupil + step * e, field) - wavefront(pupil - step * e, field)) / (2 * step)
            for e in np.eye(2)
        ],
        -1,
    )
    result = miss_of(SeidelCoefficients.from_sums(sums, lagrange).transverse_aberration(), pupil, field)
    assert_allclose(result, -gradient / lagrange, rtol=1e-6, atol=1e-8)


def test_bend_is_the_same_with_pupil_and_field_exchanged():
    """Oracle: exchanging the arguments of E turns its vector along a into one along h."""
    coefficients = SeidelCoefficients(0.1, 0.2, -0.3, 0.4, 0.5)
    pupil, field = random_points()
    expected = miss_of(coefficients.transverse_aberration(), field, pupil)
    assert_allclose(miss_of(coefficients.pupil_aberration(), pupil, field), expected, rtol=1e-12, atol=1e-14)


def test_coefficients_of_several_wavelengths_make_a_table_each():
    coma = np.array([0.1, 0.2, 0.4])
    table = SeidelCoefficients(coma=coma).transverse_aberration()
    assert table.shape == (3, 2, 20)
    for row, value in zip(table, coma, strict=True):
        assert_allclose(row, SeidelCoefficients(coma=value).transverse_aberration(), **EXACT)


def test_even_light_sends_the_same_light_through_equal_areas_and_keeps_the_rim():
    """Authority: areas grow by the divergence, here by differences; its mean over the disc is 0."""
    rise, tilt = 0.08, -0.05
    table = uniform_irradiance(rise, tilt)
    angle = np.linspace(0, 2 * np.pi, 9)
    rim = np.stack([np.cos(angle), np.sin(angle)], -1)
    field = np.broadcast_to([0.6, -0.4], rim.shape)
    assert_allclose((miss_of(table, rim, field) * rim).sum(-1), 0, atol=1e-15)
    pupil, field = random_points()
    step = 1e-4
    growth = sum(
        (miss_of(table, pupil + step * e, field) - miss_of(table, pupil - step * e, field)) @ e / (2 * step)
        for e in np.eye(2)
    )
    light = rise * ((pupil**2).sum(-1) - 0.5) + tilt * (pupil * field).sum(-1)
    assert_allclose(growth, light, atol=1e-8)
