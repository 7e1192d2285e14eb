"""Maps over the field against the formulas that their names stand for."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.errors import ParameterError
from bokehnet.optics.aberrations.field_maps import FIELD_MAPS, angular, compose, make_field_map, power

T = np.linspace(0.0, 1.1, 45)
THETA = np.linspace(-3.0, 3.0, 45)


@pytest.mark.parametrize(
    ("text", "formula"),
    [
        ("constant", lambda t, theta: 1.0),
        ("linear", lambda t, theta: t),
        ("square", lambda t, theta: t**2),
        ("cube", lambda t, theta: t**3),
        ("exponential", lambda t, theta: math.exp(t)),
        ("inversion", lambda t, theta: 1 - t),
        ("reciprocal", lambda t, theta: 1 / max(t, 0.1)),
        ("cosine", lambda t, theta: math.cos(2 * math.pi * t)),
        ("angular", lambda t, theta: t * math.cos(theta)),
        ("angular:3", lambda t, theta: t * math.cos(3 * theta)),
        ("power:2.5", lambda t, theta: t**2.5),
        ("inversion,exponential", lambda t, theta: math.exp(1 - t)),
        ("inversion, reciprocal", lambda t, theta: 1 / max(1 - t, 0.1)),
        ("square,angular:2,inversion", lambda t, theta: 1 - t**2 * math.cos(2 * theta)),
        ("inversion,power:0.5", lambda t, theta: math.sqrt(max(1 - t, 0))),
    ],
)
def test_names_mean_their_formulas(text, formula):
    """Authority: formulas of Jeong et al. 2016, a number at a time, with the guards of the docstring."""
    expected = [formula(t, theta) for t, theta in zip(T, THETA, strict=True)]
    result = make_field_map(text)
    assert_allclose(result(T, THETA), expected, rtol=1e-12, atol=1e-14)
    tensors = result(torch.from_numpy(T), torch.from_numpy(THETA))
    assert_allclose(tensors.numpy(), expected, rtol=1e-12, atol=1e-14)


def test_compose_applies_its_second_argument_first():
    """Authority: g(f(t, theta), theta), equation 4.9 of the dissertation."""
    assert compose(power(2), angular(2))(0.5, 0.3) == pytest.approx((0.5 * math.cos(0.6)) ** 2)
    assert compose(angular(2), power(2))(0.5, 0.3) == pytest.approx(0.25 * math.cos(0.6))


def test_all_names_can_be_read():
    for name, field_map in FIELD_MAPS.items():
        assert make_field_map(name) is field_map


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected names of constant, linear"),
        ("sine", "got 'sine'"),
        ("linear,", "got ''"),
        ("linear:2", "got 'linear:2'"),
        ("power", "got 'power'"),
        ("power:", "expected a number after the colon, got 'power:'"),
        ("power:x", "got 'power:x'"),
        ("power:0", "above 0 and up to 12, got 'power:0'"),
        ("angular:-1", "got 'angular:-1'"),
        ("angular:1e9", "got 'angular:1e9'"),
        ("power:nan", "finite"),
    ],
)
def test_mistakes_are_reported_in_one_line(text, words):
    with pytest.raises(ParameterError, match=r"^field_map: ") as error:
        make_field_map(text)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
