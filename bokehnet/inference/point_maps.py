"""Maps of points from a single picture that are known up to a shift along the axis."""

import numpy as np

__all__ = ["shift_of_points"]

# Points of a side that are looked at; so few unknowns need no more.
_SIDE = 64

# The nearest point's depth over the spread of depths, between which the shift is looked for, and steps.
_NEAREST, _FARTHEST, _STEPS = 1e-3, 1e3, 61


def shift_of_points(points: np.ndarray, surface: np.ndarray | None = None) -> float:
    """Return what is to be added to the depth of points so that they lie on the rays of a pinhole camera.

    The shift s and a focal length f are those with the least squares of f x / (z + s) - u and
    f y / (z + s) - v, where (u, v) is the pixel's place from the middle of the picture. For each s the best f
    is a quotient of two sums; s is found by logarithmic steps and then by golden sections.

    Args:
        points: x, y and depth, (3, h, w), all in one unit.
        surface: Where they mean something, (h, w); None for everywhere.

    Returns:
        The shift in the points' unit; 0 where fewer than two points mean something.

    Source:
        Wang et al., "MoGe: Unlocking accurate monocular geometry estimation for open-domain images with
        optimal training supervision", CVPR 2025, section 3.1, equation 2.
    """
    _, height, width = points.shape
    rows = np.unique(np.linspace(0, height - 1, min(height, _SIDE)).round().astype(int))
    columns = np.unique(np.linspace(0, width - 1, min(width, _SIDE)).round().astype(int))
    x, y, z = points[:, rows[:, None], columns]
    u, v = np.broadcast_arrays(columns - (width - 1) / 2, (rows - (height - 1) / 2)[:, None])
    if surface is not None:
        seen = surface[rows[:, None], columns]
        x, y, z, u, v = (values[seen] for values in (x, y, z, u, v))
    if z.size < 2:
        return 0.0
    target = np.concatenate([u.ravel(), v.ravel()])
    nearest = float(z.min())
    spread = float(z.max()) - nearest or float(np.hypot(x, y).max()) or 1.0

    def misfit(exponent: float) -> float:
        depth = z + (spread * 10**exponent - nearest)
        place = np.concatenate([(x / depth).ravel(), (y / depth).ravel()])
        focal = (place @ target) / max(float(place @ place), np.finfo(float).tiny)
        return float(((focal * place - target) ** 2).sum())

    exponents = np.linspace(np.log10(_NEAREST), np.log10(_FARTHEST), _STEPS)
    best = int(np.argmin([misfit(exponent) for exponent in exponents]))
    low, high = float(exponents[max(best - 1, 0)]), float(exponents[min(best + 1, _STEPS - 1)])
    golden = (5**0.5 - 1) / 2
    for _ in range(60):
        left, right = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, right) if misfit(left) <= misfit(right) else (left, high)
    return spread * 10 ** ((low + high) / 2) - nearest
