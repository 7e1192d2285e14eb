"""Bounded least squares by the method of Levenberg and Marquardt."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["Solution", "solve"]

_DAMPING_FACTOR, _MAX_DAMPING, _MIN_RELATIVE_DECREASE = 4.0, 1e8, 1e-6


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Solution:
    """Result of a fit.

    Attributes:
        values: Parameters, (P,).
        deviation: Standard deviation of each by the residual noise, (P,); infinite if undetermined.
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
    """Return the values within bounds that minimize the sum of squared residuals, near ``start``.

    Args:
        residuals: Function from values (P,) to residuals (N,).
        jacobian: Function from values and their residuals to derivatives, (N, P).
        start: Initial values.
        low: Lower bounds.
        high: Upper bounds.
        steps: Maximum number of iterations.

    Source:
        Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", J. SIAM 1963, with his
        scaling; values that would leave their bounds stay on them.
    """
    values = np.clip(start, low, high)
    current = residuals(values)
    cost, damping = float(current @ current), 1e-2
    derivatives = jacobian(values, current)
    for _ in range(steps):
        normal, slope = derivatives.T @ derivatives, derivatives.T @ current
        # Values at a bound that would leave it are fixed.
        fixed = ((values <= low) & (slope > 0)) | ((values >= high) & (slope < 0))
        free = np.flatnonzero(~fixed & (np.diag(normal) > 0))
        if not free.size:
            break
        part = normal[np.ix_(free, free)]
        before = cost
        while damping < _MAX_DAMPING:
            step = np.linalg.lstsq(part + damping * np.diag(np.diag(part)), -slope[free], rcond=None)[0]
            trial = values.copy()
            trial[free] = np.clip(values[free] + step, low[free], high[free])
            trial_residuals = residuals(trial)
            if float(trial_residuals @ trial_residuals) < cost:
                values, current, cost = trial, trial_residuals, float(trial_residuals @ trial_residuals)
                damping = max(damping / _DAMPING_FACTOR, 1e-9)
                break
            damping *= _DAMPING_FACTOR
        if cost > before * (1 - _MIN_RELATIVE_DECREASE):
            break
        derivatives = jacobian(values, current)
    return Solution(values=values, deviation=_deviation(derivatives, cost), cost=cost)


def _deviation(derivatives: np.ndarray, cost: float) -> np.ndarray:
    scale = np.sqrt((derivatives**2).sum(0))
    known = scale > 0
    unit = derivatives[:, known] / scale[known]
    noise = cost / max(1, len(derivatives) - known.sum())
    spread = np.full(len(scale), np.inf)
    spread[known] = np.sqrt(np.maximum(np.diag(np.linalg.pinv(unit.T @ unit)), 0) * noise) / scale[known]
    return spread
