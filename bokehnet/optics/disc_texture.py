"""What shows inside an out-of-focus disc: rings of a machined asphere, dust and coating.

Both are patterns around 0 in the coordinates of the pupil, to be scaled by a contrast and added to 1.
"""

from functools import lru_cache

import numpy as np

__all__ = ["disc_grain", "onion_rings"]

# Cells of the lattices across the pupil's diameter, the share of each in the grain, and its turn in radians,
# so that no direction stands out.
_LATTICES = ((12, 0.25, 0.3), (24, 0.35, 0.9), (48, 0.4, 1.4))


def onion_rings(rho: np.ndarray, rings: float) -> np.ndarray:
    """Rings that the tool of a lathe leaves on a surface, as brightness between -1 and 1.

    A ripple of the surface bends light towards its crests: behind focus rings are bright where in front of
    focus they are dark. The ripple has one period per ring and, like a lathe's feed, no reason to end in
    step with the rim; its brightness is made to average 0 over the disc, so that rings only move light.

    Args:
        rho: Distance from the middle of the pupil in its radii.
        rings: Periods from the middle to the rim.

    Returns:
        Brightness, of the shape of ``rho``.

    Source:
        "Efficient and expressive rendering for real-time defocus blur and bokeh" (dissertation), 5.2.3, for
        ringing and grain as parts of an aperture's texture; their form is ours.
    """
    phase = 2 * np.pi * rings
    # Mean of cos(phase rho) over the unit disc: 2 (cos p + p sin p - 1) / p^2.
    mean = 2 * (np.cos(phase) + phase * np.sin(phase) - 1) / phase**2
    return np.asarray((np.cos(phase * rho) - mean) / (1 + abs(mean)))


@lru_cache(maxsize=8)
def _lattices(seed: int) -> tuple[np.ndarray, ...]:
    """Random numbers between -1 and 1 at the corners of each lattice, of mean 0."""
    rng = np.random.default_rng(seed)
    lattices = []
    for cells, *_ in _LATTICES:
        values = rng.uniform(-1, 1, (cells + 1, cells + 1))
        lattices.append((values - values.mean()) / (1 + abs(values.mean())))
    return tuple(lattices)


def disc_grain(u: np.ndarray, v: np.ndarray, seed: int) -> np.ndarray:
    """Dust and uneven coating as brightness between -1 and 1, the same on both sides of the focus.

    Three octaves of value noise: random numbers on turned lattices, joined by the smooth step 3 t^2 - 2 t^3.

    Args:
        u: To the right, in pupil radii; any shape that goes with ``v``.
        v: Down.
        seed: Which grain; two seeds are independent.

    Returns:
        Brightness; continuous and once differentiable in the place on the unit disc.

    Source:
        Perlin, "An image synthesizer", SIGGRAPH 1985, for noise as octaves on lattices.
    """
    total = np.zeros(np.broadcast_shapes(np.shape(u), np.shape(v)))
    for (cells, share, turn), values in zip(_LATTICES, _lattices(seed), strict=True):
        along, across = u * np.cos(turn) + v * np.sin(turn), v * np.cos(turn) - u * np.sin(turn)
        column = np.clip((along + 1) * (cells / 2), 0, cells)
        row = np.clip((across + 1) * (cells / 2), 0, cells)
        left, top = np.minimum(column.astype(np.intp), cells - 1), np.minimum(row.astype(np.intp), cells - 1)
        x, y = column - left, row - top
        x, y = x * x * (3 - 2 * x), y * y * (3 - 2 * y)
        upper = values[top, left] * (1 - x) + values[top, left + 1] * x
        lower = values[top + 1, left] * (1 - x) + values[top + 1, left + 1] * x
        total = total + share * (upper * (1 - y) + lower * y)
    return total
