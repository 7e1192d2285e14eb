"""Bounded least squares by the method of Levenberg and Marquardt."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["Solution", "solve"]

_GAIN, _LARGEST_DAMPING, _SETTLED = 4.0, 1e8, 1e-6


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solution:
    """What was found.

    Attributes:
        values: Of the parameters, (P,).
        deviation: Standard deviation of each by the noise that is left, (P,); infinite where nothing tells.
        cost: Sum of squared residuals.
    """

    values: np.ndarray
    deviation: np.ndarray
    cost: float


def solve(
    residuals: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray, np.ndarray], np.ndarray],
    start: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    steps: int,
) -> Solution:
    """Find the values within bounds with the least sum of squared residuals, near ``start``.

    Args:
        residuals: From values (P,) to (N,).
        jacobian: From values and their residuals to derivatives, (N, P).
        start: Values to begin with.
        low: Smallest values.
        high: Largest values.
        steps: The most that are taken.

    Source:
        Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", J. SIAM 1963, with his
        scaling; values that would leave their bounds stay on them.
    """
    values = np.clip(start, low, high)
    left = residuals(values)
    cost, damping = float(left @ left), 1e-2
    derivatives = jacobian(values, left)
    for _ in range(steps):
        normal, slope = derivatives.T @ derivatives, derivatives.T @ left
        # A value at its bound that would go beyond it is held.
        held = ((values <= low) & (slope > 0)) | ((values >= high) & (slope < 0))
        free = np.flatnonzero(~held & (np.diag(normal) > 0))
        if not free.size:
            break
        part = normal[np.ix_(free, free)]
        before = cost
        while damping < _LARGEST_DAMPING:
            step = np.linalg.lstsq(part + damping * np.diag(np.diag(part)), -slope[free], rcond=None)[0]
            tried = values.copy()
            tried[free] = np.clip(values[free] + step, low[free], high[free])
            found = residuals(tried)
            if float(found @ found) < cost:
                values, left, cost = tried, found, float(found @ found)
                damping = max(damping / _GAIN, 1e-9)
                break
            damping *= _GAIN
        if cost > before * (1 - _SETTLED):
            break
        derivatives = jacobian(values, left)
    return Solution(values=values, deviation=_deviation(derivatives, cost), cost=cost)


def _deviation(derivatives: np.ndarray, cost: float) -> np.ndarray:
    scale = np.sqrt((derivatives**2).sum(0))
    known = scale > 0
    unit = derivatives[:, known] / scale[known]
    noise = cost / max(1, len(derivatives) - known.sum())
    spread = np.full(len(scale), np.inf)
    spread[known] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(unit.T @ unit)), 0) * noise) / scale[known]
    return spread
