"""Texture inside out-of-focus discs: rings of a machined asphere, dust and uneven coating.

Both are patterns of mean 0 in pupil coordinates; callers scale them by a contrast and add 1.
"""

from functools import lru_cache

import numpy as np

__all__ = ["disc_grain", "onion_rings"]

# Octaves of the grain: cells across the diameter of the pupil, amplitude, and angle in radians. The
# rotations differ so that no direction dominates.
_LATTICES = ((12, 0.25, 0.3), (24, 0.35, 0.9), (48, 0.4, 1.4))


def onion_rings(rho: np.ndarray, rings: float) -> np.ndarray:
    """Return the brightness, -1 to 1, of the rings that a lathe leaves on a surface.

    A ripple of the surface bends light towards its crests, so that rings that are bright behind focus are
    dark in front of it. The ripple has one period per ring; like the feed of a lathe, it need not end at a
    whole period at the rim. The mean brightness over the disc is 0, so that rings only redistribute light.

    Args:
        rho: Distance from the centre of the pupil, pupil radii, any shape.
        rings: Number of periods from the centre to the rim.

    Returns:
        Brightness, of the shape of ``rho``.

    Source:
        "Efficient and expressive rendering for real-time defocus blur and bokeh" (dissertation), 5.2.3, for
        ringing and grain as parts of the texture of an aperture; their formulas are our own.
    """
    phase = 2 * np.pi * rings
    # Mean of cos(phase rho) over the unit disc: 2 (cos p + p sin p - 1) / p^2.
    mean = 2 * (np.cos(phase) + phase * np.sin(phase) - 1) / phase**2
    return np.asarray((np.cos(phase * rho) - mean) / (1 + abs(mean)))


@lru_cache(maxsize=8)
def _lattices(seed: int) -> tuple[np.ndarray, ...]:
    """Return random numbers of mean 0, -1 to 1, at the corners of each lattice."""
    rng = np.random.default_rng(seed)
    lattices = []
    for cells, *_ in _LATTICES:
        values = rng.uniform(-1, 1, (cells + 1, cells + 1))
        lattices.append((values - values.mean()) / (1 + abs(values.mean())))
    return tuple(lattices)


def disc_grain(u: np.ndarray, v: np.ndarray, seed: int) -> np.ndarray:
    """Return the brightness, -1 to 1, of dust and uneven coating, the same on both sides of focus.

    Three octaves of value noise: random numbers on rotated lattices, interpolated by 3 t^2 - 2 t^3.

    Args:
        u: Coordinate to the right, pupil radii; any shape that broadcasts with ``v``.
        v: Coordinate down, pupil radii.
        seed: Seed of the noise; patterns of different seeds are independent.

    Returns:
        Brightness, continuously differentiable with respect to (u, v).

    Source:
        Perlin, "An image synthesizer", SIGGRAPH 1985, for noise as octaves on lattices.
    """
    total = np.zeros(np.broadcast_shapes(np.shape(u), np.shape(v)))
    for (cells, amplitude, angle), values in zip(_LATTICES, _lattices(seed), strict=True):
        along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
        column = np.clip((along + 1) * (cells / 2), 0, cells)
        row = np.clip((across + 1) * (cells / 2), 0, cells)
        left, top = np.minimum(column.astype(np.intp), cells - 1), np.minimum(row.astype(np.intp), cells - 1)
        x, y = column - left, row - top
        x, y = x * x * (3 - 2 * x), y * y * (3 - 2 * y)
        upper = values[top, left] * (1 - x) + values[top, left + 1] * x
        lower = values[top + 1, left] * (1 - x) + values[top + 1, left + 1] * x
        total = total + amplitude * (upper * (1 - y) + lower * y)
    return total
