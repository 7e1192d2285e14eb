"""Distortion: position of the chief ray of a point relative to that of a lens without distortion.

Positions are (..., 2), right and down from the optical axis, in half-diagonals of the picture, so that the
corner has radius 1. u is a position in the undistorted picture, d the position in the distorted one. Barrel
distortion draws the corner inwards, |d| < |u|; pincushion distortion pushes it outwards.

Each model provides both directions, ``undistort`` (d to u, as resampling needs it) and ``distort`` (u to d).
Positions without a counterpart, beyond the radius at which the model folds over, become infinite. All methods
accept NumPy arrays and tensors; in torch they are differentiable once with respect to positions and
coefficients.
"""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, array_namespace, check_numbers, check_range
from bokehnet.errors import ParameterError
from bokehnet.optics.scalars import value_of, without_gradient

__all__ = ["BrownConrady", "Distortion", "DivisionModel"]

_MAX_ITERATIONS = 60
_TOLERANCE = 1e-11  # half-diagonals
_FOLD_LIMIT = 1 - 1e-9  # fraction of the radius of the fold, at which the Jacobian is singular


@dataclass(frozen=True, kw_only=True, slots=True)
class DivisionModel:
    """Division model ``u = d / (1 + strength |d|^2)``: one coefficient, closed form in both directions.

    Attributes:
        strength: Relative shift of the corner, ``|d| / |u| - 1`` at |d| = 1: -0.1 draws it inwards by 10 %
            (barrel), 0.1 pushes it outwards (pincushion), 0 is the identity. Between -0.9 and 0.9. A float,
            or a tensor without dimensions.

    Raises:
        ParameterError: ``strength`` is out of range.

    Source:
        Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens distortion", 2001.
    """

    strength: Array

    def __post_init__(self) -> None:
        check_range("strength", self.strength, -0.9, 0.9)

    @property
    def reach(self) -> float:
        """Radius |d| up to which the mapping is one-to-one: ``|strength| |d|^2 = 1``."""
        strength = abs(value_of(self.strength))
        return 1 / math.sqrt(strength) if strength > 0 else math.inf

    def undistort(self, d: Array) -> Array:
        """Return u, (..., 2)."""
        xp = array_namespace(d)
        square = (d * d).sum(-1)
        inside = abs(value_of(self.strength)) * square < 1
        u = d / (1 + self.strength * xp.where(inside, square, 0 * square))[..., None]
        return xp.where(inside[..., None], u, math.inf)

    def distort(self, u: Array) -> Array:
        """Return d, (..., 2): the root of ``K |u| |d|^2 - |d| + |u| = 0`` that is |u| at K = 0."""
        xp = array_namespace(u)
        under_root = 1 - 4 * self.strength * (u * u).sum(-1)
        inside = under_root > 0
        d = 2 * u / (1 + xp.where(inside, under_root, 1 + 0 * under_root) ** 0.5)[..., None]
        return xp.where(inside[..., None], d, math.inf)


