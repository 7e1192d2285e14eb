"""Rays through space, and what every shape of the general tracer can do with them."""

from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from bokehnet.raytrace.scene import Vector

__all__ = ["Hits", "Shape", "SpaceRays", "Surface", "dot", "unit"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SpaceRays:
    """Rays in any direction: the points ``origin + distance * direction`` with distance > 0.

    Distances are counted in lengths of ``direction``. Rays of the camera have direction (x, y, 1), so their
    distances are depths.

    Attributes:
        origin: mm, (N, 3).
        direction: Of any length, (N, 3).
        time: Seconds from the middle of the shutter's opening, (N,).
    """

    origin: Tensor
    direction: Tensor
    time: Tensor

    def at(self, distance: Tensor) -> Tensor:
        """Points (N, 3) at ``distance`` (N,)."""
        return self.origin + distance[:, None] * self.direction

    def seen_from(self, velocity: Vector) -> "SpaceRays":
        """The rays as something sees them that moves with ``velocity``, mm/s, and is in place at time 0."""
        if not any(velocity):
            return self
        moved = self.time[:, None] * self.origin.new_tensor(velocity)
        return SpaceRays(origin=self.origin - moved, direction=self.direction, time=self.time)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Hits:
    """Where rays meet a shape.

    Attributes:
        distance: In lengths of the rays' directions, (N,); infinite where there is nothing.
        element: Which triangle of a mesh, (N,) int64; 0 for shapes without parts.
    """

    distance: Tensor
    element: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Surface:
    """A shape at points where rays meet it.

    Attributes:
        normal: Of length 1, to either side, (N, 3).
        uv: Place in the texture, (N, 2): (0, 0) is its upper left and (1, 1) its lower right corner.
    """

    normal: Tensor
    uv: Tensor


class Shape(Protocol):
    """A surface at rest; x to the right, y down, z along the optical axis, mm."""

    @property
    def closed(self) -> bool:
        """Whether it has an inside, which nothing outside sees; its normals then point outwards."""
        ...

    def intersect(self, rays: SpaceRays, beyond: Tensor) -> Hits:
        """The nearest hit of each ray at a distance above ``beyond``, (N,)."""
        ...

    def surface(self, rays: SpaceRays, hits: Hits) -> Surface:
        """The shape where rays meet it; all hits are finite and from :meth:`intersect`."""
        ...


def dot(first: Tensor, second: Tensor) -> Tensor:
    """Inner products (...,) of vectors (..., 3)."""
    return (first * second).sum(-1)


def unit(vectors: Tensor) -> Tensor:
    """Vectors (..., 3) brought to length 1."""
    return vectors / torch.linalg.vector_norm(vectors, dim=-1, keepdim=True)
