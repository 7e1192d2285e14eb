"""Point maps of a single picture that are known up to a shift along the axis."""

import numpy as np

__all__ = ["shift_of_points"]

# Number of sampled points per side; two unknowns need no more.
_POINTS_PER_SIDE = 64

# Search range of the nearest depth relative to the depth range, and number of steps.
_MIN_NEAREST, _MAX_NEAREST, _STEPS = 1e-3, 1e3, 61


def shift_of_points(points: np.ndarray, surface: np.ndarray | None = None) -> float:
    """Return the depth shift that puts points on the rays of a pinhole camera.

    Shift s and focal length f minimise the squares of f x / (z + s) - u and f y / (z + s) - v, where (u, v)
    is the pixel's position relative to the middle of the picture. For each s the best f is a quotient of two
    sums; s is searched in logarithmic steps and refined by golden sections.

    Args:
        points: x, y and depth, (3, h, w), all in one unit.
        surface: Mask of valid points, (h, w); None if all are valid.

    Returns:
        Shift to add to the depth, in the unit of the points; 0 for fewer than two valid points.

    Source:
        Wang et al., "MoGe: Unlocking accurate monocular geometry estimation for open-domain images with
        optimal training supervision", CVPR 2025, section 3.1, equation 2.
    """
    _, height, width = points.shape
    rows = np.unique(np.linspace(0, height - 1, min(height, _POINTS_PER_SIDE)).round().astype(int))
    columns = np.unique(np.linspace(0, width - 1, min(width, _POINTS_PER_SIDE)).round().astype(int))
    x, y, z = points[:, rows[:, None], columns]
    u, v = np.broadcast_arrays(columns - (width - 1) / 2, (rows - (height - 1) / 2)[:, None])
    if surface is not None:
        valid = surface[rows[:, None], columns]
        x, y, z, u, v = (values[valid] for values in (x, y, z, u, v))
    if z.size < 2:
        return 0.0
    target = np.concatenate([u.ravel(), v.ravel()])
    nearest = float(z.min())
    spread = float(z.max()) - nearest or float(np.hypot(x, y).max()) or 1.0

    def misfit(exponent: float) -> float:
        depth = z + (spread * 10**exponent - nearest)
        projected = np.concatenate([(x / depth).ravel(), (y / depth).ravel()])
        focal = (projected @ target) / max(float(projected @ projected), np.finfo(float).tiny)
        return float(((focal * projected - target) ** 2).sum())

    exponents = np.linspace(np.log10(_MIN_NEAREST), np.log10(_MAX_NEAREST), _STEPS)
    best = int(np.argmin([misfit(exponent) for exponent in exponents]))
    low, high = float(exponents[max(best - 1, 0)]), float(exponents[min(best + 1, _STEPS - 1)])
    golden = (5**0.5 - 1) / 2
    for _ in range(60):
        left, right = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, right) if misfit(left) <= misfit(right) else (left, high)
    return spread * 10 ** ((low + high) / 2) - nearest