@dataclass(frozen=True, kw_only=True, slots=True)
class BrownConrady:
    """Radial and decentring polynomials of camera calibration, inverted by Newton's method.

    With (x, y) = u and r = |u|::

        d_x = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
        d_y = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y

    Calibrations that measure positions in focal lengths give ``k_i = k_i' (D / f)^(2 i)`` and
    ``p_i = p_i' D / f``, D the half-diagonal and f the focal length in the same unit.

    Attributes:
        radial: (k1, k2, k3); below 0 barrel, above 0 pincushion. Floats, or tensors without dimensions.
        decentring: (p1, p2). Floats, or tensors without dimensions.

    Raises:
        ParameterError: A coefficient is not finite.

    Source:
        Brown, "Decentering distortion of lenses", 1966; after Conrady, "Decentred lens-systems", 1919.
    """

    radial: tuple[Array, Array, Array] = (0.0, 0.0, 0.0)
    decentring: tuple[Array, Array] = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_numbers("radial", self.radial, 3)
        check_numbers("decentring", self.decentring, 2)

    @property
    def reach(self) -> float:
        """Radius |d| at which the radial polynomial turns back; ignores decentring."""
        fold = self._fold
        k1, k2, k3 = map(value_of, self.radial)
        square = fold * fold
        return fold if math.isinf(fold) else fold * (1 + square * (k1 + square * (k2 + square * k3)))

    @property
    def _fold(self) -> float:
        """Radius |u| where d|d|/d|u| = 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6 becomes 0."""
        k1, k2, k3 = map(value_of, self.radial)
        # Roots 1 / r^2, which stay accurate for small coefficients.
        inverse = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3])
        real = inverse[np.abs(inverse.imag) < 1e-9 * np.abs(inverse)].real
        largest = max(real, default=0.0)
        return 1 / math.sqrt(largest) if largest > 1e-12 else math.inf  # a million half-diagonals

    def distort(self, u: Array) -> Array:
        """Return d, (..., 2)."""
        xp = array_namespace(u)
        inside = ((u * u).sum(-1) ** 0.5 < self._fold)[..., None]
        return xp.where(inside, self._polynomial(xp.where(inside, u, 0 * u)), math.inf)

    def undistort(self, d: Array) -> Array:
        """Return u, (..., 2).

        Raises:
            ParameterError: Decentring so strong that positions within the reach have no u, or several.
        """
        xp = array_namespace(d)
        inside = ((d * d).sum(-1) ** 0.5 < _FOLD_LIMIT * self.reach)[..., None]
        goal = xp.where(inside, d, 0 * d)
        fixed, model = without_gradient(goal), self._without_gradient()
        with np.errstate(all="ignore"):  # diverging steps raise below
            u = model._solve_newton(fixed)
            jacobian = model._jacobian(u)
            residual = float(abs(fixed - model._polynomial(u)).max())
            smallest_determinant = float(_determinant(jacobian).min())
        if not (residual < 1e-6 and smallest_determinant > 0):
            raise ParameterError(
                "decentring",
                "with `radial`, a picture that nowhere folds over itself",
                tuple(map(value_of, self.decentring)),
                "take smaller coefficients",
            )
        # At the solution one more step is 0, but its gradient is that of the inverse function.
        return xp.where(inside, u + _solve(jacobian, goal - self._polynomial(u)), math.inf)

    def _solve_newton(self, d: Array) -> Array:
        """Return the root of Newton's method started at d, within the fold; the caller checks convergence."""
        u = d
        for _ in range(_MAX_ITERATIONS):
            step = _solve(self._jacobian(u), d - self._polynomial(u))
            u = self._within_fold(u + step)
            if not float(abs(step).max()) > _TOLERANCE:
                break
        return u

    def _polynomial(self, u: Array) -> Array:
        x, y = u[..., 0], u[..., 1]
        (k1, k2, k3), (p1, p2) = self.radial, self.decentring
        square = x * x + y * y
        gain = 1 + square * (k1 + square * (k2 + square * k3))
        across = 2 * x * y
        right = x * gain + p1 * across + p2 * (square + 2 * x * x)
        down = y * gain + p1 * (square + 2 * y * y) + p2 * across
        return array_namespace(u).stack([right, down], -1)

    def _jacobian(self, u: Array) -> tuple[Array, Array, Array]:
        """Return the derivatives of d: d_x by x, d_x by y (equal to d_y by x), d_y by y."""
        x, y = u[..., 0], u[..., 1]
        (k1, k2, k3), (p1, p2) = self.radial, self.decentring
        square = x * x + y * y
        gain = 1 + square * (k1 + square * (k2 + square * k3))
        slope = 2 * (k1 + square * (2 * k2 + square * 3 * k3))
        return (
            gain + x * x * slope + 2 * p1 * y + 6 * p2 * x,
            x * y * slope + 2 * (p1 * x + p2 * y),
            gain + y * y * slope + 6 * p1 * y + 2 * p2 * x,
        )

    def _within_fold(self, u: Array) -> Array:
        fold = self._fold
        if math.isinf(fold):
            return u
        fold *= _FOLD_LIMIT
        radius = (u * u).sum(-1)[..., None] ** 0.5
        return u * array_namespace(u).clip(fold / (radius + 1e-9), None, 1)

    def _without_gradient(self) -> "BrownConrady":
        radial, decentring = (
            tuple(map(without_gradient, numbers)) for numbers in (self.radial, self.decentring)
        )
        return BrownConrady(radial=radial, decentring=decentring)  # type: ignore[arg-type]


Distortion = DivisionModel | BrownConrady


def _determinant(jacobian: tuple[Array, Array, Array]) -> Array:
    xx, xy, yy = jacobian
    return xx * yy - xy * xy


def _solve(jacobian: tuple[Array, Array, Array], right: Array) -> Array:
    """Solve the 2 x 2 system of each position."""
    xx, xy, yy = jacobian
    determinant = _determinant(jacobian)
    a, b = right[..., 0], right[..., 1]
    return array_namespace(right).stack(
        [(yy * a - xy * b) / determinant, (xx * b - xy * a) / determinant], -1
    )
