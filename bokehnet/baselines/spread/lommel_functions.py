"""Light around a defocused point, by Lommel's functions of two variables.

In optical units, with a circular pupil of half-angle a / f and wave number k: ``u = k (a / f)^2 z`` at
defocus z, ``v = k (a / f) r`` at distance r; the edge of the geometrical disc lies at v = u, and the defocus
at the pupil's edge is u / (4 pi) waves.
"""

import math

import numpy as np

__all__ = ["bessel_orders", "lommel_intensity"]

# Distances whose Bessel functions are held at a time.
_AT_ONCE = 2048


def bessel_orders(orders: int, v: np.ndarray) -> np.ndarray:
    """Bessel functions J_0 ... J_orders of ``v`` > 0, (orders + 1, N), by recurrence from high orders down.

    Source:
        Press et al., "Numerical recipes", 6.5: Miller's algorithm, normalised by J_0 + 2 (J_2 + J_4 ...) = 1.
    """
    v = np.asarray(v, float)
    start = 2 * (max(orders, math.ceil(float(v.max()))) // 2 + 12 + math.ceil(2 * float(v.max()) ** 0.5))
    found = np.zeros((orders + 1, v.size))
    above, here, total = np.zeros(v.size), np.full(v.size, 1e-200), np.zeros(v.size)
    for order in range(start, -1, -1):
        if order <= orders:
            found[order] = here
        if order % 2 == 0:
            total += here if order == 0 else 2 * here
        above, here = here, 2 * order / v * here - above
        large = np.abs(here) > 1e100
        if large.any():
            for array in (above, here, total):
                array[large] *= 1e-100
            found[:, large] *= 1e-100
    return found / total


def lommel_intensity(u: float, v: np.ndarray) -> np.ndarray:
    """Intensity at distances ``v`` of a point out of focus by ``u``, over that in the middle of focus.

    Args:
        u: Defocus in optical units, of either sign.
        v: Distances in optical units, from 0 up, (N,).

    Returns:
        (N,) float64. Inside the geometrical disc, v < u, with V_n the sum over s of
        (-1)^s (v/u)^(n+2s) J_(n+2s)(v),

            I = (2/u)^2 (1 + V_0^2 + V_1^2 - 2 V_0 cos((u + v^2/u) / 2) - 2 V_1 sin((u + v^2/u) / 2));

        outside it, with U_n the same of (u/v), I = (2/u)^2 (U_1^2 + U_2^2).

    Source:
        Born and Wolf, "Principles of optics", 8.8. Potmesil and Chakravarty, 1981, use the second form;
        thesis 000 prints it, eq. 3.14, with V for U, which would leave the middle dark at every defocus.
    """
    u, v = abs(float(u)), np.maximum(np.abs(np.asarray(v, float)), 1e-6)
    if v.size > _AT_ONCE:
        parts = np.array_split(v, -(-v.size // _AT_ONCE))
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

    zeroth, one, two = lommel(0), lommel(1), lommel(2)
    phase = 0.5 * (u + v * v / u)
    within = 1 + zeroth**2 + one**2 - 2 * zeroth * np.cos(phase) - 2 * one * np.sin(phase)
    return np.asarray((2 / u) ** 2 * np.where(inside, within, one**2 + two**2))
