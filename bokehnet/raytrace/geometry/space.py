"""Rays in space, and the interface of the shapes of the general ray tracer."""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from bokehnet.raytrace.scene import Vector

__all__ = ["Hits", "Shape", "SpaceRays", "Surface", "dot", "unit"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SpaceRays:
    """Rays in any direction: the points ``origin + distance * direction`` with distance > 0.

    Distances are multiples of the length of ``direction``. Rays of the camera have direction (x, y, 1), so
    their distances are depths.

    Attributes:
        origin: Origins, mm, (N, 3).
        direction: Directions of any length, (N, 3).
        time: Time from mid-exposure, s, (N,).
    """

    origin: Tensor
    direction: Tensor
    time: Tensor

    def at(self, distance: Tensor) -> Tensor:
        """Return the points (N, 3) at ``distance`` (N,)."""
        return self.origin + distance[:, None] * self.direction

    def relative_to(self, velocity: Vector) -> "SpaceRays":
        """Return the rays in the frame of a body of ``velocity``, mm/s, that is at its position at time 0."""
        if not any(velocity):
            return self
        displacement = self.time[:, None] * self.origin.new_tensor(velocity)
        return SpaceRays(origin=self.origin - displacement, direction=self.direction, time=self.time)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Hits:
    """Hits of rays on a shape.

    Attributes:
        distance: Distance in lengths of the rays' directions, (N,); infinite without a hit.
        element: Index of the triangle of a mesh, (N,) int64; 0 for other shapes.
    """

    distance: Tensor
    element: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Surface:
    """Properties of a shape at hits.

    Attributes:
        normal: Unit normal, to either side, (N, 3).
        uv: Texture coordinates, (N, 2): (0, 0) is the upper left and (1, 1) the lower right corner.
    """

    normal: Tensor
    uv: Tensor


class Shape(Protocol):
    """Surface at rest; x to the right, y down, z along the optical axis, mm."""

    @property
    def closed(self) -> bool:
        """True if the shape has an inside that is invisible from outside; its normals then point outwards."""
        ...

    def intersect(self, rays: SpaceRays, min_distance: Tensor) -> Hits:
        """Return the nearest hit of each ray at a distance above ``min_distance``, (N,)."""
        ...

    def surface(self, rays: SpaceRays, hits: Hits) -> Surface:
        """Return the properties at hits, which must be finite and from :meth:`intersect`."""
        ...


def dot(first: Tensor, second: Tensor) -> Tensor:
    """Return the inner products (...,) of vectors (..., 3)."""
    return (first * second).sum(-1)


def unit(vectors: Tensor) -> Tensor:
    """Return vectors (..., 3) normalized to length 1."""
    return vectors / torch.linalg.vector_norm(vectors, dim=-1, keepdim=True)
