import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear


def iec_decode(value: float) -> float:
    """IEC 61966-2-1, written out for one positive number."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


VALUES = [0.0, 1e-6, 0.002, 0.04, 0.04045, 0.0405, 0.1, 0.5, 0.9, 1.0, 1.5, 4.0]


@pytest.mark.parametrize("value", VALUES)
def test_decoding_equals_the_iec_formula(value):
    assert float(srgb_to_linear(value)) == pytest.approx(iec_decode(value), rel=1e-12)


def test_known_values_of_8_bit_srgb():
    """Middle grey 119 is 18.4 % and 188 is 50.3 %, from the tables that accompany IEC 61966-2-1."""
    assert_allclose(srgb_to_linear(np.array([119, 188]) / 255), [0.18447, 0.50289], atol=1e-5)


@pytest.mark.parametrize(("dtype", "rtol"), [(np.float32, 2e-6), (np.float64, 1e-12)])
def test_encoding_inverts_decoding_and_keeps_the_dtype(dtype, rtol):
    values = np.concatenate([-np.geomspace(1e-6, 100, 200)[::-1], [0], np.geomspace(1e-6, 100, 200)]).astype(
        dtype
    )
    away_from_knee = np.abs(np.abs(values) - 0.0031308) > 1e-6
    back = srgb_to_linear(linear_to_srgb(values))
    assert back.dtype == dtype
    assert_allclose(back[away_from_knee], values[away_from_knee], rtol=rtol)


def test_both_are_odd_and_unclipped():
    values = np.linspace(0, 10, 101)
    assert_allclose(srgb_to_linear(-values), -srgb_to_linear(values))
    assert_allclose(linear_to_srgb(-values), -linear_to_srgb(values))
    assert (np.diff(linear_to_srgb(values)) > 0).all()


@pytest.mark.parametrize("function", [srgb_to_linear, linear_to_srgb])
def test_tensors_give_the_values_of_arrays_and_right_gradients(function):
    """Oracle for the gradient: finite differences in double precision."""
    torch = pytest.importorskip("torch")
    values = torch.tensor(
        [-2.0, -0.3, -0.001, 0.0, 0.001, 0.3, 1.0, 3.0], dtype=torch.float64, requires_grad=True
    )
    assert_allclose(function(values).detach().numpy(), function(values.detach().numpy()), rtol=1e-12)
    assert torch.autograd.gradcheck(function, values)


def test_gradient_at_black_is_the_slope_of_the_straight_line():
    torch = pytest.importorskip("torch")
    black = torch.zeros(1, requires_grad=True)
    (gradient,) = torch.autograd.grad(linear_to_srgb(black).sum(), black)
    assert gradient.item() == pytest.approx(12.92)
