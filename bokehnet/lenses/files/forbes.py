"""Conversion of Forbes's Q polynomials to powers of the height, that is, to even aspheres.

Source: Forbes, "Shape specification for axially symmetric optical surfaces", Optics Express 2007; recurrences
of the mild ones after Forbes, "Robust, efficient computational methods for axially symmetric optical
aspheres", Optics Express 2010.
"""

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Polynomial

__all__ = ["mild_powers", "strong_powers"]

# Degree, in the squared height, of the fit of the root in the mild form, and number of fitted points.
_POWERS, _POINTS = 14, 400


def strong_powers(terms: Sequence[float], radius: float) -> tuple[float, ...]:
    """Return the coefficients of the height to the powers 2, 4, 6, ... of ``u^4 sum a_m Qcon_m(u^2)``.

    u = r / radius. Exact: ``Qcon_m(x)`` is Jacobi's polynomial (0, 4) of ``2 x - 1``.
    """
    x = Polynomial([0.0, 1.0])
    total, two, one = Polynomial([0.0]), Polynomial([0.0]), Polynomial([1.0])
    for m, term in enumerate(terms):
        if m > 0:
            # Abramowitz and Stegun, 22.7.1, for alpha 0 and beta 4.
            n, b = m - 1, 4
            low = 2 * n + b
            scale = 2 * (n + 1) * (n + 1 + b) * low
            step = ((low + 1) * (-(b**2)) + low * (low + 1) * (low + 2) * (2 * x - 1)) / max(scale, 1)
            back = 2 * n * (n + b) * (low + 2) / max(scale, 1)
            two, one = one, step * one - back * two
        total = total + term * one
    return _height_coefficients(x * x * total, radius)


def mild_powers(terms: Sequence[float], radius: float, curvature: float) -> tuple[float, ...]:
    """Return the coefficients of ``u^2 (1 - u^2) / sqrt(1 - c^2 r^2) sum a_m Qbfs_m(u^2)``, as above.

    The root is not a polynomial: fitted over the whole radius, with an error of some 1e-12 of the largest sag
    for surfaces up to 60 degrees steep.
    """
    x = Polynomial([0.0, 1.0])
    total = Polynomial([0.0])
    chain: list[Polynomial] = []
    p: list[Polynomial] = []
    f, g, h = [2.0, 19**0.5 / 2], [-0.5], []
    for m, term in enumerate(terms):
        if m == 0:
            p.append(Polynomial([2.0]))
            chain.append(Polynomial([1.0]))
        elif m == 1:
            p.append(6 - 8 * x)
            chain.append((p[1] - g[0] * chain[0]) / f[1])
        else:
            p.append((2 - 4 * x) * p[m - 1] - p[m - 2])
            h.append(-m * (m - 1) / (2 * f[m - 2]))
            g.append(-(1 + g[m - 2] * h[m - 2]) / f[m - 1])
            f.append((m * (m + 1) + 3 - g[m - 1] ** 2 - h[m - 2] ** 2) ** 0.5)
            chain.append((p[m] - g[m - 1] * chain[m - 1] - h[m - 2] * chain[m - 2]) / f[m])
        total = total + term * chain[m]
    square = np.cos(np.linspace(0, np.pi / 2, _POINTS)) ** 2
    depth = square * (1 - square) * total(square) / np.sqrt(1 - (curvature * radius) ** 2 * square)
    fitted = Polynomial.fit(square, depth / np.maximum(square, 1e-12), _POWERS, domain=[0, 1], w=square)
    return _height_coefficients(x * fitted.convert(), radius)


def _height_coefficients(polynomial: Polynomial, radius: float) -> tuple[float, ...]:
    """Return the coefficients of r^2, r^4, ... of a polynomial in (r / radius)^2 without a constant."""
    return tuple(float(a) / radius ** (2 * i) for i, a in enumerate(polynomial.coef[1:], start=1))
