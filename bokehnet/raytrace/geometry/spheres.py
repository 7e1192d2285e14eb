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
    """Sphere; its texture is a latitude-longitude map with the upper pole (-y) in the first row.

    Raises:
        ParameterError: The radius is not positive.
    """

    centre: Vector
    radius: float

    def __post_init__(self) -> None:
        check_above("radius", self.radius, 0, "mm")

    @property
    def closed(self) -> bool:
        """True: a sphere has an inside."""
        return True

    def intersect(self, rays: SpaceRays, min_distance: Tensor) -> Hits:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`.

        Source:
            Haines, Gunther and Akenine-Moller, "Precision improvements for ray/sphere intersection", Ray
            Tracing Gems, 2019: accurate for small distant spheres in single precision.
        """
        to_ray = rays.origin - rays.origin.new_tensor(self.centre)
        square = dot(rays.direction, rays.direction)
        half = -dot(to_ray, rays.direction)
        nearest = to_ray + (half / square)[:, None] * rays.direction  # from the centre to the line
        discriminant = self.radius**2 - dot(nearest, nearest)
        root = half + torch.where(half < 0, -1, 1) * (square * discriminant.clamp_min(0)).sqrt()
        root = torch.where(root == 0, 1e-30, root)  # a ray that starts at its point of tangency
        ends = torch.stack([(dot(to_ray, to_ray) - self.radius**2) / root, root / square])
        ends = torch.where((discriminant >= 0) & (ends > min_distance), ends, torch.inf)
        return Hits(distance=ends.amin(0), element=torch.zeros_like(half, dtype=torch.int64))

    def surface(self, rays: SpaceRays, hits: Hits) -> Surface:
        """See :class:`bokehnet.raytrace.geometry.space.Shape`."""
        normal = (rays.at(hits.distance) - rays.origin.new_tensor(self.centre)) / self.radius
        x, y, z = normal.unbind(-1)
        longitude = torch.atan2(x, -z) / (2 * math.pi) + 0.5  # the side that faces the camera is the middle
        latitude = torch.acos((-y).clamp(-1, 1)) / math.pi
        return Surface(normal=normal, uv=torch.stack([longitude, latitude], -1))

    def sample(self, points: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """Return offsets to the near side in uniform directions; arguments and result as in ``Quad.sample``.

        The solid angle is 0 for points inside the sphere.

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
        offset = near[:, None] * from_frame(axis / length[:, None], local)
        return offset, torch.where(outside, 2 * math.pi * cap, 0)
