"""Blurred lamps in a photograph."""

from collections import deque
from dataclasses import dataclass

import numpy as np

__all__ = ["Disc", "find_discs"]

# Discs are so many pixels in radius at least, fill this much of the box around them, and are no longer than
# so many times their width.
_SMALLEST, _FULL, _LONGEST = 6.0, (0.45, 0.97), 2.5
# A disc's rim is where its light over the surroundings falls to this share.
_RIM = 0.4
# The most that are taken.
_MOST = 12


@dataclass(frozen=True, kw_only=True, slots=True)
class Disc:
    """One blurred lamp: its middle, x and y in pixels, and its radius."""

    x: float
    y: float
    radius: float


def find_discs(light: np.ndarray, most: int = _MOST) -> list[Disc]:
    """Find blurred lamps that stand alone, the strongest first.

    Args:
        light: Brightness, scene-linear, (H, W).
        most: How many are taken.
    """
    ground = float(np.median(light))
    # The lowest level shows discs whole; those that touch there are parted by a higher one.
    found: list[tuple[float, Disc]] = []
    peak = float(np.quantile(light, 0.9995)) - ground
    if not peak > 0:
        return []
    for share in (0.06, 0.12, 0.25, 0.5):
        for rows, columns in _regions(light > ground + share * peak):
            disc = _as_disc(light, ground, rows, columns)
            near = disc and any(
                (disc.x - one.x) ** 2 + (disc.y - one.y) ** 2 < (disc.radius + one.radius) ** 2
                for _, one in found
            )
            if disc and not near:
                found.append((float(light[rows, columns].mean() - ground) * disc.radius, disc))
    found.sort(key=lambda pair: -pair[0])
    return [disc for _, disc in found[:most]]


def _as_disc(light: np.ndarray, ground: float, rows: np.ndarray, columns: np.ndarray) -> Disc | None:
    """The disc that a region may be; None where it is none."""
    height, width = int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1
    full = len(rows) / (height * width)
    long = max(height, width) / min(height, width)
    radius = max(height, width) / 2
    inside = (
        rows.min() > radius / 2
        and columns.min() > radius / 2
        and rows.max() < light.shape[0] - radius / 2
        and columns.max() < light.shape[1] - radius / 2
    )
    if radius < _SMALLEST or not inside or not _FULL[0] <= full <= _FULL[1] or long > _LONGEST:
        return None
    # Of one lamp: the light at its rim is cut off, not fading.
    own = light[rows, columns] - ground
    if (own > _RIM * np.quantile(own, 0.7)).mean() < 0.8:
        return None
    x, y = (columns.max() + columns.min()) / 2, (rows.max() + rows.min()) / 2
    return Disc(x=float(x), y=float(y), radius=float(radius))


def _regions(mask: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rows and columns of connected pixels, four neighbours each; small regions are left out."""
    height, width = mask.shape
    left = mask.copy()
    regions = []
    least = 2 * _SMALLEST**2
    for start in zip(*np.nonzero(mask), strict=True):
        if not left[start]:
            continue
        left[start] = False
        queue, members = deque([start]), [start]
        while queue:
            y, x = queue.popleft()
            for at in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if 0 <= at[0] < height and 0 <= at[1] < width and left[at]:
                    left[at] = False
                    queue.append(at)
                    members.append(at)
        if len(members) >= least:
            rows, columns = np.array(members).T
            regions.append((rows, columns))
    return regions
