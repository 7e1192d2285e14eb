"""Baked lighting: irradiance on surfaces, computed once per scene, with shading and shadows.

The radiance of Lambertian surfaces does not depend on the view. The irradiance is therefore sampled on a
coarse grid of points, and rays through the lens only look it up. Its noise is harmless: it is fixed to the
surface, the same in all pictures of the scene.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bokehnet.optics.sampling import halton, rotate_points
from bokehnet.synth.clutter.grid_mesh import GridMesh

__all__ = ["KeyLight", "Lighting", "bake", "lighting_grid"]

# Rays per point into the hemisphere, and towards each key light.
_HEMISPHERE_RAYS, _KEY_RAYS = 32, 6
_MAX_RAYS = 1 << 16
# Offset of ray origins from the surface, as a fraction of the distance from the camera.
_LIFT = 1e-3
# Maximum ratio of a light's reference distance to its distance; limits the light at near points.
_MAX_NEARNESS = 2.5


@dataclass(frozen=True, kw_only=True, slots=True)
class KeyLight:
    """Spherical light; ``light`` (3,) is the irradiance of a surface that faces it at ``distance``."""

    position: np.ndarray
    radius: float
    light: np.ndarray
    distance: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Lighting:
    """Lighting of a scene.

    Attributes:
        keys: Sun, windows or lamps.
        above: Irradiance from an unobstructed upper hemisphere, (3,); the lower hemisphere gives half of it.
        bounced: Irradiance from obstructed directions, (3,).
        up: Unit vector upwards, (3,).
    """

    keys: tuple[KeyLight, ...]
    above: np.ndarray
    bounced: np.ndarray
    up: np.ndarray


def lighting_grid(mesh: GridMesh, spacing: float, max_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points (h, w, 3), evenly spaced on the grid of a mesh, and their normals.

    Args:
        mesh: Mesh in camera space, with the camera at the origin.
        spacing: Distance between neighbours, divided by their distance from the camera.
        max_count: Maximum number of points along a side.
    """
    mesh_points = mesh.points
    camera_distance = np.maximum(np.linalg.norm(mesh_points, axis=-1), 1e-12)
    counts = []
    for axis in (0, 1):
        steps = np.linalg.norm(np.diff(mesh_points, axis=axis), axis=-1)
        distance = np.minimum(*(np.delete(camera_distance, end, axis) for end in (0, -1)))
        extent = float((steps / distance).sum(axis).max())
        counts.append(int(np.clip(np.ceil(extent / spacing) + 1, 2, max_count)))
    rows, columns = (
        np.linspace(0, size - 1, count) for size, count in zip(mesh_points.shape, counts, strict=False)
    )
    inset = [np.clip(coordinate, 0.02, coordinate[-1] - 0.02) for coordinate in (rows, columns)]
    points, normals = (_interpolate(values, *inset) for values in (mesh_points, mesh.normals))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-30)
    if mesh.open:  # the side that faces the camera
        normals *= np.where((normals * points).sum(-1, keepdims=True) > 0, -1.0, 1.0)
    return points, normals


def _interpolate(values: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Interpolate a grid (N, M, 3) linearly at all pairs of ``rows`` (h,) and ``columns`` (w,)."""
    for axis, coordinate in enumerate((rows, columns)):
        low = np.minimum(coordinate.astype(int), values.shape[axis] - 2)
        fraction = (coordinate - low).reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
        first, second = (np.take(values, low + step, axis) for step in (0, 1))
        values = first + fraction * (second - first)
    return values


def bake(
    grids: Sequence[tuple[np.ndarray, np.ndarray]], lighting: Lighting, tree: Any, rng: np.random.Generator
) -> list[np.ndarray]:
    """Return the irradiance on each grid, (h, w, 3), as a factor on the colour of a diffuse surface.

    Args:
        grids: Points and normals from :func:`lighting_grid`.
        lighting: Lighting of the scene.
        tree: Embree scene of all occluders.
        rng: Random generator.
    """
    points = np.concatenate([points.reshape(-1, 3) for points, _ in grids])
    normals = np.concatenate([normals.reshape(-1, 3) for _, normals in grids])
    light = np.empty_like(points)
    step = max(1, _MAX_RAYS // _HEMISPHERE_RAYS)
    for first in range(0, len(points), step):
        part = slice(first, first + step)
        starts = points[part] + normals[part] * (_LIFT * np.linalg.norm(points[part], axis=-1, keepdims=True))
        light[part] = _hemisphere_light(starts, normals[part], lighting, tree, rng)
        for key in lighting.keys:
            light[part] += _key_light(starts, normals[part], key, tree, rng)
    ends = np.cumsum([points[..., 0].size for points, _ in grids])[:-1]
    parts = np.split(light, ends)
    return [part.reshape(points.shape) for part, (points, _) in zip(parts, grids, strict=True)]


def _hemisphere_light(
    starts: np.ndarray, normals: np.ndarray, lighting: Lighting, tree: Any, rng: np.random.Generator
) -> np.ndarray:
    """Return the irradiance from both hemispheres and obstructed directions, (L, 3)."""
    directions = normals[:, None] + _sphere_directions(len(starts), _HEMISPHERE_RAYS, rng)  # cosine-weighted
    clear = _unobstructed(np.repeat(starts, _HEMISPHERE_RAYS, 0), directions.reshape(-1, 3), tree).reshape(
        len(starts), -1
    )
    length = np.maximum(np.linalg.norm(directions, axis=-1), 1e-9)
    height = (directions @ lighting.up) / length
    open_sky = (clear * (0.75 + 0.25 * np.clip(4 * height, -1, 1))).mean(1)[:, None]
    return open_sky * lighting.above + (1 - clear.mean(1)[:, None]) * lighting.bounced


def _key_light(
    starts: np.ndarray, normals: np.ndarray, key: KeyLight, tree: Any, rng: np.random.Generator
) -> np.ndarray:
    """Return the irradiance of a spherical light with soft shadows, (L, 3)."""
    ends = key.position + key.radius * _sphere_directions(len(starts), _KEY_RAYS, rng)
    directions = (ends - starts[:, None]).reshape(-1, 3)
    clear = (
        _unobstructed(np.repeat(starts, _KEY_RAYS, 0), directions, tree, max_distance=1.0)
        .reshape(len(starts), -1)
        .mean(1)
    )
    to_light = key.position - starts
    distance = np.linalg.norm(to_light, axis=-1)
    nearness = np.minimum(key.distance / distance, _MAX_NEARNESS)
    facing = np.maximum((to_light * normals).sum(-1) / distance, 0) * nearness**2
    return (clear * facing)[:, None] * key.light


def _unobstructed(
    starts: np.ndarray, directions: np.ndarray, tree: Any, max_distance: float = np.inf
) -> np.ndarray:
    """Return whether rays are unobstructed up to ``max_distance`` of their lengths, (N,)."""
    distance = tree.run(
        np.ascontiguousarray(starts, np.float32),
        np.ascontiguousarray(directions, np.float32),
        query="DISTANCE",
    )
    clear: np.ndarray = distance >= max_distance if np.isfinite(max_distance) else distance > 1e30
    return clear


def _sphere_directions(origins: int, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return unit vectors (origins, count, 3), for each origin evenly distributed over the sphere."""
    points = np.stack([(np.arange(count) + 0.5) / count, halton(count, 2)], -1)
    square = rotate_points(points, rng.random((origins, 1, 2)))
    z, angle = 2 * square[..., 0] - 1, 2 * np.pi * square[..., 1]
    radius = np.sqrt(np.maximum(1 - z * z, 0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], -1)
