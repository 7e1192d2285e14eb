"""Scenes of triangles with baked colours: rays through the lens only look them up.

Embree intersects the rays; a compiled loop reads the colours. One core traces millions of rays per second
through any lens.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bokehnet.checks import require_extra
from bokehnet.lenses import LensModel, Rays
from bokehnet.optics.sampling import disc_from_square, halton, rotate_points
from bokehnet.synth.clutter.grid_mesh import GridMesh
from bokehnet.synth.clutter.texture_lookup import mean_colours

__all__ = ["BakedScene", "Soup", "View", "make_soup", "pack"]

# Maximum number of rays per block: their data fit a CPU cache.
_MAX_RAYS = 1 << 15


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Soup:
    """Triangles of all meshes, with an Embree scene.

    Attributes:
        tree: Embree scene that intersects rays with the triangles.
        uv: Texture coordinates of the corners, (T, 3, 2).
        grid: Coordinates of the corners in the mesh's lighting grid, [0, 1], (T, 3, 2).
        mesh: Index of the mesh, (T,) int32.
    """

    tree: Any
    uv: np.ndarray
    grid: np.ndarray
    mesh: np.ndarray


def make_soup(meshes: Sequence[GridMesh], nearest: float) -> Soup:
    """Return the triangles of meshes, without those that reach nearer than depth ``nearest``.

    Raises:
        MissingExtraError: Embree is not installed.
    """
    require_extra("embreex", "trace")
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    parts: list[list[np.ndarray]] = [[], [], []]
    owner = []
    for number, mesh in enumerate(meshes):
        coordinates = np.stack(
            np.meshgrid(*(np.linspace(0, 1, n) for n in mesh.uv.shape[:2]), indexing="ij"), -1
        )
        cells = [_triangles(values) for values in (mesh.points, mesh.uv, coordinates)]
        visible = cells[0][..., 2].min(1) > nearest
        for collected, part in zip(parts, cells, strict=True):
            collected.append(part[visible].astype(np.float32))
        owner.append(np.full(int(visible.sum()), number, np.int32))
    corners, uv, grid = (np.concatenate(collected) for collected in parts)
    vertices = corners.reshape(-1, 3)
    tree = rtcore_scene.EmbreeScene()
    TriangleMesh(tree, vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    return Soup(tree=tree, uv=uv, grid=grid, mesh=np.concatenate(owner))


def _triangles(values: np.ndarray) -> np.ndarray:
    """Return the corners (T, 3, C) of the two triangles of each cell of a grid (N, M, C)."""
    a, b, c, d = values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]
    triangles = np.stack([np.stack([a, b, c], 2), np.stack([d, c, b], 2)], 2)
    return triangles.reshape(-1, 3, values.shape[-1])


def pack(pictures: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return pictures (h, w, 3) concatenated as (texels, 3), and the start, rows and columns of each."""
    sizes = np.array([picture.shape[:2] for picture in pictures], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(1))[:-1]])
    flat = np.concatenate([picture.reshape(-1, 3) for picture in pictures]).astype(np.float32)
    return flat, np.column_stack([starts, sizes])


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Sensor and samples of its pixels.

    Attributes:
        width: Width, pixels.
        height: Height, pixels.
        pixel_pitch: Pixel pitch, mm.
        samples: Samples per pixel.
        seed: Seed of the noise.
    """

    width: int
    height: int
    pixel_pitch: float
    samples: int
    seed: int


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class BakedScene:
    """Scene with baked lighting in camera space, mm.

    Attributes:
        soup: Triangles.
        albedo: Textures, packed.
        light: Irradiance on all meshes, packed.
        texture: Index of each mesh's texture, (meshes,) int64.
        sky: Radiance for rays without a hit, (h, w, 3); repeated by mirroring.
        sky_half: Half width and half height of the sky as slopes.
    """

    soup: Soup
    albedo: tuple[np.ndarray, np.ndarray]
    light: tuple[np.ndarray, np.ndarray]
    texture: np.ndarray
    sky: np.ndarray
    sky_half: tuple[float, float]

    def render(self, lens: LensModel, view: View, pupil: bool = True) -> np.ndarray:
        """Return the picture (H, W, 3), float32, scene-linear.

        Args:
            lens: Any lens model.
            view: Sensor and samples.
            pupil: Use the whole pupil; otherwise only its centre, for an all-in-focus picture.

        Source:
            Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984.
        """
        centres = sensor_xy(view)
        picture = np.empty((len(centres), 3), np.float32)
        points = _sample_points(view.samples)
        shifts = np.random.default_rng(view.seed).random((len(centres), 1, 4), np.float32)
        step = max(1, _MAX_RAYS // view.samples)
        for first in range(0, len(centres), step):
            part = slice(first, first + step)
            shifted = rotate_points(points, shifts[part])
            sensor = centres[part, None] + np.float32(view.pixel_pitch) * (shifted[..., 2:] - np.float32(0.5))
            disc = disc_from_square(shifted[..., :2]) if pupil else np.zeros_like(sensor)
            picture[part] = self._colours(lens.sample_rays(sensor, disc))
        return picture.reshape(view.height, view.width, 3)

    def _colours(self, rays: Rays) -> np.ndarray:
        """Return the mean colours (P, 3) of rays (P, S)."""
        slope = np.ascontiguousarray(rays.slope, np.float32)
        weight = np.ones(slope.shape[:2], np.float32) if rays.weight is None else rays.weight
        hits = self.intersect(rays.origin, slope)
        return self.colours(hits, slope, weight.astype(np.float32))

    def colours(
        self, hits: dict[str, np.ndarray], slope: np.ndarray, weight: np.ndarray | None = None
    ) -> np.ndarray:
        """Return the weighted mean colours (P, 3) of hits from :meth:`intersect` for ``slope`` (P, S, 2)."""
        shape = slope.shape[:2]
        return mean_colours(
            hits["primID"].reshape(shape),
            hits["u"].reshape(shape),
            hits["v"].reshape(shape),
            slope,
            np.ones(shape, np.float32) if weight is None else weight,
            (self.soup.uv, self.soup.grid, self.soup.mesh),
            (*self.albedo, *self.light, self.texture),
            self.sky,
            np.array(self.sky_half, np.float32),
        )

    def intersect(self, origin: np.ndarray, slope: np.ndarray) -> dict[str, np.ndarray]:
        """Return Embree's hits of rays from ``origin`` (..., 2): "tfar" is depth, "primID" -1 is no hit."""
        start, direction = (np.empty((*slope.shape[:-1], 3), np.float32) for _ in range(2))
        start[..., :2], start[..., 2] = origin, 0
        direction[..., :2], direction[..., 2] = slope, 1
        hits: dict[str, np.ndarray] = self.soup.tree.run(
            start.reshape(-1, 3), direction.reshape(-1, 3), output=True
        )
        return hits

    def disparity(self, lens: LensModel, view: View) -> np.ndarray:
        """Return inverse depth, 1/mm, (H, W) float32, at the pixel centres; 0 without a hit."""
        centres = sensor_xy(view)
        rays = lens.sample_rays(centres, np.zeros_like(centres))
        hits = self.intersect(rays.origin, rays.slope)
        inverse = np.where(hits["primID"] >= 0, 1 / hits["tfar"], 0).astype(np.float32)
        return inverse.reshape(view.height, view.width)


def sensor_xy(view: View) -> np.ndarray:
    """Return the pixel centres on the sensor, mm, (H * W, 2) float32; the sensor image is inverted."""
    x = np.arange(view.width) + (0.5 - view.width / 2)
    y = np.arange(view.height) + (0.5 - view.height / 2)
    grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return (-view.pixel_pitch * grid).astype(np.float32)


def _sample_points(count: int) -> np.ndarray:
    """Return Hammersley points (count, 4) that fill pupil and pixel evenly.

    Source:
        Hammersley, "Monte Carlo methods for solving multivariable problems", 1960.
    """
    even = (np.arange(count) + 0.5) / count
    return np.stack([even, *(halton(count, base) for base in (2, 3, 5))], -1).astype(np.float32)
