"""Zernike circle polynomials in the order and normalization of Noll."""

import math

import numpy as np

__all__ = ["NAMES", "noll_order", "radial_factors", "zernike"]

# Names of the first eleven polynomials.
NAMES = (
    "piston",
    "tilt along",
    "tilt across",
    "defocus",
    "astigmatism at 45 degrees",
    "astigmatism",
    "coma across",
    "coma along",
    "trefoil across",
    "trefoil along",
    "spherical",
)


def noll_order(number: int) -> tuple[int, int]:
    """Return the radial degree n and the angular order m of polynomial ``number``, counted from 1.

    m is above 0 for the cosine and below 0 for the sine.
    """
    degree = (math.isqrt(8 * number - 7) - 1) // 2
    place = number - degree * (degree + 1) // 2  # from 1 within its degree
    size = 2 * (place // 2) if degree % 2 == 0 else 2 * ((place - 1) // 2) + 1
    return degree, size if number % 2 == 0 else -size


def radial_factors(degree: int, order: int) -> dict[int, int]:
    """Return the powers of the radius and their factors in the radial polynomial, which is 1 at the rim.

    Args:
        degree: Radial degree n, the highest power.
        order: Absolute value of the angular order m.
    """
    half = (degree + order) // 2, (degree - order) // 2
    return {
        degree - 2 * k: (-1) ** k
        * math.factorial(degree - k)
        // (math.factorial(k) * math.factorial(half[0] - k) * math.factorial(half[1] - k))
        for k in range(half[1] + 1)
    }


def zernike(count: int, pupil: np.ndarray) -> np.ndarray:
    """Return the first ``count`` polynomials at points of the unit disc, (count, ...).

    Each has a mean square of 1 over the disc; all but the first, which is 1, have a mean of 0.

    Args:
        count: Number of polynomials.
        pupil: Points x and y, (..., 2); angles count from x towards y.

    Source:
        Noll, "Zernike polynomials and atmospheric turbulence", JOSA 66 (1976), table I.
    """
    rho, angle = np.hypot(pupil[..., 0], pupil[..., 1]), np.arctan2(pupil[..., 1], pupil[..., 0])
    polynomials = []
    for number in range(1, count + 1):
        degree, signed = noll_order(number)
        size = abs(signed)
        radial = sum(factor * rho**power for power, factor in radial_factors(degree, size).items())
        angular = np.cos(size * angle) if signed >= 0 else np.sin(size * angle)
        polynomials.append(math.sqrt((degree + 1) * (2 if size else 1)) * radial * angular)
    return np.stack(polynomials)
