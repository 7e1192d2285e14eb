"""Spheres."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from bokehnet.checks import check_above
from bokehnet.raytrace.geometry.frames import from_frame
from bokehnet.raytrace.geometry.space import Hits, SpaceRays, Surface, dot
from bokehnet.raytrace.scene import Vector

__all__ = ["Sphere"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Sphere:
    """A sphere; its texture is a map of latitude and longitude with the upper pole (-y) in the first row.

    Raises:
        ParameterError: The radius is not positive.
    """

    centre: Vector
    radius: float

    def __post_init__(self) -> None:
        check_above("radius", self.radius, 0, "mm")

    @property
    def closed(self) -> bool:
        """It has an inside."""
        return True

    def intersect(self, rays: SpaceRays, beyond: Tensor) -> Hits:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`.

        Source:
            Haines, Gunther and Akenine-Moller, "Precision improvements for ray/sphere intersection", Ray
            Tracing Gems, 2019: small far spheres keep their form in single precision.
        """
        to_ray = rays.origin - rays.origin.new_tensor(self.centre)
        square = dot(rays.direction, rays.direction)
        half = -dot(to_ray, rays.direction)
        nearest = to_ray + (half / square)[:, None] * rays.direction  # from the centre to the line
        left = self.radius**2 - dot(nearest, nearest)
        root = half + torch.where(half < 0, -1, 1) * (square * left.clamp_min(0)).sqrt()
        root = torch.where(root == 0, 1e-30, root)  # a ray that leaves a point where it touches
        ends = torch.stack([(dot(to_ray, to_ray) - self.radius**2) / root, root / square])
        ends = torch.where((left >= 0) & (ends > beyond), ends, torch.inf)
        return Hits(distance=ends.amin(0), element=torch.zeros_like(half, dtype=torch.int64))

    def surface(self, rays: SpaceRays, hits: Hits) -> Surface:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`."""
        normal = (rays.at(hits.distance) - rays.origin.new_tensor(self.centre)) / self.radius
        x, y, z = normal.unbind(-1)
        longitude = torch.atan2(x, -z) / (2 * math.pi) + 0.5  # the side that faces the camera is the middle
        latitude = torch.acos((-y).clamp(-1, 1)) / math.pi
        return Surface(normal=normal, uv=torch.stack([longitude, latitude], -1))

    def sample(self, points: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """Way to the near side in even directions; arguments and result as of ``Quad.sample``.

        Points inside the sphere get a solid angle of 0.

        Source:
            Shirley, Wang and Zimmerman, "Monte Carlo techniques for direct lighting calculations", 1996.
        """
        axis = points.new_tensor(self.centre) - points
        length = dot(axis, axis).sqrt().clamp_min(1e-12)
        sine2 = (self.radius / length) ** 2
        outside = sine2 < 1
        cap = sine2 / (1 + (1 - sine2).clamp_min(0).sqrt())  # 1 - cosine of the cone, without cancellation
        cosine = 1 - square[:, 0] * cap
        across2 = (1 - cosine**2).clamp_min(0)
        angle = 2 * math.pi * square[:, 1]
        local = torch.stack([across2.sqrt() * angle.cos(), across2.sqrt() * angle.sin(), cosine], -1)
        near = length * (cosine - (sine2 - across2).clamp_min(0).sqrt())
        way = near[:, None] * from_frame(axis / length[:, None], local)
        return way, torch.where(outside, 2 * math.pi * cap, 0)
