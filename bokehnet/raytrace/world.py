"""World of the general ray tracer: shapes with materials, lights, environment and backdrop."""

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

__all__ = ["Body", "SolidHit", "SurfaceHit", "World", "world_from_scene"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Body:
    """Shape with a material and a velocity.

    Attributes:
        shape: Shape at its position at mid-exposure.
        material: Material of its surface.
        velocity: Velocity, mm/s.
        name: Name for messages and maps.
    """

    shape: Shape
    material: Material
    velocity: Vector = (0.0, 0.0, 0.0)
    name: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SurfaceHit:
    """First hits of rays.

    Attributes:
        hits: Hits, (N,).
        body: Index of the body, (N,) int64; -1 for none.
    """

    hits: Hits
    body: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SolidHit:
    """First surfaces with alpha >= 0.5 on rays; zeros without one.

    Attributes:
        hits: Hits, (N,).
        body: Index of the body, (N,) int64; -1 for none.
        normal: Unit normal towards the origin of the ray, (N, 3).
        texture: Premultiplied RGBA, (N, 4).
    """

    hits: Hits
    body: Tensor
    normal: Tensor
    texture: Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """Scene of the general ray tracer.

    Attributes:
        bodies: Bodies in any order.
        lamps: Point lights.
        environment: Light for rays that pass all bodies.
        backdrop: Background that replaces the environment for camera rays that never scattered; it lights
            nothing.
    """

    bodies: tuple[Body, ...] = ()
    lamps: tuple[PointLight, ...] = ()
    environment: Environment = field(default_factory=Environment)
    backdrop: Background | None = None

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        """Targets of shadow rays: lamps, and quads and spheres of uniform emission."""
        area_lights = [
            AreaLight(shape=body.shape, body=index, emission=body.material.emission, velocity=body.velocity)
            for index, body in enumerate(self.bodies)
            if body.material.emits_uniformly and isinstance(body.shape, Quad | Sphere)
        ]
        return (*self.lamps, *area_lights)

    def intersect(self, rays: SpaceRays, min_distance: Tensor, last_body: Tensor) -> SurfaceHit:
        """Return the first body on each ray.

        Args:
            rays: N rays.
            min_distance: Only hits at larger distances count, (N,).
            last_body: At exactly that distance, bodies with a higher index than this count as well, (N,)
                int64, so that rays pass coincident bodies one by one.
        """
        distance = torch.full_like(min_distance, torch.inf)
        element = torch.zeros_like(last_body)
        index = torch.full_like(last_body, -1)
        just_before = torch.nextafter(min_distance, torch.full_like(min_distance, -torch.inf))
        for number, body in enumerate(self.bodies):
            body_min_distance = torch.where(number > last_body, just_before, min_distance).clamp_min(0)
            hits = body.shape.intersect(rays.relative_to(body.velocity), body_min_distance)
            nearer = hits.distance < distance
            distance = torch.where(nearer, hits.distance, distance)
            element = torch.where(nearer, hits.element, element)
            index = torch.where(nearer, number, index)
        return SurfaceHit(hits=Hits(distance=distance, element=element), body=index)

    def first_solid(self, rays: SpaceRays) -> SolidHit:
        """Return the first surface with alpha >= 0.5 on each ray."""
        distance = torch.zeros_like(rays.time)
        element = torch.zeros(len(distance), dtype=torch.int64, device=distance.device)
        normal, texture = torch.zeros_like(rays.origin), distance.new_zeros(len(distance), 4)
        body = torch.full_like(element, -1)
        row = torch.arange(len(distance), device=distance.device)
        min_distance, last_body = distance.clone(), body.clone()
        while len(row):
            hit = self.intersect(pick(rays, row), min_distance, last_body)
            hits_body = hit.body >= 0
            row, hit = row[hits_body], pick(hit, hits_body)
            surface_normal, color = self.surfaces(pick(rays, row), hit)
            solid = color[:, 3] >= 0.5
            ends = row[solid]
            distance[ends], element[ends] = hit.hits.distance[solid], hit.hits.element[solid]
            body[ends], texture[ends] = hit.body[solid], color[solid]
            towards = (surface_normal * rays.direction[row]).sum(-1, keepdim=True) < 0
            normal[ends] = torch.where(towards, surface_normal, -surface_normal)[solid]
            row, min_distance, last_body = row[~solid], hit.hits.distance[~solid], hit.body[~solid]
        hits = Hits(distance=distance, element=element)
        return SolidHit(hits=hits, body=body, normal=normal, texture=texture)

    def surfaces(self, rays: SpaceRays, hit: SurfaceHit) -> tuple[Tensor, Tensor]:
        """Return normals (N, 3), to either side, and textures (N, 4), premultiplied RGBA, at the hits."""
        normal = torch.zeros_like(rays.origin)
        texture = normal.new_zeros(len(normal), 4)
        for number in hit.body.unique().tolist():
            body = self.bodies[number]
            rows = (hit.body == number).nonzero()[:, 0]
            surface = body.shape.surface(pick(rays, rows).relative_to(body.velocity), pick(hit.hits, rows))
            normal[rows] = surface.normal
            texture[rows] = body.material.texture_lookup(surface.uv)
        return normal, texture

    def transmittance(self, rays: SpaceRays, emitter: int) -> Tensor:
        """Return the transmittance (N,) from the start to distance 1 of each ray, without one body.

        Args:
            rays: Rays from surfaces to a light.
            emitter: Index of the emitting body, which is ignored; -1 for none.
        """
        transmittance = torch.ones_like(rays.origin[:, 0])
        start = torch.zeros_like(transmittance)
        for number, body in enumerate(self.bodies):
            if number == emitter:
                continue
            relative_rays = rays.relative_to(body.velocity)
            hits = body.shape.intersect(relative_rays, start)
            between = hits.distance < 1
            if body.material.opaque:
                transmittance = torch.where(between, 0, transmittance)
            else:
                rows = between.nonzero()[:, 0]
                surface = body.shape.surface(pick(relative_rays, rows), pick(hits, rows))
                alpha = body.material.texture_lookup(surface.uv)[:, 3]
                transmittance[rows] *= 1 - alpha
        return transmittance

    def sky(self, rays: SpaceRays, scattered: Tensor) -> Tensor:
        """Return the radiance (N, 3) behind all bodies; ``scattered`` (N,) marks rays that left a body."""
        light = self.environment.texture_lookup(rays.direction)
        if self.backdrop is None:
            return light
        # A turned camera can look away from the backdrop, which is ahead of the origin.
        forward = rays.direction[:, 2:]
        slope = rays.direction[:, :2] / torch.where(forward > 0, forward, 1)
        origin = rays.origin[:, :2] - rays.origin[:, 2:] * slope
        behind = look_up_background(self.backdrop, Rays(origin=origin[None], slope=slope[None]))[:, 0].T
        return torch.where(scattered[:, None] | (forward <= 0), light, behind)


def world_from_scene(scene: Scene) -> World:
    """Return the world of emissive planes that looks as ``scene`` does in its own, faster renderer."""
    bodies = tuple(_body_from(plane) for plane in scene.planes)
    return World(bodies=bodies, backdrop=scene.background)


def _body_from(plane: Plane) -> Body:
    """Return the body of a plane; a border of clear texels reproduces the fade over its outermost texel."""
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
