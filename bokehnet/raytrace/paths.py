"""Light along rays: paths from the lens over surfaces to lights."""

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

# Random numbers of each bounce, by their place.
_ALPHA, _LOBE, _LOBE_UV, _LIGHT, _LIGHT_UV = 0, 1, (2, 3), 4, (5, 6)
DIMENSIONS_PER_BOUNCE = 7

# Gives numbers (M,) in [0, 1) for a dimension (M,) int64 of the rays in rows (M,) int64.
Numbers = Callable[[Tensor, Tensor], Tensor]

# Scattered rays start this share of their largest coordinate off the surface.
_LIFT = 2e-5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Traced:
    """What rays saw.

    Attributes:
        color: Radiance, (N, 3).
        coverage: Share of each ray that met a body, (N,).
    """

    color: Tensor
    coverage: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Paths:
    """Paths on their way.

    Attributes:
        row: Which result they belong to, (M,).
        rays: Their last leg.
        weight: Share of the light at their end that arrives, (M, 3).
        beyond: See ``World.intersect``, as is ``last``.
        last: (M,).
        bounce: How often they were scattered, (M,).
        lit: Whether lights were gathered where the last leg starts, (M,).
        chance: The number that decides about the next alpha, (M,).
    """

    row: Tensor
    rays: SpaceRays
    weight: Tensor
    beyond: Tensor
    last: Tensor
    bounce: Tensor
    lit: Tensor
    chance: Tensor


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Shading:
    """Bodies where paths meet them: colours and vectors (M, 3), others (M,); the normal faces the path."""

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
    """Follow rays from the lens.

    Surfaces that only shine are composited in the order in which each ray meets them. Of surfaces that
    scatter light, alpha decides by chance whether a ray passes. A scattered ray takes one of the lobes,
    by their brightness; through a translucent surface it goes as the glossy lobe would send it, mirrored at
    the surface. The even lobe gets the light of ``World.lights`` by a shadow ray to one of them; all
    other light is found by the scattered ray.

    Args:
        world: The scene.
        rays: N rays from the lens.
        numbers: Random numbers.
        bounces: How often light may be scattered; with 0 only what shines is seen.
        start: ``beyond`` and ``last`` of :meth:`World.intersect` for the first step.
        first_only: Stop rays that pass the first surface; ``coverage`` is then its alpha.

    Source:
        Kajiya, "The rendering equation", 1986; Cook, Porter and Carpenter, "Distributed ray tracing", 1984.
    """
    row = torch.arange(len(rays.origin), device=rays.origin.device)
    color = torch.zeros_like(rays.origin)
    coverage = torch.ones_like(color[:, 0])
    beyond, last = start or (torch.zeros_like(coverage), torch.full_like(row, -1))
    paths = _Paths(
        row=row,
        rays=rays,
        weight=torch.ones_like(color),
        beyond=beyond,
        last=last,
        bounce=torch.zeros_like(row),
        lit=torch.zeros_like(row, dtype=torch.bool),
        chance=numbers(torch.full_like(row, _ALPHA), row),
    )
    while True:
        hit = world.intersect(paths.rays, paths.beyond, paths.last)
        gone = pick(paths, hit.body < 0)
        color[gone.row] += gone.weight * world.sky(gone.rays, gone.bounce > 0)
        direct = gone.bounce == 0
        coverage[gone.row[direct]] = 0 if first_only else 1 - gone.weight[direct, 0]
        if len(gone.row) == len(paths.row):
            break
        there = hit.body >= 0
        paths, hit = pick(paths, there), pick(hit, there)
        shading = _shade(world, paths.rays, hit)
        counted = ~(paths.lit & shading.light)
        color[paths.row] += paths.weight * shading.emission * counted[:, None]
        stopped = shading.reflects & (paths.chance < shading.alpha)
        scatters = (stopped & (paths.bounce < bounces)).nonzero()[:, 0]
        leaving, light = _scatter(world, pick(paths, scatters), pick(shading, scatters), numbers)
        color[leaving.row] += light
        passing = ~stopped
        if first_only:
            direct = paths.bounce == 0
            coverage[paths.row[direct]] = shading.alpha[direct]
            passing &= ~direct
        paths = join(pick(_pass(paths, hit, shading), passing), leaving)
        paths = pick(paths, (paths.weight > 0).any(-1))
    return Traced(color=color, coverage=coverage)


def _shade(world: World, rays: SpaceRays, hit: SurfaceHit) -> _Shading:
    """Gather the materials of all bodies that were met."""
    normal, texture = world.surfaces(rays, hit)
    towards = dot(normal, rays.direction) < 0
    materials = [body.material for body in world.bodies]

    def constants(name: str) -> Tensor:
        values = [getattr(material, name) for material in materials]
        return torch.tensor(values, device=normal.device)[hit.body]

    pure = texture[:, :3] / texture[:, 3:].clamp_min(1e-6)
    return _Shading(
        point=rays.at(hit.hits.distance),
        normal=torch.where(towards[:, None], normal, -normal),
        diffuse=pure * constants("color"),
        specular=constants("specular"),
        translucency=constants("translucency"),
        emission=texture[:, :3] * constants("emission"),
        alpha=texture[:, 3],
        roughness=constants("roughness"),
        reflects=constants("reflects"),
        light=torch.isin(hit.body, hit.body.new_tensor([light.body for light in world.lights])),
    )


