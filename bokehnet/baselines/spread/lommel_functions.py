"""Intensity around a defocused point, by Lommel's functions of two variables.

In optical units, with a circular pupil of half-angle a / f and wave number k: ``u = k (a / f)^2 z`` at
defocus z, ``v = k (a / f) r`` at distance r; the edge of the geometrical disc lies at v = u, and the defocus
at the pupil's edge is u / (4 pi) waves.
"""

import math

import numpy as np

__all__ = ["bessel_orders", "lommel_intensity"]

# Maximum number of distances per block of Bessel functions.
_MAX_DISTANCES = 2048


def bessel_orders(orders: int, v: np.ndarray) -> np.ndarray:
    """Return the Bessel functions J_0 ... J_orders of ``v`` > 0, (orders + 1, N), by downward recurrence.

    Source:
        Press et al., "Numerical recipes", 6.5: Miller's algorithm, normalised by J_0 + 2 (J_2 + J_4 ...) = 1.
    """
    v = np.asarray(v, float)
    start = 2 * (max(orders, math.ceil(float(v.max()))) // 2 + 12 + math.ceil(2 * float(v.max()) ** 0.5))
    values = np.zeros((orders + 1, v.size))
    higher, current, total = np.zeros(v.size), np.full(v.size, 1e-200), np.zeros(v.size)
    for order in range(start, -1, -1):
        if order <= orders:
            values[order] = current
        if order % 2 == 0:
            total += current if order == 0 else 2 * current
        higher, current = current, 2 * order / v * current - higher
        large = np.abs(current) > 1e100
        if large.any():
            for array in (higher, current, total):
                array[large] *= 1e-100
            values[:, large] *= 1e-100
    return values / total


def lommel_intensity(u: float, v: np.ndarray) -> np.ndarray:
    """Return the intensity at distances ``v`` from a point with defocus ``u``, relative to the peak in focus.

    Args:
        u: Defocus in optical units, of either sign.
        v: Distances in optical units, at least 0, (N,).

    Returns:
        Relative intensities, (N,) float64. Inside the geometrical disc, v < u, with V_n the sum over s of
        (-1)^s (v/u)^(n+2s) J_(n+2s)(v),

            I = (2/u)^2 (1 + V_0^2 + V_1^2 - 2 V_0 cos((u + v^2/u) / 2) - 2 V_1 sin((u + v^2/u) / 2));

        outside it, with U_n the same sum with (u/v), I = (2/u)^2 (U_1^2 + U_2^2).

    Source:
        Born and Wolf, "Principles of optics", 8.8. Potmesil and Chakravarty, 1981, use the second form;
        thesis 000 prints it, eq. 3.14, with V for U, for which the centre would be dark at every defocus.
    """
    u, v = abs(float(u)), np.maximum(np.abs(np.asarray(v, float)), 1e-6)
    if v.size > _MAX_DISTANCES:
        parts = np.array_split(v, -(-v.size // _MAX_DISTANCES))
        return np.concatenate([lommel_intensity(u, part) for part in parts])
    if u < 1e-3:
        return np.asarray((2 * bessel_orders(1, v)[1] / v) ** 2)
    orders = math.ceil(float(v.max()) + 10 * float(v.max()) ** (1 / 3) + 20)
    bessel = bessel_orders(orders, v)
    inside = v < u
    ratio = np.where(inside, v / u, u / v)

    def lommel(first: int) -> np.ndarray:
        sums = np.zeros_like(v)
        for step, order in enumerate(range(first, orders + 1, 2)):
            sums += (-1) ** step * ratio**order * bessel[order]
        return sums

    zeroth, first_order, second_order = lommel(0), lommel(1), lommel(2)
    phase = 0.5 * (u + v * v / u)
    inner_intensity = (
        1 + zeroth**2 + first_order**2 - 2 * zeroth * np.cos(phase) - 2 * first_order * np.sin(phase)
    )
    return np.asarray((2 / u) ** 2 * np.where(inside, inner_intensity, first_order**2 + second_order**2))
