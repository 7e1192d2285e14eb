"""Light on surfaces, found once for each scene: shades and shadows become part of their colours.

Lambert surfaces look alike from everywhere. So the light that falls on them is gathered on a coarse grid of
places, and rays through the lens only look it up. Its own noise does no harm: it is on the surface, the same
in all pictures of the scene.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bokehnet.optics.sampling import halton, rotate_points
from bokehnet.synth.clutter.grid_mesh import GridMesh

__all__ = ["KeyLight", "Lighting", "bake", "place_grid"]

# Rays of a place towards all around, and towards each key light.
_AROUND, _TOWARDS = 32, 6
_AT_ONCE = 1 << 16
# Rays start above the surface by this share of the distance from the camera.
_LIFT = 1e-3
# Light of a lamp grows no further below this share of the distance for which it is given.
_MOST_NEARNESS = 2.5


@dataclass(frozen=True, kw_only=True, slots=True)
class KeyLight:
    """A ball that shines; ``light`` (3,) falls on a surface that faces it at ``distance``."""

    position: np.ndarray
    radius: float
    light: np.ndarray
    distance: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Lighting:
    """All light of a scene.

    Attributes:
        keys: The sun, windows or lamps.
        above: Light of a clear view of what is above, (3,); from below comes half of it.
        bounced: What comes from where something is in the way instead, (3,).
        up: Unit vector, (3,).
    """

    keys: tuple[KeyLight, ...]
    above: np.ndarray
    bounced: np.ndarray
    up: np.ndarray


def place_grid(mesh: GridMesh, spacing: float, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Places (h, w, 3) spread evenly over the grid of a mesh, and normals there.

    Args:
        mesh: In the space of the camera, which is in its origin.
        spacing: Wanted distance between neighbours over that from the camera.
        most: Largest number along a side.
    """
    points = mesh.points
    near = np.maximum(np.linalg.norm(points, axis=-1), 1e-12)
    counts = []
    for axis in (0, 1):
        steps = np.linalg.norm(np.diff(points, axis=axis), axis=-1)
        distance = np.minimum(*(np.delete(near, end, axis) for end in (0, -1)))
        extent = float((steps / distance).sum(axis).max())
        counts.append(int(np.clip(np.ceil(extent / spacing) + 1, 2, most)))
    rows, columns = (
        np.linspace(0, size - 1, count) for size, count in zip(points.shape, counts, strict=False)
    )
    inset = [np.clip(place, 0.02, place[-1] - 0.02) for place in (rows, columns)]
    places, normals = (_between(values, *inset) for values in (points, mesh.normals))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    if mesh.open:  # the side that the camera sees
        normals *= np.where((normals * places).sum(-1, keepdims=True) > 0, -1.0, 1.0)
    return places, normals


def _between(values: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Interpolate a grid (N, M, 3) linearly at all pairs of ``rows`` (h,) and ``columns`` (w,)."""
    for axis, place in enumerate((rows, columns)):
        low = np.minimum(place.astype(int), values.shape[axis] - 2)
        share = (place - low).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        first, second = (np.take(values, low + step, axis) for step in (0, 1))
        values = first + share * (second - first)
    return values


def bake(
    grids: Sequence[tuple[np.ndarray, np.ndarray]], lighting: Lighting, tree: Any, rng: np.random.Generator
) -> list[np.ndarray]:
    """Light that falls on each grid, (h, w, 3), as a share: an even surface shows it times its colour.

    Args:
        grids: Places and normals, as :func:`place_grid` gives them.
        lighting: Where it comes from.
        tree: Embree's scene, of all that casts shadows.
        rng: Random numbers.
    """
    places = np.concatenate([places.reshape(-1, 3) for places, _ in grids])
    normals = np.concatenate([normals.reshape(-1, 3) for _, normals in grids])
    light = np.empty_like(places)
    step = max(1, _AT_ONCE // _AROUND)
    for first in range(0, len(places), step):
        part = slice(first, first + step)
        starts = places[part] + normals[part] * (_LIFT * np.linalg.norm(places[part], axis=-1, keepdims=True))
        light[part] = _from_around(starts, normals[part], lighting, tree, rng)
        for key in lighting.keys:
            light[part] += _from_key(starts, normals[part], key, tree, rng)
    ends = np.cumsum([places[..., 0].size for places, _ in grids])[:-1]
    parts = np.split(light, ends)
    return [part.reshape(places.shape) for part, (places, _) in zip(parts, grids, strict=True)]


def _from_around(
    starts: np.ndarray, normals: np.ndarray, lighting: Lighting, tree: Any, rng: np.random.Generator
) -> np.ndarray:
    """Light from above, below and bounced, (L, 3)."""
    directions = normals[:, None] + _on_sphere(len(starts), _AROUND, rng)  # cosine-weighted
    clear = _clear(np.repeat(starts, _AROUND, 0), directions.reshape(-1, 3), tree).reshape(len(starts), -1)
    length = np.maximum(np.linalg.norm(directions, axis=-1), 1e-9)
    height = (directions @ lighting.up) / length
    open_sky = (clear * (0.75 + 0.25 * np.clip(4 * height, -1, 1))).mean(1)[:, None]
    return open_sky * lighting.above + (1 - clear.mean(1)[:, None]) * lighting.bounced


def _from_key(
    starts: np.ndarray, normals: np.ndarray, key: KeyLight, tree: Any, rng: np.random.Generator
) -> np.ndarray:
    """Light of a ball, with its shadow's soft edge, (L, 3)."""
    ends = key.position + key.radius * _on_sphere(len(starts), _TOWARDS, rng)
    ways = (ends - starts[:, None]).reshape(-1, 3)
    clear = _clear(np.repeat(starts, _TOWARDS, 0), ways, tree, within=1.0).reshape(len(starts), -1).mean(1)
    way = key.position - starts
    distance = np.linalg.norm(way, axis=-1)
    nearness = np.minimum(key.distance / distance, _MOST_NEARNESS)
    facing = np.maximum((way * normals).sum(-1) / distance, 0) * nearness**2
    return (clear * facing)[:, None] * key.light


def _clear(starts: np.ndarray, ways: np.ndarray, tree: Any, within: float = np.inf) -> np.ndarray:
    """Whether nothing is in the way of rays within so many of their lengths, (N,)."""
    found = tree.run(
        np.ascontiguousarray(starts, np.float32), np.ascontiguousarray(ways, np.float32), query="DISTANCE"
    )
    clear: np.ndarray = found >= within if np.isfinite(within) else found > 1e30
    return clear


def _on_sphere(places: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Unit vectors (places, count, 3), for each place spread evenly in all directions."""
    points = np.stack([(np.arange(count) + 0.5) / count, halton(count, 2)], -1)
    square = rotate_points(points, rng.random((places, 1, 2)))
    z, angle = 2 * square[..., 0] - 1, 2 * np.pi * square[..., 1]
    radius = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], -1)
