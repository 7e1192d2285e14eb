"""Everything that light can meet: shapes with their materials, lights, and what is far away."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from bokehnet.lenses import Rays
from bokehnet.raytrace.geometry.intersect import look_up_background
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.space import Hits, Shape, SpaceRays
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.geometry.tables import pick
from bokehnet.raytrace.scene import Background, Plane, Scene, Vector
from bokehnet.raytrace.surfaces.lights import AreaLight, Environment, Light, PointLight
from bokehnet.raytrace.surfaces.materials import Material

__all__ = ["Body", "SurfaceHit", "World", "world_from_scene"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Body:
    """A shape of some material that may move.

    Attributes:
        shape: Where it is in the middle of the shutter's opening.
        material: What it does with light.
        velocity: mm/s.
        name: For messages and maps.
    """

    shape: Shape
    material: Material
    velocity: Vector = (0.0, 0.0, 0.0)
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SurfaceHit:
    """What rays meet first.

    Attributes:
        hits: Where, (N,).
        body: Index of the body, (N,) int64; -1 for none.
    """

    hits: Hits
    body: Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """A scene of the general tracer.

    Attributes:
        bodies: In any order.
        lamps: Lights without size.
        environment: What rays meet that pass all bodies.
        backdrop: What rays from the camera meet instead that were never scattered; it lights nothing.
    """

    bodies: tuple[Body, ...] = ()
    lamps: tuple[PointLight, ...] = ()
    environment: Environment = field(default_factory=Environment)
    backdrop: Background | None = None

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        """All lights that shadow rays are sent to: lamps, and quads and spheres of even emission."""
        shining = [
            AreaLight(shape=body.shape, body=index, emission=body.material.emission, velocity=body.velocity)
            for index, body in enumerate(self.bodies)
            if body.material.shines_evenly and isinstance(body.shape, Quad | Sphere)
        ]
        return (*self.lamps, *shining)

    def intersect(self, rays: SpaceRays, beyond: Tensor, last: Tensor) -> SurfaceHit:
        """Return the first body of each ray.

        Args:
            rays: N rays.
            beyond: Only what is further than this counts, (N,).
            last: At exactly that distance bodies of a higher index than this count too, (N,) int64, so that
                rays pass bodies that lie in one another one by one.
        """
        distance = torch.full_like(beyond, torch.inf)
        element = torch.zeros_like(last)
        index = torch.full_like(last, -1)
        just_before = torch.nextafter(beyond, torch.full_like(beyond, -torch.inf))
        for number, body in enumerate(self.bodies):
            least = torch.where(number > last, just_before, beyond).clamp_min(0)
            hits = body.shape.intersect(rays.seen_from(body.velocity), least)
            nearer = hits.distance < distance
            distance = torch.where(nearer, hits.distance, distance)
            element = torch.where(nearer, hits.element, element)
            index = torch.where(nearer, number, index)
        return SurfaceHit(hits=Hits(distance=distance, element=element), body=index)

    def surfaces(self, rays: SpaceRays, hit: SurfaceHit) -> tuple[Tensor, Tensor]:
        """Normals (N, 3), to either side, and textures (N, 4), RGB times alpha and alpha, where rays end."""
        normal = torch.zeros_like(rays.origin)
        texture = normal.new_zeros(len(normal), 4)
        for number in hit.body.unique().tolist():
            body = self.bodies[number]
            rows = (hit.body == number).nonzero()[:, 0]
            surface = body.shape.surface(pick(rays, rows).seen_from(body.velocity), pick(hit.hits, rows))
            normal[rows] = surface.normal
            texture[rows] = body.material.texture_lookup(surface.uv)
        return normal, texture

    def transmittance(self, rays: SpaceRays, own: int) -> Tensor:
        """Share of light (N,) that goes from the start to distance 1 of each ray past all but one body.

        Args:
            rays: From surfaces to a light.
            own: Index of the body that shines; -1 for none.
        """
        share = torch.ones_like(rays.origin[:, 0])
        start = torch.zeros_like(share)
        for number, body in enumerate(self.bodies):
            if number == own:
                continue
            seen = rays.seen_from(body.velocity)
            hits = body.shape.intersect(seen, start)
            between = hits.distance < 1
            if body.material.opaque:
                share = torch.where(between, 0, share)
            else:
                rows = between.nonzero()[:, 0]
                surface = body.shape.surface(pick(seen, rows), pick(hits, rows))
                alpha = body.material.texture_lookup(surface.uv)[:, 3]
                share[rows] *= 1 - alpha
        return share

    def sky(self, rays: SpaceRays, scattered: Tensor) -> Tensor:
        """Radiance (N, 3) that rays find beyond all bodies; ``scattered`` (N,): those that left a body."""
        light = self.environment.texture_lookup(rays.direction)
        if self.backdrop is None:
            return light
        lens_rays = Rays(origin=rays.origin[None, :, :2], slope=rays.direction[None, :, :2])
        return torch.where(scattered[:, None], light, look_up_background(self.backdrop, lens_rays)[:, 0].T)


def world_from_scene(scene: Scene) -> World:
    """Return the world in which the planes of ``scene`` shine as its own, faster renderer shows them."""
    bodies = tuple(_body_from(plane) for plane in scene.planes)
    return World(bodies=bodies, backdrop=scene.background)


def _body_from(plane: Plane) -> Body:
    """A plane fades to nothing over its outermost texel: a border of clear texels does the same."""
    height, width = plane.texture.shape[1:]
    u, v = (
        np.array(axis) * (size + 2) / (size + 1)
        for axis, size in ((plane.u_axis, width), (plane.v_axis, height))
    )
    padded = torch.nn.functional.pad(plane.texture, (1, 1, 1, 1))
    return Body(
        shape=Quad(centre=plane.centre, u_axis=tuple(u.tolist()), v_axis=tuple(v.tolist())),
        material=Material(emission=(1.0, 1.0, 1.0), texture=padded),
    )
