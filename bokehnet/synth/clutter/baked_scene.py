"""Scenes of triangles whose colours are known beforehand: rays through the lens only look them up.

Embree finds what each ray meets; a compiled loop reads its colour. That is all, so a core follows millions
of rays a second through any lens.
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

# Rays followed at once: their data stay in a processor's cache.
_RAYS = 1 << 15


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Soup:
    """Triangles of all meshes, with Embree's tree over them.

    Attributes:
        tree: Finds the triangle that a ray meets.
        uv: Of the three corners, (T, 3, 2), in the texture of the mesh.
        grid: The same in the mesh's grid of light, [0, 1].
        mesh: Whose triangle it is, (T,) int32.
    """

    tree: Any
    uv: np.ndarray
    grid: np.ndarray
    mesh: np.ndarray


def make_soup(meshes: Sequence[GridMesh], nearest: float) -> Soup:
    """Cut meshes into triangles; those that reach nearer than depth ``nearest`` are left out.

    Raises:
        MissingExtraError: Embree is not installed.
    """
    require_extra("embreex", "trace")
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    parts: list[list[np.ndarray]] = [[], [], []]
    owner = []
    for number, mesh in enumerate(meshes):
        place = np.stack(np.meshgrid(*(np.linspace(0, 1, n) for n in mesh.uv.shape[:2]), indexing="ij"), -1)
        cells = [_triangles(values) for values in (mesh.points, mesh.uv, place)]
        seen = cells[0][..., 2].min(1) > nearest
        for whole, part in zip(parts, cells, strict=True):
            whole.append(part[seen].astype(np.float32))
        owner.append(np.full(int(seen.sum()), number, np.int32))
    corners, uv, grid = (np.concatenate(whole) for whole in parts)
    vertices = corners.reshape(-1, 3)
    tree = rtcore_scene.EmbreeScene()
    TriangleMesh(tree, vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    return Soup(tree=tree, uv=uv, grid=grid, mesh=np.concatenate(owner))


def _triangles(values: np.ndarray) -> np.ndarray:
    """Corners (T, 3, C) of the two triangles of each cell of a grid (N, M, C)."""
    a, b, c, d = values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]
    both = np.stack([np.stack([a, b, c], 2), np.stack([d, c, b], 2)], 2)
    return both.reshape(-1, 3, values.shape[-1])


def pack(pictures: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Pictures (h, w, 3) one after the other (texels, 3), and where each starts, its rows and columns."""
    sizes = np.array([picture.shape[:2] for picture in pictures], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes.prod(1))[:-1]])
    flat = np.concatenate([picture.reshape(-1, 3) for picture in pictures]).astype(np.float32)
    return flat, np.column_stack([starts, sizes])


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """A sensor and the samples of its pixels.

    Attributes:
        width: Pixels.
        height: Pixels.
        pixel_pitch: mm.
        samples: Of each pixel.
        seed: Same seed, same noise.
    """

    width: int
    height: int
    pixel_pitch: float
    samples: int
    seed: int


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class BakedScene:
    """A scene that only needs looking at, in the space of the camera, mm.

    Attributes:
        soup: Geometry.
        albedo: All textures, packed.
        light: Light on all meshes, packed.
        texture: Which texture each mesh shows, (meshes,) int64.
        sky: What rays see that meet nothing, (h, w, 3); endless by mirroring.
        sky_half: Half width and half height of that picture as slopes.
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
            lens: Any.
            view: Sensor and samples.
            pupil: Look through the whole pupil; else through its middle, which is all in focus.

        Source:
            Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984.
        """
        centres = sensor_xy(view)
        picture = np.empty((len(centres), 3), np.float32)
        points = _sample_points(view.samples)
        shifts = np.random.default_rng(view.seed).random((len(centres), 1, 4), np.float32)
        step = max(1, _RAYS // view.samples)
        for first in range(0, len(centres), step):
            part = slice(first, first + step)
            moved = rotate_points(points, shifts[part])
            sensor = centres[part, None] + np.float32(view.pixel_pitch) * (moved[..., 2:] - np.float32(0.5))
            disc = disc_from_square(moved[..., :2]) if pupil else np.zeros_like(sensor)
            picture[part] = self._colours(lens.sample_rays(sensor, disc))
        return picture.reshape(view.height, view.width, 3)

    def _colours(self, rays: Rays) -> np.ndarray:
        """Mean colours (P, 3) of rays (P, S)."""
        slope = np.ascontiguousarray(rays.slope, np.float32)
        weight = np.ones(slope.shape[:2], np.float32) if rays.weight is None else rays.weight
        found = self.meet(rays.origin, slope)
        return self.colours(found, slope, weight.astype(np.float32))

    def colours(
        self, found: dict[str, np.ndarray], slope: np.ndarray, weight: np.ndarray | None = None
    ) -> np.ndarray:
        """Mean colours (P, 3) of what :meth:`meet` found for rays of ``slope`` (P, S, 2), by their weight."""
        shape = slope.shape[:2]
        return mean_colours(
            found["primID"].reshape(shape),
            found["u"].reshape(shape),
            found["v"].reshape(shape),
            slope,
            np.ones(shape, np.float32) if weight is None else weight,
            (self.soup.uv, self.soup.grid, self.soup.mesh),
            (*self.albedo, *self.light, self.texture),
            self.sky,
            np.array(self.sky_half, np.float32),
        )

    def meet(self, origin: np.ndarray, slope: np.ndarray) -> dict[str, np.ndarray]:
        """What Embree finds for rays from ``origin`` (..., 2): "tfar" is depth, "primID" -1 is nothing."""
        start, way = (np.empty((*slope.shape[:-1], 3), np.float32) for _ in range(2))
        start[..., :2], start[..., 2] = origin, 0
        way[..., :2], way[..., 2] = slope, 1
        found: dict[str, np.ndarray] = self.soup.tree.run(
            start.reshape(-1, 3), way.reshape(-1, 3), output=True
        )
        return found

    def disparity(self, lens: LensModel, view: View) -> np.ndarray:
        """Inverse depth, 1/mm, (H, W) float32, at the centres of the pixels; 0 where nothing is met."""
        centres = sensor_xy(view)
        rays = lens.sample_rays(centres, np.zeros_like(centres))
        found = self.meet(rays.origin, rays.slope)
        inverse = np.where(found["primID"] >= 0, 1 / found["tfar"], 0).astype(np.float32)
        return inverse.reshape(view.height, view.width)


def sensor_xy(view: View) -> np.ndarray:
    """Centres of the pixels on the sensor, mm, (H * W, 2) float32; the picture stands upside down there."""
    x = np.arange(view.width) + (0.5 - view.width / 2)
    y = np.arange(view.height) + (0.5 - view.height / 2)
    grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    return (-view.pixel_pitch * grid).astype(np.float32)


def _sample_points(count: int) -> np.ndarray:
    """Points (count, 4) that fill pupil and pixel evenly: Hammersley's.

    Source:
        Hammersley, "Monte Carlo methods for solving multivariable problems", 1960.
    """
    even = (np.arange(count) + 0.5) / count
    return np.stack([even, *(halton(count, base) for base in (2, 3, 5))], -1).astype(np.float32)
