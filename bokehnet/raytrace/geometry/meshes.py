"""Triangle meshes; Intel's Embree intersects them with rays, on the CPU."""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import require_extra
from bokehnet.errors import DataFileError, ParameterError
from bokehnet.raytrace.geometry.space import Hits, SpaceRays, Surface, unit
from bokehnet.raytrace.scene import Vector

__all__ = ["Mesh", "read_mesh"]

# Offset of rays that continue behind a surface, as a fraction of the distance.
_RELATIVE_OFFSET = 1e-5


class Mesh:
    """Triangle mesh with shared vertices.

    Args:
        vertices: Vertices, mm, (V, 3).
        faces: Vertex indices of each triangle, (F, 3).
        uv: Texture coordinates of each vertex, (V, 2), (0, 0) at the upper left; None for all (0, 0).
        normals: Normals of each vertex, (V, 3), for smooth shading; None for flat triangles.
        closed: True if the mesh is watertight, with all triangles counter-clockwise from outside.

    Raises:
        ParameterError: There is no triangle, a coordinate is not finite or a vertex index is out of range.
        MissingExtraError: Embree is not installed.
    """

    def __init__(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        uv: np.ndarray | None = None,
        normals: np.ndarray | None = None,
        closed: bool = False,
    ) -> None:
        require_extra("embreex", "trace")
        if not len(faces):
            raise ParameterError("faces", "at least one triangle", faces, shown="none")
        if not np.isfinite(vertices).all():
            raise ParameterError("vertices", "finite corners", vertices, shown="NaN or infinity")
        if faces.min() < 0 or faces.max() >= len(vertices):
            wrong = faces.min() if faces.min() < 0 else faces.max()
            expected = f"corners 0 to {len(vertices) - 1}, as there are `vertices`"
            raise ParameterError("faces", expected, int(wrong))
        self._corners = torch.from_numpy(np.ascontiguousarray(vertices[faces], np.float32))  # (F, 3, 3)
        zeros = np.zeros((len(vertices), 2), np.float32)
        self._uv = torch.from_numpy(np.ascontiguousarray((zeros if uv is None else uv)[faces], np.float32))
        self._normals = None if normals is None else torch.from_numpy(normals[faces].astype(np.float32))
        self._tree = _make_tree(vertices, faces)
        self._closed = closed

    @property
    def closed(self) -> bool:
        """True if the mesh has an inside."""
        return self._closed

    def intersect(self, rays: SpaceRays, min_distance: Tensor) -> Hits:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`; copies other devices' tensors to the CPU."""
        start = min_distance * (1 + _RELATIVE_OFFSET)
        origins, directions = (
            np.ascontiguousarray(tensor.cpu().numpy(), np.float32)
            for tensor in (rays.at(start), rays.direction)
        )
        result = self._tree.run(origins, directions, output=1)
        element = torch.from_numpy(result["primID"].astype(np.int64)).to(min_distance.device)
        further = torch.from_numpy(result["tfar"]).to(min_distance)
        distance = torch.where(element >= 0, start + further, torch.inf)
        return Hits(distance=distance, element=element)

    def surface(self, rays: SpaceRays, hits: Hits) -> Surface:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`."""
        element = hits.element.cpu()
        corners, uv = (values[element].to(rays.origin) for values in (self._corners, self._uv))
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = torch.linalg.cross(first, second)
        # Barycentric coordinates: relative areas of the triangles between the point and two vertices.
        to_point = rays.at(hits.distance) - corners[:, 0]
        area = (normal * normal).sum(-1).clamp_min(1e-30)
        one = (torch.linalg.cross(to_point, second) * normal).sum(-1) / area
        two = (torch.linalg.cross(first, to_point) * normal).sum(-1) / area
        weights = torch.stack([1 - one - two, one, two], -1)[..., None]
        if self._normals is not None:
            normal = (weights * self._normals[element].to(rays.origin)).sum(1)
        return Surface(normal=unit(normal), uv=(weights * uv).sum(1))


def read_mesh(
    path: Path | str,
    *,
    smooth: bool = False,
    scale: float = 1.0,
    rotation: Vector = (0.0, 0.0, 0.0),
    centre: Vector = (0.0, 0.0, 0.0),
    size: float | None = None,
) -> Mesh:
    """Read an OBJ, PLY, STL or glTF file; all its parts form one mesh.

    Args:
        path: Mesh file with x to the right, y up and z towards the viewer, as in glTF; a rotation by 180
            degrees about x converts to the axes of this module.
        smooth: Use vertex normals for smooth shading.
        scale: Millimetres per unit of the file.
        rotation: Rotation about x, then y, then z after the conversion, degrees; positive about z is
            clockwise in the picture.
        centre: Position of the file's origin, or with ``size`` of the middle of the bounding box, mm.
        size: Longest side of the bounding box before rotation, mm; replaces ``scale``.

    Raises:
        DataFileError: The file cannot be read.
        ParameterError: The file has no triangles.
        MissingExtraError: trimesh or Embree is not installed.
    """
    require_extra("trimesh", "trace")
    import trimesh

    path = Path(path)
    if not path.is_file():
        raise DataFileError(f"{path}: no such file")
    try:
        mesh: Any = trimesh.load(path, force="mesh")
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces)
        normals = np.asarray(mesh.vertex_normals) if smooth else None
        uv = getattr(mesh.visual, "uv", None)
    except Exception as error:  # the parsers raise exceptions of any type
        raise DataFileError(f"{path}: cannot be read as a mesh: {error}") from error
    if size is not None and len(faces):
        low, high = vertices.min(0), vertices.max(0)
        scale, vertices = size / max(float((high - low).max()), 1e-30), vertices - (low + high) / 2
    rotation_matrix = _rotation_matrix(rotation) @ np.diag([1.0, -1.0, -1.0])
    return Mesh(
        vertices @ rotation_matrix.T * scale + centre,
        faces,
        uv=None if uv is None else np.stack([uv[:, 0], 1 - uv[:, 1]], -1),
        normals=None if normals is None else normals @ rotation_matrix.T,
        closed=len(faces) > 0 and bool(mesh.is_volume),
    )


def _rotation_matrix(degrees: Vector) -> np.ndarray:
    """Return the matrix (3, 3) of rotations about x, then y, then z."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians(degrees)):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[first, first] = step[second, second] = np.cos(angle)
        step[first, second], step[second, first] = -np.sin(angle), np.sin(angle)
        matrix = step @ matrix
    return matrix


def _make_tree(vertices: np.ndarray, faces: np.ndarray) -> Any:
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    tree = rtcore_scene.EmbreeScene()
    TriangleMesh(tree, np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32))
    return tree
