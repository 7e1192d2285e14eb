"""Which vignetting apertures of a lens cut its pupil, as discs that move with the field."""

import numpy as np

from bokehnet.optics.aberrations.aberration_map import rim_passes

__all__ = ["fit_vignetting_apertures"]

# Rays near a rim, heights over semi-diameter, and the fewest of them that tell its place.
_NEAR = (0.95, 1.05)
_FEWEST = 12
_STEPS = 30
# The same for what is dark inside, where rays are fewer.
_CORE = 0.15
# Rims that keep away less than this share of the light that arrives are left out.
_SMALLEST = 1e-3


def fit_vignetting_apertures(
    pupil: np.ndarray, field: np.ndarray, heights: np.ndarray, stop: int, cores: np.ndarray | None = None
) -> tuple[tuple[float, float], ...]:
    """Fit discs ``|a - shift h| <= radius`` to where vignetting apertures cut the pupil.

    Each rim that is the one to clip somewhere is seen as a disc through the stop. Of these discs those are
    kept that are needed to have the right rays pass, the most important first.

    Args:
        pupil: Coordinates a of rays, (N, 2).
        field: Field positions h, (N, 2).
        heights: Height over semi-diameter at each surface, (surfaces, N).
        stop: Index of the stop among the surfaces.
        cores: Height over inner radius where surfaces stop rays near the axis, (some, N).

    Returns:
        Pairs (shift, radius); the radius of what is dark inside has a minus.
    """
    inside = (pupil**2).sum(-1) <= 1
    others = np.delete(heights, stop, axis=0)
    discs = []
    for number, rim in enumerate(others):
        rest = np.delete(others, number, axis=0).max(axis=0, initial=0)
        near = inside & (rest <= 1) & (rim > _NEAR[0]) & (rim < _NEAR[1])
        if near.sum() >= _FEWEST:
            discs.append(_fit_disc(pupil[near], field[near], rim[near]))
    wanted = others.max(axis=0, initial=0) <= 1
    for core in () if cores is None else cores:
        near = inside & (others.max(axis=0, initial=0) <= 1) & (core > 1 - _CORE) & (core < 1 + _CORE)
        if near.sum() >= _FEWEST:
            shift, radius = _fit_disc(pupil[near], field[near], core[near])
            discs.append((shift, -radius))
        wanted &= core >= 1
    passes = inside
    chosen: list[tuple[float, float]] = []
    cut = [rim_passes(pupil, field, shift, radius) for shift, radius in discs]
    while discs:
        wrong = [(inside & ((passes & one) != wanted)).sum() for one in cut]
        best = int(np.argmin(wrong))
        if (inside & (passes != wanted)).sum() - wrong[best] < _SMALLEST * (inside & wanted).sum():
            break
        passes = passes & cut.pop(best)
        chosen.append(discs.pop(best))
    return tuple(chosen)


def _fit_disc(pupil: np.ndarray, field: np.ndarray, height: np.ndarray) -> tuple[float, float]:
    """Shift and radius with ``|a - shift h| = radius height``, by Gauss and Newton.

    The start is the linear fit of ``(a.a - 2 shift a.h + ...) / radius^2 = height^2``.
    """
    aa, ah, hh = (pupil**2).sum(-1), (pupil * field).sum(-1), (field**2).sum(-1)
    size, middle, _ = np.linalg.lstsq(np.stack([aa, -2 * ah, hh], -1), height**2, rcond=None)[0]
    shift, radius = (middle / size, size**-0.5) if size > 0 else (0.0, 1.0)
    for _ in range(_STEPS):
        away = pupil - shift * field
        length = np.maximum((away**2).sum(-1) ** 0.5, 1e-9)
        slopes = np.stack([-(away * field).sum(-1) / length, -height], -1)
        step = np.linalg.lstsq(slopes, radius * height - length, rcond=None)[0]
        shift, radius = shift + step[0], max(radius + step[1], 1e-3)
    return float(shift), float(radius)
