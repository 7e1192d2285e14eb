"""Path tracing from the lens over surfaces to lights."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from bokehnet.raytrace.geometry.frames import cosine_directions
from bokehnet.raytrace.geometry.space import SpaceRays, dot, unit
from bokehnet.raytrace.geometry.tables import join, pick
from bokehnet.raytrace.surfaces.ggx import ggx_reflectance, sample_ggx
from bokehnet.raytrace.world import SurfaceHit, World

__all__ = ["DIMENSIONS_PER_BOUNCE", "Numbers", "Traced", "trace_paths"]

# Indices of the random numbers of each bounce.
_ALPHA, _LOBE, _LOBE_UV, _LIGHT, _LIGHT_UV = 0, 1, (2, 3), 4, (5, 6)
DIMENSIONS_PER_BOUNCE = 7

# Function of dimensions (M,) int64 and ray rows (M,) int64; returns numbers (M,) in [0, 1).
Numbers = Callable[[Tensor, Tensor], Tensor]

# Offset of scattered rays from their surface, as a fraction of their largest coordinate.
_LIFT = 2e-5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Traced:
    """Result of traced rays.

    Attributes:
        color: Radiance, (N, 3).
        coverage: Coverage of each ray by bodies, (N,).
    """

    color: Tensor
    coverage: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Paths:
    """Paths in progress.

    Attributes:
        row: Row of the result, (M,).
        rays: Last segments.
        weight: Throughput from the end of the path to the lens, (M, 3).
        min_distance: See ``World.intersect``, (M,).
        last_body: See ``World.intersect``, (M,).
        bounce: Number of scattering events, (M,).
        lit: True if shadow rays gathered the lights at the start of the last segment, (M,).
        chance: Random number that decides the next alpha test, (M,).
    """

    row: Tensor
    rays: SpaceRays
    weight: Tensor
    min_distance: Tensor
    last_body: Tensor
    bounce: Tensor
    lit: Tensor
    chance: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Shading:
    """Surface properties at hits: colours and vectors (M, 3), others (M,); the normal faces the path."""

    point: Tensor
    normal: Tensor
    diffuse: Tensor
    specular: Tensor
    translucency: Tensor
    emission: Tensor
    alpha: Tensor
    roughness: Tensor
    reflects: Tensor
    light: Tensor


@torch.no_grad()
def trace_paths(
    world: World,
    rays: SpaceRays,
    numbers: Numbers,
    bounces: int,
    start: tuple[Tensor, Tensor] | None = None,
    first_only: bool = False,
) -> Traced:
    """Trace rays from the lens.

    Emissive surfaces that do not scatter are composited in the order in which each ray meets them. At a
    scattering surface, a ray passes with probability 1 - alpha. A scattered ray samples one lobe with a
    probability proportional to its brightness; a transmitted ray has a direction of the glossy lobe, mirrored
    at the surface. The diffuse lobe receives the light of ``World.lights`` by a shadow ray to one of them;
    the scattered ray gathers all other light.

    Args:
        world: The scene.
        rays: N rays from the lens.
        numbers: Source of random numbers.
        bounces: Maximum number of scattering events; 0 shows only emission.
        start: ``min_distance`` and ``last_body`` of :meth:`World.intersect` for the first step.
        first_only: Terminate rays that pass the first surface; ``coverage`` is then its alpha.

    Source:
        Kajiya, "The rendering equation", 1986; Cook, Porter and Carpenter, "Distributed ray tracing", 1984.
    """
    row = torch.arange(len(rays.origin), device=rays.origin.device)
    color = torch.zeros_like(rays.origin)
    coverage = torch.ones_like(color[:, 0])
    min_distance, last_body = start or (torch.zeros_like(coverage), torch.full_like(row, -1))
    paths = _Paths(
        row=row,
        rays=rays,
        weight=torch.ones_like(color),
        min_distance=min_distance,
        last_body=last_body,
        bounce=torch.zeros_like(row),
        lit=torch.zeros_like(row, dtype=torch.bool),
        chance=numbers(torch.full_like(row, _ALPHA), row),
    )
    while True:
        hit = world.intersect(paths.rays, paths.min_distance, paths.last_body)
        escaped = pick(paths, hit.body < 0)
        color[escaped.row] += escaped.weight * world.sky(escaped.rays, escaped.bounce > 0)
        direct = escaped.bounce == 0
        coverage[escaped.row[direct]] = 0 if first_only else 1 - escaped.weight[direct, 0]
        if len(escaped.row) == len(paths.row):
            break
        hits_body = hit.body >= 0
        paths, hit = pick(paths, hits_body), pick(hit, hits_body)
        shading = _shade(world, paths.rays, hit)
        counted = ~(paths.lit & shading.light)
        color[paths.row] += paths.weight * shading.emission * counted[:, None]
        stopped = shading.reflects & (paths.chance < shading.alpha)
        scatters = (stopped & (paths.bounce < bounces)).nonzero()[:, 0]
        scattered, light = _scatter(world, pick(paths, scatters), pick(shading, scatters), numbers)
        color[scattered.row] += light
        passing = ~stopped
        if first_only:
            direct = paths.bounce == 0
            coverage[paths.row[direct]] = shading.alpha[direct]
            passing &= ~direct
        paths = join(pick(_pass(paths, hit, shading), passing), scattered)
        paths = pick(paths, (paths.weight > 0).any(-1))
    return Traced(color=color, coverage=coverage)


def _shade(world: World, rays: SpaceRays, hit: SurfaceHit) -> _Shading:
    """Return the surface properties at all hits."""
    normal, texture = world.surfaces(rays, hit)
    facing = dot(normal, rays.direction) < 0
    materials = [body.material for body in world.bodies]

    def constants(name: str) -> Tensor:
        values = [getattr(material, name) for material in materials]
        return torch.tensor(values, device=normal.device)[hit.body]

    texture_color = texture[:, :3] / texture[:, 3:].clamp_min(1e-6)
    return _Shading(
        point=rays.at(hit.hits.distance),
        normal=torch.where(facing[:, None], normal, -normal),
        diffuse=texture_color * constants("color"),
        specular=constants("specular"),
        translucency=constants("translucency"),
        emission=texture[:, :3] * constants("emission"),
        alpha=texture[:, 3],
        roughness=constants("roughness"),
        reflects=constants("reflects"),
        light=torch.isin(hit.body, hit.body.new_tensor([light.body for light in world.lights])),
    )


def _pass(paths: _Paths, hit: SurfaceHit, shading: _Shading) -> _Paths:
    """Return the same rays behind the surface; after a random alpha test their weight stays unchanged."""
    clear = 1 - shading.alpha
    rest = ((paths.chance - shading.alpha) / clear.clamp_min(1e-6)).clamp(0, 1)
    return replace(
        paths,
        weight=paths.weight * torch.where(shading.reflects, 1, clear)[:, None],
        min_distance=hit.hits.distance,
        last_body=hit.body,
        chance=torch.where(shading.reflects, rest, paths.chance),
    )


def _scatter(world: World, paths: _Paths, shading: _Shading, numbers: Numbers) -> tuple[_Paths, Tensor]:
    """Return the paths that leave a surface, and the light (M, 3) of ``World.lights`` that it scatters."""

    def draw(dimension: int, bounce: Tensor = paths.bounce) -> Tensor:
        return numbers(bounce * DIMENSIONS_PER_BOUNCE + dimension, paths.row)

    view = -unit(paths.rays.direction)
    lift = shading.normal * (_LIFT * shading.point.abs().amax(-1, keepdim=True))
    diffuse, specular, translucent = (
        lobe.mean(-1) for lobe in (shading.diffuse, shading.specular, shading.translucency)
    )
    diffuse_chance = diffuse / (diffuse + (specular + translucent)).clamp_min(1e-12)
    passing = translucent / (specular + translucent).clamp_min(1e-12)  # fraction of glossy rays
    number = draw(_LOBE)
    glossy = number >= diffuse_chance
    transmitted = (
        glossy & (number >= diffuse_chance + (1 - diffuse_chance) * (1 - passing)) & (translucent > 0)
    )
    square = torch.stack([draw(dimension) for dimension in _LOBE_UV], -1)
    mirrored, reflectance = sample_ggx(view, shading.normal, shading.roughness, square)
    direction = torch.where(glossy[:, None], mirrored, cosine_directions(shading.normal, square))
    direction = torch.where(transmitted[:, None], _mirrored_at(mirrored, shading.normal), direction)
    lobe = torch.where(
        transmitted[:, None],
        shading.translucency / passing[:, None],
        shading.specular / (1 - passing)[:, None],
    )
    lobe = lobe * (reflectance / (1 - diffuse_chance))[:, None]
    factor = torch.where(glossy[:, None], lobe, shading.diffuse / diffuse_chance.clamp_min(1e-12)[:, None])
    scattered = replace(
        paths,
        rays=SpaceRays(
            origin=shading.point + torch.where(transmitted[:, None], -lift, lift),
            direction=direction,
            time=paths.rays.time,
        ),
        weight=paths.weight * factor,
        min_distance=torch.zeros_like(paths.min_distance),
        last_body=torch.full_like(paths.last_body, -1),
        bounce=paths.bounce + 1,
        lit=~glossy,
        chance=draw(_ALPHA, paths.bounce + 1),
    )
    light = torch.zeros_like(paths.weight)
    if world.lights:
        square = torch.stack([draw(dimension) for dimension in _LIGHT_UV], -1)
        light = _gather(world, paths.rays.time, shading, lift, view, draw(_LIGHT), square)
    return scattered, paths.weight * light


def _mirrored_at(directions: Tensor, normal: Tensor) -> Tensor:
    """Return directions (M, 3) mirrored at a surface."""
    return directions - 2 * dot(directions, normal)[:, None] * normal


def _gather(
    world: World, time: Tensor, shading: _Shading, lift: Tensor, view: Tensor, choice: Tensor, square: Tensor
) -> Tensor:
    """Return the reflected light (M, 3) of one random light, times the number of lights."""
    count = len(world.lights)
    light_index = (choice * count).long().clamp_max(count - 1)
    light = torch.zeros_like(view)
    for number, lamp in enumerate(world.lights):
        rows = (light_index == number).nonzero()[:, 0]
        local, origin = pick(shading, rows), shading.point[rows] + lift[rows]
        offset, power = lamp.sample(origin, time[rows], square[rows])
        direction = unit(offset)
        cosine = dot(direction, local.normal)
        reflectance = local.diffuse / math.pi
        if lamp.body < 0:  # no scattered ray hits a point light, so its gloss is added here
            behind = (cosine < 0)[:, None]
            mirrored = torch.where(behind, _mirrored_at(direction, local.normal), direction)
            gloss = ggx_reflectance(view[rows], mirrored, local.normal, local.roughness)[:, None]
            reflected = reflectance + local.specular * gloss
            reflectance = torch.where(behind, local.translucency * gloss, reflected)
            origin, cosine = torch.where(behind, local.point - lift[rows], origin), cosine.abs()
        clear = world.transmittance(SpaceRays(origin=origin, direction=offset, time=time[rows]), lamp.body)
        light[rows] = count * reflectance * power * (cosine.clamp_min(0) * clear)[:, None]
    return light
