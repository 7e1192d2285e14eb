"""Bokeh of many highlights through the visibility of few: area sources of merged lights.

Each highlight is a camera that sees the blockers before the lens: its visibility map over the pupil.
Neighbouring highlights are merged to an area source at their mean, with all their light, and its visibility
map is blurred by the parallax of its lights.

Faults: one depth of blockers for each area source; the blur ignores that a map of two blockers has two.

Source: Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation, 5.1.1
and 5.1.2. (5.4) as printed has the ratio of distances upside down: see ``visibility_blur``.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_above, check_whole

__all__ = ["AreaSource", "merge_lights", "printed_visibility_blur", "splat_sources", "visibility_blur"]

# Function of a point (3,), mm, and pupil points (N, 2), mm; returns distance of the blocker from the lens,
# mm, (N,), infinite where the point is visible.
Blockers = Callable[[np.ndarray, np.ndarray], np.ndarray]

# Iterations of the clustering.
_ITERATIONS = 12


@dataclass(frozen=True, kw_only=True)
class AreaSource:
    """Merged highlights.

    Attributes:
        position: Mean position, mm, (3,), weighted by light.
        light: Sum of their light, (3,).
        radius: Root mean square distance of the lights from the mean, times the square root of 2, mm: that of
            a disc with the same spread.
    """

    position: np.ndarray
    light: np.ndarray
    radius: float


def merge_lights(
    positions: np.ndarray, lights: np.ndarray, count: int, seed: int = 0
) -> tuple[list[AreaSource], np.ndarray]:
    """Merge lights to at most ``count`` area sources by k-means, and return the source of each light, (N,).

    Args:
        positions: Positions, mm, (N, 3).
        lights: Light of each, (N, 3).
        count: Number of area sources, at least 1.
        seed: Seed of the first centre; the others are far apart.
    """
    check_whole("count", count, 1)
    centers = positions[_far_apart(positions, min(count, len(positions)), np.random.default_rng(seed))]
    labels = np.zeros(len(positions), int)
    for _ in range(_ITERATIONS):
        labels = ((positions[:, None] - centers[None]) ** 2).sum(-1).argmin(1)
        centers = np.array(
            [
                positions[labels == k].mean(0) if (labels == k).any() else centers[k]
                for k in range(len(centers))
            ]
        )
    sources = []
    numbers = np.unique(labels)
    for number in numbers:
        members = labels == number
        weight = lights[members].sum(1)
        mean = (positions[members] * weight[:, None]).sum(0) / weight.sum()
        spread = (((positions[members] - mean)[:, :2] ** 2).sum(1) * weight).sum() / weight.sum()
        light = lights[members].sum(0)
        sources.append(AreaSource(position=mean, light=light, radius=float(np.sqrt(2 * spread))))
    return sources, np.searchsorted(numbers, labels)


def _far_apart(positions: np.ndarray, count: int, rng: np.random.Generator) -> list[int]:
    """Return indices of positions, each the farthest from those before it, the first at random."""
    chosen = [int(rng.integers(len(positions)))]
    distance = ((positions - positions[chosen[0]]) ** 2).sum(1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((positions - positions[chosen[-1]]) ** 2).sum(1))
    return chosen


def visibility_blur(source_radius: float, source_distance: float, blocker_distance: float) -> float:
    """Return the radius by which an area source blurs the visibility map on the lens, mm.

    A blocker's edge at the distance ``a`` casts a shadow onto the lens from each point of the source at
    ``b``. As the point moves by s, the shadow moves by ``s a / (b - a)``. In the sprite multiply by its
    radius over the lens radius.

    Args:
        source_radius: Radius of the source, mm.
        source_distance: Distance of the source from the lens, mm.
        blocker_distance: Distance of the blocker from the lens, mm, below that of the source.
    """
    check_above("source_distance", source_distance, blocker_distance)
    return source_radius * blocker_distance / (source_distance - blocker_distance)


def printed_visibility_blur(
    source_radius: float, source_distance: float, blocker_distance: float, lens_radius: float, coc: float
) -> float:
    """Return (5.4) as printed: the ratio of distances is the inverse of the right one."""
    ratio = (source_distance - blocker_distance) / source_distance * (source_distance / blocker_distance)
    return source_radius * ratio / (2 * lens_radius * coc)


def splat_sources(
    sources: list[AreaSource],
    blockers: Blockers,
    lens_radius: float,
    blur: Callable[[np.ndarray], tuple[float, float, float]],
    size: tuple[int, int],
    cells: int = 48,
) -> np.ndarray:
    """Return the picture (H, W, 3) of the sources' discs, masked by what the lens sees of them.

    Args:
        sources: Sources; a radius of 0 is a point.
        blockers: Blockers between sources and lens.
        lens_radius: Radius of the lens, mm.
        blur: Function of a position; returns column, row and signed blur radius in pixels.
        size: Height and width, pixels.
        cells: Cells of a visibility map along the diameter of the lens.
    """
    picture = np.zeros((*size, 3))
    axis = (np.arange(cells) + 0.5) / cells * 2 - 1
    u, v = np.meshgrid(axis, axis)
    points = np.stack([u.ravel(), v.ravel()], -1)
    for source in sources:
        blocked = blockers(source.position, lens_radius * points).reshape(cells, cells)
        visible = np.isinf(blocked).astype(float)
        if source.radius > 0 and (visible == 0).any():
            mean = float(blocked[visible == 0].mean())
            reach = visibility_blur(source.radius, float(source.position[2]), mean) / lens_radius * cells / 2
            visible = _disc_mean(visible, reach)
        column, row, radius = blur(source.position)
        side = blur(source.position + np.array([source.radius, 0.0, 0.0]))[0] - column
        _add_sprite(picture, visible, source.light, column, row, radius, abs(side))
    return picture


def _disc_mean(values: np.ndarray, radius: float) -> np.ndarray:
    """Return the mean over a disc of a radius in cells, border repeated."""
    half = int(np.ceil(radius))
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    padded = np.pad(values, half, mode="edge")
    total, count = np.zeros(values.shape), 0
    for dy, dx in zip(y[np.hypot(x, y) <= radius] + half, x[np.hypot(x, y) <= radius] + half, strict=True):
        total += padded[dy : dy + len(values), dx : dx + values.shape[1]]
        count += 1
    return total / count


def _add_sprite(
    picture: np.ndarray,
    visible: np.ndarray,
    light: np.ndarray,
    column: float,
    row: float,
    radius: float,
    spread: float,
) -> None:
    """Add the disc of a source, through its visibility map and spread by its own image, to the picture."""
    height, width = picture.shape[:2]
    half = int(np.ceil(abs(radius) + spread)) + 1
    rows = np.arange(max(0, int(row) - half), min(height, int(row) + half + 1))
    columns = np.arange(max(0, int(column) - half), min(width, int(column) + half + 1))
    if not len(rows) or not len(columns):
        return
    y, x = np.meshgrid((rows + 0.5 - row) / -radius, (columns + 0.5 - column) / -radius, indexing="ij")
    inside = np.hypot(x, y) <= 1
    cells = len(visible)
    at = [np.clip(((part + 1) / 2 * cells).astype(int), 0, cells - 1) for part in (y, x)]
    sprite = np.where(inside, visible[at[0], at[1]], 0) / (np.pi * radius**2)
    if spread > 0.5:
        sprite = _disc_mean(sprite, spread)
    picture[np.ix_(rows, columns)] += sprite[..., None] * light