def _pass(paths: _Paths, hit: SurfaceHit, shading: _Shading) -> _Paths:
    """The same rays beyond the surface; what was left to chance is not taken from their weight."""
    clear = 1 - shading.alpha
    rest = ((paths.chance - shading.alpha) / clear.clamp_min(1e-6)).clamp(0, 1)
    return replace(
        paths,
        weight=paths.weight * torch.where(shading.reflects, 1, clear)[:, None],
        beyond=hit.hits.distance,
        last=hit.body,
        chance=torch.where(shading.reflects, rest, paths.chance),
    )


def _scatter(world: World, paths: _Paths, shading: _Shading, numbers: Numbers) -> tuple[_Paths, Tensor]:
    """Return the paths that leave a surface, and the light (M, 3) of lamps that arrives over it."""

    def draw(dimension: int, bounce: Tensor = paths.bounce) -> Tensor:
        return numbers(bounce * DIMENSIONS_PER_BOUNCE + dimension, paths.row)

    view = -unit(paths.rays.direction)
    lift = shading.normal * (_LIFT * shading.point.abs().amax(-1, keepdim=True))
    even, gloss, clear = (lobe.mean(-1) for lobe in (shading.diffuse, shading.specular, shading.translucency))
    share = even / (even + (gloss + clear)).clamp_min(1e-12)
    passing = clear / (gloss + clear).clamp_min(1e-12)  # of the glossy rays
    number = draw(_LOBE)
    glossy = number >= share
    through = glossy & (number >= share + (1 - share) * (1 - passing)) & (clear > 0)
    square = torch.stack([draw(dimension) for dimension in _LOBE_UV], -1)
    mirrored, reflectance = sample_ggx(view, shading.normal, shading.roughness, square)
    direction = torch.where(glossy[:, None], mirrored, cosine_directions(shading.normal, square))
    direction = torch.where(through[:, None], _other_side(mirrored, shading.normal), direction)
    lobe = torch.where(
        through[:, None], shading.translucency / passing[:, None], shading.specular / (1 - passing)[:, None]
    )
    lobe = lobe * (reflectance / (1 - share))[:, None]
    factor = torch.where(glossy[:, None], lobe, shading.diffuse / share.clamp_min(1e-12)[:, None])
    leaving = replace(
        paths,
        rays=SpaceRays(
            origin=shading.point + torch.where(through[:, None], -lift, lift),
            direction=direction,
            time=paths.rays.time,
        ),
        weight=paths.weight * factor,
        beyond=torch.zeros_like(paths.beyond),
        last=torch.full_like(paths.last, -1),
        bounce=paths.bounce + 1,
        lit=~glossy,
        chance=draw(_ALPHA, paths.bounce + 1),
    )
    light = torch.zeros_like(paths.weight)
    if world.lights:
        square = torch.stack([draw(dimension) for dimension in _LIGHT_UV], -1)
        light = _gather(world, paths.rays.time, shading, lift, view, draw(_LIGHT), square)
    return leaving, paths.weight * light


def _other_side(directions: Tensor, normal: Tensor) -> Tensor:
    """Directions (M, 3) mirrored at a surface."""
    return directions - 2 * dot(directions, normal)[:, None] * normal


def _gather(
    world: World, time: Tensor, shading: _Shading, lift: Tensor, view: Tensor, choice: Tensor, square: Tensor
) -> Tensor:
    """Light (M, 3) over a surface from one of the lights, which stands for all of them."""
    count = len(world.lights)
    chosen = (choice * count).long().clamp_max(count - 1)
    light = torch.zeros_like(view)
    for number, lamp in enumerate(world.lights):
        rows = (chosen == number).nonzero()[:, 0]
        here, origin = pick(shading, rows), shading.point[rows] + lift[rows]
        way, power = lamp.sample(origin, time[rows], square[rows])
        towards = unit(way)
        cosine = dot(towards, here.normal)
        reflectance = here.diffuse / math.pi
        if lamp.body < 0:  # no scattered ray ever hits a lamp without size, so its gloss is found here
            behind = (cosine < 0)[:, None]
            mirrored = torch.where(behind, _other_side(towards, here.normal), towards)
            gloss = ggx_reflectance(view[rows], mirrored, here.normal, here.roughness)[:, None]
            before = reflectance + here.specular * gloss
            reflectance = torch.where(behind, here.translucency * gloss, before)
            origin, cosine = torch.where(behind, here.point - lift[rows], origin), cosine.abs()
        clear = world.transmittance(SpaceRays(origin=origin, direction=way, time=time[rows]), lamp.body)
        light[rows] = count * reflectance * power * (cosine.clamp_min(0) * clear)[:, None]
    return light
