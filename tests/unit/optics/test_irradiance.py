"""Light from a round pupil, against the integral that the formulas solve."""

import math

import numpy as np
import pytest
import torch

from bokehnet.optics.vignette import disc_form_factor, irradiance_cos4


def integral(field, distance, radius, rings=400, spokes=400):
    """Of cos cos / (pi r^2) over the disc by the midpoint rule: Kolb et al. 1995, not simplified."""
    rho = (np.arange(rings) + 0.5) * radius / rings
    angle = (np.arange(spokes) + 0.5) * 2 * math.pi / spokes
    x, y = rho[:, None] * np.cos(angle) - field, rho[:, None] * np.sin(angle)
    square = x * x + y * y + distance * distance
    area = rho[:, None] * (radius / rings) * (2 * math.pi / spokes)
    return float((distance**2 / square**2 * area).sum() / math.pi)


CASES = [(0, 50, 18), (20, 50, 18), (60, 40, 30), (5, 3, 20)]


@pytest.mark.parametrize(("field", "distance", "radius"), CASES)
def test_form_factor_is_the_integral_over_the_disc(field, distance, radius):
    expected = integral(field, distance, radius)
    assert disc_form_factor(field, distance, radius) == pytest.approx(expected, rel=2e-5)


def test_form_factor_is_the_printed_formula():
    """Moon and Spencer, 1981, as quoted by Kolb, Mitchell and Hanrahan."""
    a, z, r = 17.0, 45.0, 12.0
    printed = (1 - (a * a + z * z - r * r) / math.sqrt((a * a + z * z + r * r) ** 2 - 4 * r * r * a * a)) / 2
    assert disc_form_factor(a, z, r) == pytest.approx(printed, rel=1e-12)


def test_both_laws_agree_for_a_small_pupil_and_part_for_a_large_one():
    assert disc_form_factor(20.0, 50.0, 1e-4) == pytest.approx(irradiance_cos4(20.0, 50.0, 1e-4), rel=1e-9)
    assert irradiance_cos4(20.0, 50.0, 25.0) / disc_form_factor(20.0, 50.0, 25.0) > 1.05


def test_gradients_are_right():
    values = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (20.0, 50.0, 12.0)]
    assert torch.autograd.gradcheck(disc_form_factor, values)
    assert torch.autograd.gradcheck(irradiance_cos4, values)
