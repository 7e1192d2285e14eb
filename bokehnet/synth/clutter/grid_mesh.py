"""Grid meshes: the surfaces of cluttered scenes.

Axes are x to the right, y down, z away from the camera; objects rest on y = 0 and extend to negative y. In
grids of closed objects, the cross product of the row step and the column step points outwards.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

__all__ = ["GridMesh", "box", "lathe", "moved", "plate", "revolve", "ribbon", "tube"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class GridMesh:
    """Grid of points with straight edges between them.

    Attributes:
        points: Corners, (N, M, 3).
        uv: Texture coordinates of each corner, (N, M, 2), rows first; mirrored outside [0, 1].
        texture: Index of the texture in the scene.
        open: True if both sides are visible.
    """

    points: np.ndarray
    uv: np.ndarray
    texture: int
    open: bool = False

    @property
    def normals(self) -> np.ndarray:
        """Unit normals at the corners, (N, M, 3); 0 where the grid has no area."""
        rows, columns = (np.gradient(self.points, axis=axis) for axis in (0, 1))
        normal = np.cross(rows, columns)
        if np.allclose(self.points[:, 0], self.points[:, -1]):  # closed around: no seam
            normal[:, 0] = normal[:, -1] = normal[:, 0] + normal[:, -1]
        # At a pole a whole row is one point: copy the adjacent row.
        for end, inner in ((0, 1), (-1, -2)):
            degenerate = np.linalg.norm(normal[end], axis=-1) < 1e-9 * (1e-9 + np.abs(normal).max())
            normal[end, degenerate] = normal[inner, degenerate]
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        unit: np.ndarray = normal / np.maximum(length, 1e-30)
        return unit


def plate(
    corner: Sequence[float] | np.ndarray,
    along_rows: Sequence[float] | np.ndarray,
    along_columns: Sequence[float] | np.ndarray,
    texture: int,
    *,
    uv_size: tuple[float, float] = (1.0, 1.0),
    cells: tuple[int, int] = (1, 1),
    open: bool = True,
) -> GridMesh:
    """Return a parallelogram: from ``corner``, rows of the grid run along ``along_rows``."""
    v, u = np.meshgrid(*(np.linspace(0, 1, count + 1) for count in cells), indexing="ij")
    across, down = np.asarray(along_rows, float), np.asarray(along_columns, float)
    points = np.asarray(corner, float) + u[..., None] * across + v[..., None] * down
    return GridMesh(
        points=points, uv=np.stack([v * uv_size[0], u * uv_size[1]], -1), texture=texture, open=open
    )


def box(size: Sequence[float] | np.ndarray, texture: int, below: bool = False) -> list[GridMesh]:
    """Return a box of ``size`` (x, y, z) on y = 0; ``below`` adds its bottom side."""
    x, y, z = size
    largest = max(size)
    a, b = np.array([-x / 2, -y, -z / 2]), np.array([x / 2, 0, z / 2])
    right, down, away = np.array([x, 0, 0]), np.array([0, y, 0]), np.array([0, 0, z])
    sides = [
        (a, right, down, y, x),  # front
        (a + right, away, down, y, z),  # right
        (b - down, -right, down, y, x),  # back
        (a + away, -away, down, y, z),  # left
        (a + away, right, -away, z, x),  # top
    ]
    if below:
        sides.append((a + down, right, away, z, x))
    return [
        plate(corner, rows, columns, texture, uv_size=(height / largest, width / largest), open=False)
        for corner, rows, columns, height, width in sides
    ]


def revolve(profile: np.ndarray, texture: int, around: int = 24, uv_around: float = 2.0) -> GridMesh:
    """Return the surface of (radius, height) points (K, 2), top to bottom, revolved about x = z = 0."""
    angle = np.linspace(0, 2 * np.pi, around + 1)
    radius, height = profile[:, :1], profile[:, 1:]
    points = np.stack(
        [
            radius * np.sin(angle),
            np.broadcast_to(-height, (len(profile), around + 1)),
            -radius * np.cos(angle),
        ],
        -1,
    )
    return GridMesh(points=points, uv=_grid_uv(len(profile), around + 1, 1.0, uv_around), texture=texture)


def lathe(profile: np.ndarray, texture: int, around: int = 24) -> list[GridMesh]:
    """Return :func:`revolve`, with a flat lid if the profile does not start on the axis."""
    side = revolve(profile, texture, around)
    if profile[0, 0] == 0:
        return [side]
    lid = np.stack([np.array([0.0, profile[0, 1]]), profile[0]])
    return [side, revolve(lid, texture, around, 1.0)]


def tube(path: np.ndarray, radii: np.ndarray, texture: int, sides: int = 6) -> GridMesh:
    """Return a tube of circular section along ``path`` (K, 3), with ``radii`` (K,)."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.maximum(np.linalg.norm(tangent, axis=-1, keepdims=True), 1e-30)
    first = np.empty_like(path)
    side = np.array([1.0, 0.0, 0.0]) if abs(tangent[0, 0]) < 0.8 else np.array([0.0, 0.0, 1.0])
    for i, direction in enumerate(tangent):  # parallel transport, so that nothing twists
        side = side - (side @ direction) * direction
        side = side / max(float(np.linalg.norm(side)), 1e-30)
        first[i] = side
    second = np.cross(tangent, first)
    angle = np.linspace(0, 2 * np.pi, sides + 1)[None, :, None]
    ring = np.cos(angle) * first[:, None] - np.sin(angle) * second[:, None]
    points = path[:, None] + radii[:, None, None] * ring
    length = np.linalg.norm(np.diff(path, axis=0), axis=-1).sum()
    reach = max(1.0, length / max(2 * np.pi * float(radii.max()), 1e-30) / 4)
    return GridMesh(points=points, uv=_grid_uv(len(path), sides + 1, min(reach, 4.0), 1.0), texture=texture)


def ribbon(path: np.ndarray, halves: np.ndarray, texture: int) -> GridMesh:
    """Return a strip along ``path`` (K, 3) that extends by ``halves`` (K, 3) to both sides."""
    points = np.stack([path - halves, path, path + halves], 1)
    return GridMesh(points=points, uv=_grid_uv(len(path), 3, 1.0, 0.5), texture=texture, open=True)


def moved(
    meshes: Sequence[GridMesh],
    rotation: np.ndarray | None = None,
    shift: Sequence[float] | np.ndarray = (0, 0, 0),
) -> list[GridMesh]:
    """Return meshes transformed by a matrix (3, 3), then shifted."""
    matrix = np.eye(3) if rotation is None else rotation
    return [replace(mesh, points=mesh.points @ matrix.T + np.asarray(shift, float)) for mesh in meshes]


def _grid_uv(rows: int, columns: int, v_size: float, u_size: float) -> np.ndarray:
    v, u = np.meshgrid(np.linspace(0, v_size, rows), np.linspace(0, u_size, columns), indexing="ij")
    return np.stack([v, u], -1)
