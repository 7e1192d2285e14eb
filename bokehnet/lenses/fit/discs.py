"""Detection of blurred lamps in a photograph."""

from collections import deque
from dataclasses import dataclass

import numpy as np

__all__ = ["Disc", "find_discs"]

# Minimum radius of discs, pixels, range of the filled fraction of their bounding box, and maximum aspect
# ratio.
_MIN_RADIUS_PX, _FILL_RANGE, _MAX_ASPECT = 6.0, (0.45, 0.97), 2.5
# Minimum light inside a disc, relative to its 0.7 quantile above the background.
_MIN_RELATIVE_LIGHT = 0.4
# Default maximum number of discs.
_MAX_DISCS = 12


@dataclass(frozen=True, kw_only=True, slots=True)
class Disc:
    """Blurred lamp: its centre, x and y in pixels, and its radius in pixels."""

    x: float
    y: float
    radius: float


def find_discs(light: np.ndarray, max_count: int = _MAX_DISCS) -> list[Disc]:
    """Return isolated blurred lamps, the strongest first.

    Args:
        light: Brightness, scene-linear, (H, W).
        max_count: Maximum number of lamps.
    """
    background = float(np.median(light))
    # The lowest level contains whole discs; a higher level separates touching discs.
    discs: list[tuple[float, Disc]] = []
    peak = float(np.quantile(light, 0.9995)) - background
    if not peak > 0:
        return []
    for level in (0.06, 0.12, 0.25, 0.5):
        for rows, columns in _regions(light > background + level * peak):
            disc = _as_disc(light, background, rows, columns)
            overlaps = disc and any(
                (disc.x - other.x) ** 2 + (disc.y - other.y) ** 2 < (disc.radius + other.radius) ** 2
                for _, other in discs
            )
            if disc and not overlaps:
                discs.append((float(light[rows, columns].mean() - background) * disc.radius, disc))
    discs.sort(key=lambda pair: -pair[0])
    return [disc for _, disc in discs[:max_count]]


def _as_disc(light: np.ndarray, background: float, rows: np.ndarray, columns: np.ndarray) -> Disc | None:
    """Return the disc of a region; None if it is not a disc."""
    height, width = int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1
    fill = len(rows) / (height * width)
    aspect = max(height, width) / min(height, width)
    radius = max(height, width) / 2
    inside = (
        rows.min() > radius / 2
        and columns.min() > radius / 2
        and rows.max() < light.shape[0] - radius / 2
        and columns.max() < light.shape[1] - radius / 2
    )
    if (
        radius < _MIN_RADIUS_PX
        or not inside
        or not _FILL_RANGE[0] <= fill <= _FILL_RANGE[1]
        or aspect > _MAX_ASPECT
    ):
        return None
    # A defocused lamp has a sharp rim; its light does not fade out.
    light_above = light[rows, columns] - background
    if (light_above > _MIN_RELATIVE_LIGHT * np.quantile(light_above, 0.7)).mean() < 0.8:
        return None
    x, y = (columns.max() + columns.min()) / 2, (rows.max() + rows.min()) / 2
    return Disc(x=float(x), y=float(y), radius=float(radius))


def _regions(mask: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rows and columns of connected pixels, four neighbours each; ignores small regions."""
    height, width = mask.shape
    unvisited = mask.copy()
    regions = []
    min_pixels = 2 * _MIN_RADIUS_PX**2
    for start in zip(*np.nonzero(mask), strict=True):
        if not unvisited[start]:
            continue
        unvisited[start] = False
        queue, pixels = deque([start]), [start]
        while queue:
            y, x = queue.popleft()
            for at in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                if 0 <= at[0] < height and 0 <= at[1] < width and unvisited[at]:
                    unvisited[at] = False
                    queue.append(at)
                    pixels.append(at)
        if len(pixels) >= min_pixels:
            rows, columns = np.array(pixels).T
            regions.append((rows, columns))
    return regions
