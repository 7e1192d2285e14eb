"""Draft of a picture without noise: direct light of the middle of each light, unshadowed ambient light."""

import math

import torch
from torch import Tensor

from bokehnet.raytrace.geometry.space import SpaceRays, dot
from bokehnet.raytrace.geometry.tables import pick
from bokehnet.raytrace.world import World

__all__ = ["draft_light"]

# Offset of shadow rays from their surface, as a fraction of their largest coordinate.
_LIFT = 2e-5


@torch.no_grad()
def draft_light(world: World, rays: SpaceRays) -> tuple[Tensor, Tensor]:
    """Return the draft radiance (N, 3) and the distance (N,) of the first solid surface of each ray.

    Area lights shine from their middle, so that shadows are hard; mirrors reflect the environment alone. The
    distance is infinite without a surface.

    Args:
        world: The scene.
        rays: N rays from the lens.
    """
    solid = world.first_solid(rays)
    light = world.sky(rays, torch.zeros_like(solid.body, dtype=torch.bool))
    light = light.clone()
    row = (solid.body >= 0).nonzero()[:, 0]
    distance = torch.where(solid.body >= 0, solid.hits.distance, torch.inf)
    if not len(row):
        return light, distance
    near, seen = pick(solid, row), pick(rays, row)

    def constants(name: str) -> Tensor:
        values = [getattr(body.material, name) for body in world.bodies]
        return torch.tensor(values, device=light.device)[near.body]

    color = near.texture[:, :3] / near.texture[:, 3:].clamp_min(1e-6)
    diffuse = color * (constants("color") + constants("translucency"))
    mirrored = seen.direction - 2 * dot(seen.direction, near.normal)[:, None] * near.normal
    ambient = world.environment.texture.to(light).mean((1, 2))
    shaded = color * constants("emission") + diffuse * ambient
    shaded += constants("specular") * world.environment.texture_lookup(mirrored)
    point = seen.at(near.hits.distance)
    point = point + near.normal * (_LIFT * point.abs().amax(-1, keepdim=True))
    middle = torch.full_like(point[:, :2], 0.5)
    for lamp in world.lights:
        offset, power = lamp.sample(point, seen.time, middle)
        cosine = dot(offset, near.normal) / torch.linalg.vector_norm(offset, dim=-1).clamp_min(1e-9)
        shadow_rays = SpaceRays(origin=point, direction=offset, time=seen.time)
        clear = world.transmittance(shadow_rays, lamp.body) * cosine.clamp_min(0)
        shaded += diffuse / math.pi * power * clear[:, None]
    light[row] = shaded
    return light, distance
