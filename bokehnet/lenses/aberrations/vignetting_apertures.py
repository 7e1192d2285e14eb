"""Fit of vignetting apertures: discs that clip the pupil and move with the field."""

import numpy as np

from bokehnet.optics.aberrations.aberration_map import rim_passes

__all__ = ["fit_vignetting_apertures"]

# Range of relative heights of rays near a rim, and minimum number of such rays for a fit.
_RIM_HEIGHTS = (0.95, 1.05)
_MIN_RAYS = 12
_MAX_ITERATIONS = 30
# Half-width of the range of relative heights at central obstructions, where rays are fewer.
_INNER_HALF_WIDTH = 0.15
# Minimum fraction of the light that a rim must block to be kept.
_MIN_BLOCKED = 1e-3


def fit_vignetting_apertures(
    pupil: np.ndarray,
    field: np.ndarray,
    heights: np.ndarray,
    stop: int,
    inner_heights: np.ndarray | None = None,
) -> tuple[tuple[float, float], ...]:
    """Return discs ``|a - shift h| <= radius`` fitted to the clipping of the pupil by rims.

    Each rim that clips first at some field appears as a disc through the stop. The discs
    needed to reproduce the passing rays are kept, the most important first.

    Args:
        pupil: Coordinates a of rays, (N, 2).
        field: Field positions h, (N, 2).
        heights: Height over semi-diameter at each surface, (surfaces, N).
        stop: Index of the stop among the surfaces.
        inner_heights: Height over inner radius at central obstructions, (obstructions, N).

    Returns:
        Pairs (shift, radius); the radius of a central obstruction is negative.
    """
    inside = (pupil**2).sum(-1) <= 1
    others = np.delete(heights, stop, axis=0)
    discs = []
    for number, rim in enumerate(others):
        rest = np.delete(others, number, axis=0).max(axis=0, initial=0)
        near = inside & (rest <= 1) & (rim > _RIM_HEIGHTS[0]) & (rim < _RIM_HEIGHTS[1])
        if near.sum() >= _MIN_RAYS:
            discs.append(_fit_disc(pupil[near], field[near], rim[near]))
    target = others.max(axis=0, initial=0) <= 1
    for inner in () if inner_heights is None else inner_heights:
        near = (
            inside
            & (others.max(axis=0, initial=0) <= 1)
            & (inner > 1 - _INNER_HALF_WIDTH)
            & (inner < 1 + _INNER_HALF_WIDTH)
        )
        if near.sum() >= _MIN_RAYS:
            shift, radius = _fit_disc(pupil[near], field[near], inner[near])
            discs.append((shift, -radius))
        target &= inner >= 1
    passes = inside
    selected: list[tuple[float, float]] = []
    masks = [rim_passes(pupil, field, shift, radius) for shift, radius in discs]
    while discs:
        wrong = [(inside & ((passes & mask) != target)).sum() for mask in masks]
        best = int(np.argmin(wrong))
        if (inside & (passes != target)).sum() - wrong[best] < _MIN_BLOCKED * (inside & target).sum():
            break
        passes = passes & masks.pop(best)
        selected.append(discs.pop(best))
    return tuple(selected)


def _fit_disc(pupil: np.ndarray, field: np.ndarray, height: np.ndarray) -> tuple[float, float]:
    """Return shift and radius with ``|a - shift h| = radius height``, by the Gauss-Newton method.

    The start is the linear fit of ``(a.a - 2 shift a.h + ...) / radius^2 = height^2``.
    """
    aa, ah, hh = (pupil**2).sum(-1), (pupil * field).sum(-1), (field**2).sum(-1)
    size, middle, _ = np.linalg.lstsq(np.stack([aa, -2 * ah, hh], -1), height**2, rcond=None)[0]
    shift, radius = (middle / size, size**-0.5) if size > 0 else (0.0, 1.0)
    for _ in range(_MAX_ITERATIONS):
        offset = pupil - shift * field
        length = np.maximum((offset**2).sum(-1) ** 0.5, 1e-9)
        slopes = np.stack([-(offset * field).sum(-1) / length, -height], -1)
        step = np.linalg.lstsq(slopes, radius * height - length, rcond=None)[0]
        shift, radius = shift + step[0], max(radius + step[1], 1e-3)
    return float(shift), float(radius)
