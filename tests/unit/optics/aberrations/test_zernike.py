"""Zernike's polynomials against Noll's table and by quadrature."""

import numpy as np
import pytest

from bokehnet.optics.aberrations.zernike import NAMES, noll_order, zernike
from bokehnet.optics.sampling import disc_from_square, halton


def test_orders_are_those_of_the_table():
    """Noll 1976, table I: (n, m) of the first eleven, cosines even, sines odd."""
    degrees = [noll_order(number) for number in range(1, 12)]
    assert degrees == [
        (0, 0),
        (1, 1),
        (1, -1),
        (2, 0),
        (2, -2),
        (2, 2),
        (3, -1),
        (3, 1),
        (3, -3),
        (3, 3),
        (4, 0),
    ]
    assert len(NAMES) == len(degrees)


def test_values_are_those_of_the_table():
    """Noll 1976, table I: the fourth is sqrt(3) (2 r^2 - 1), the eighth sqrt(8) (3 r^3 - 2 r) cos."""
    point = 0.6 * np.array([np.cos(0.7), np.sin(0.7)])
    result = zernike(11, point)
    assert result[3] == pytest.approx(np.sqrt(3) * (2 * 0.36 - 1))
    assert result[7] == pytest.approx(np.sqrt(8) * (3 * 0.6**3 - 1.2) * np.cos(0.7))
    assert result[8] == pytest.approx(np.sqrt(8) * 0.6**3 * np.sin(2.1))
    assert result[10] == pytest.approx(np.sqrt(5) * (6 * 0.6**4 - 6 * 0.36 + 1))


def test_they_are_orthonormal():
    points = disc_from_square(np.stack([halton(200_000, 2), halton(200_000, 3)], -1))
    basis = zernike(28, points)
    np.testing.assert_allclose(basis @ basis.T / basis.shape[1], np.eye(28), atol=5e-3)
