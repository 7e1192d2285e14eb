"""Parallelograms."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from bokehnet.errors import ParameterError
from bokehnet.raytrace.geometry.space import Hits, SpaceRays, Surface, dot
from bokehnet.raytrace.scene import Vector

__all__ = ["Quad"]


@dataclass(frozen=True, kw_only=True)
class Quad:
    """Parallelogram: the points ``centre + a * u_axis + b * v_axis`` with a, b in [-1, 1]; mm.

    Columns of a texture run along ``u_axis``, rows along ``v_axis``.

    Raises:
        ParameterError: The area is zero.
    """

    centre: Vector
    u_axis: Vector
    v_axis: Vector

    def __post_init__(self) -> None:
        if not self.area > 0:
            raise ParameterError(
                "u_axis",
                "two different directions, with `v_axis`, of a length above 0",
                self.u_axis,
                shown=f"{self.u_axis} and {self.v_axis} mm",
            )

    @property
    def area(self) -> float:
        """Area, mm^2."""
        return 4 * float(np.linalg.norm(np.cross(self.u_axis, self.v_axis)))

    @property
    def closed(self) -> bool:
        """False: a quad has no inside."""
        return False

    @cached_property
    def _frame(self) -> np.ndarray:
        """Rows: the unit normal, and the two vectors whose products with a point of the quad are a and b."""
        u, v = np.array(self.u_axis, float), np.array(self.v_axis, float)
        normal = np.cross(u, v)
        duals = np.stack([np.cross(v, normal), np.cross(normal, u)]) / (normal @ normal)
        return np.stack([normal / np.linalg.norm(normal), *duals])

    def _coordinates(self, rays: SpaceRays, distance: Tensor) -> Tensor:
        """Return the coordinates a and b, (N, 2), of the points at ``distance``."""
        from_centre = rays.at(distance) - rays.origin.new_tensor(self.centre)
        return from_centre @ rays.origin.new_tensor(self._frame[1:]).T

    def intersect(self, rays: SpaceRays, min_distance: Tensor) -> Hits:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`."""
        normal = rays.origin.new_tensor(self._frame[0])
        distance = ((rays.origin.new_tensor(self.centre) - rays.origin) @ normal) / (rays.direction @ normal)
        inside = (distance > min_distance) & (distance < torch.inf)  # False also for rays within the plane
        coordinates = self._coordinates(rays, distance)
        inside &= (coordinates.abs() <= 1).all(-1)
        return Hits(
            distance=torch.where(inside, distance, torch.inf),
            element=torch.zeros_like(distance, dtype=torch.int64),
        )

    def surface(self, rays: SpaceRays, hits: Hits) -> Surface:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`."""
        normal = rays.origin.new_tensor(self._frame[0]).expand(len(rays.origin), 3)
        return Surface(normal=normal, uv=(self._coordinates(rays, hits.distance) + 1) / 2)

    def sample(self, points: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """Return offsets from ``points`` (N, 3) to uniform random points of the quad, and their solid angles.

        Args:
            points: Points, mm, (N, 3).
            square: Random numbers in [0, 1), (N, 2).

        Returns:
            Vectors (N, 3), mm, and solid angles (N,): the mean of solid angle * f estimates the integral of f
                over the directions to the quad.
        """
        axes = points.new_tensor([self.u_axis, self.v_axis])
        offset = points.new_tensor(self.centre) + (2 * square - 1) @ axes - points
        facing = (offset @ points.new_tensor(self._frame[0])).abs()
        return offset, self.area * facing / dot(offset, offset).clamp_min(1e-12) ** 1.5
