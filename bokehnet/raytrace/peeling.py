"""Depth peeling: the first, second, ... surface that each pixel sees through the middle of the pupil."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.optics.pixels.pixel_layers import merge_surfaces
from bokehnet.progress import Progress
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.distribution import Distribution
from bokehnet.raytrace.geometry.space import SpaceRays, dot
from bokehnet.raytrace.geometry.tables import pick
from bokehnet.raytrace.paths import trace_paths
from bokehnet.raytrace.tracer import lens_rays
from bokehnet.raytrace.world import SurfaceHit, World

__all__ = ["Peeled", "peel"]


# Rays that are followed at once.
_RAYS_ON_CPU, _RAYS_ON_GPU = 1 << 15, 1 << 21

# Surfaces of a pixel that are no farther apart than this part of the scene's range of disparity are one.
_LEAST_GAP = 2e-3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Peeled:
    """Surfaces of the pixels as the middle of the pupil sees them, front to back.

    Attributes:
        colors: Radiance of each surface by itself, (H, W, L, 3).
        depth: mm, (H, W, L); infinite for the sky. It never decreases from layer to layer.
        coverage: Share of the pixel that it fills, times its alpha, (H, W, L). The sky, or the backdrop, is a
            last surface of coverage 1; where nothing is behind it, coverage and colours are 0.
    """

    colors: Tensor
    depth: Tensor
    coverage: Tensor


@torch.no_grad()
def peel(
    world: World,
    camera: Camera,
    layers: int,
    *,
    samples: int = 16,
    seed: int = 0,
    bounces: int = 2,
    device: torch.device | str = "cpu",
    progress: Progress | None = None,
) -> Peeled:
    """Take a scene apart, surface by surface.

    Each sample is a ray through a place of its own in the pixel, so that outlines have coverage; surfaces of
    all samples are merged (:func:`bokehnet.optics.pixels.pixel_layers.merge_surfaces`). A single sample is a
    ray through the pixel's centre. Sides of closed bodies that are seen from within do not count: no ray of
    the lens comes there.

    Args:
        world: The scene, in the middle of the shutter's opening.
        camera: Lens and sensor.
        layers: How many surfaces of each pixel to keep, and of each ray to look for.
        samples: Rays of a pixel.
        seed: Of their noise.
        bounces: See :class:`bokehnet.raytrace.tracer.Tracer`.
        device: Where rays are followed.
        progress: Called with the number of pixels done and of all.

    Source:
        Everitt, "Interactive order-independent transparency", 2001; here with k-th intersections of rays.
    """
    check_at_least("layers", layers, 1)
    check_at_least("samples", samples, 1)
    device = torch.device(device)
    sensor = camera.sensor_xy(device, torch.float32).reshape(-1, 2)
    distribution = Distribution(len(sensor), bounces, seed, device)
    points = distribution.points(0, samples)
    backdrop = world.backdrop
    behind = torch.inf if backdrop is None or backdrop.disparity == 0 else 1 / backdrop.disparity
    block = max(1, (_RAYS_ON_CPU if device.type == "cpu" else _RAYS_ON_GPU) // samples)
    found: list[_Surfaces] = []
    for first in range(0, len(sensor), block):
        pixels = torch.arange(first, min(first + block, len(sensor)), device=device)
        jitter = distribution.lens_samples(points, pixels).jitter
        place = sensor[pixels].repeat(samples, 1)
        if samples > 1:
            place += camera.pixel_pitch * jitter
        rays, _ = lens_rays(camera, place, torch.zeros_like(place), torch.zeros_like(place[:, 0]))
        found.append(
            _peel_rays(
                world, rays, layers, behind, bounces, partial(distribution.path_number, points, pixels)
            )
        )
        if progress is not None:
            progress(first + len(pixels), len(sensor))
    if samples == 1:
        colors, depth, coverage = (torch.cat(column) for column in zip(*found, strict=True))
    else:
        nearest = max(float((1 / depth).max()) for _, depth, _ in found)
        farthest = min(float((1 / depth).min()) for _, depth, _ in found)
        merged = [_merged(part, samples, layers, _LEAST_GAP * (nearest - farthest)) for part in found]
        colors, disparity, coverage = (
            torch.from_numpy(np.concatenate(column)).to(device) for column in zip(*merged, strict=True)
        )
        depth = 1 / disparity
    size = (camera.height, camera.width, layers)
    return Peeled(colors=colors.reshape(*size, 3), depth=depth.reshape(size), coverage=coverage.reshape(size))


# Colours (M, L, 3), depth (M, L) and alpha (M, L) of the surfaces along M rays.
_Surfaces = tuple[Tensor, Tensor, Tensor]


def _merged(
    surfaces: _Surfaces, samples: int, layers: int, min_gap: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surfaces of ``samples`` rays a pixel, pixels running fastest, as layers of the pixels."""
    colors, depth, alpha = (
        part.reshape(samples, -1, *part.shape[1:]).transpose(0, 1).cpu().numpy() for part in surfaces
    )
    return merge_surfaces(colors, 1 / depth, alpha, layers, min_gap)


def _peel_rays(
    world: World,
    rays: SpaceRays,
    layers: int,
    behind: float,
    bounces: int,
    numbers: Callable[[Tensor, Tensor], Tensor],
) -> _Surfaces:
    """Surfaces along rays; what meets nothing ends at the depth ``behind``."""
    beyond = torch.zeros_like(rays.origin[:, 0])
    last = torch.full_like(beyond, -1, dtype=torch.int64)
    ended = torch.zeros_like(last, dtype=torch.bool)
    found: list[_Surfaces] = []
    for _ in range(layers):
        hit, beyond, last = _intersect_front(world, rays, beyond, last)
        seen = trace_paths(world, rays, numbers, bounces, start=(beyond, last), first_only=True)
        sky = hit.body < 0
        alpha = torch.where(sky, 1, seen.coverage)
        color = torch.where(alpha[:, None] > 0, seen.color / alpha.clamp_min(1e-6)[:, None], 0)
        color, alpha = torch.where(ended[:, None], 0, color), torch.where(ended, 0, alpha)
        depth = torch.where(sky, behind, hit.hits.distance)
        if found:
            depth = torch.maximum(depth, found[-1][1])  # bodies beyond the backdrop cover it
        found.append((color, depth, alpha))
        ended |= sky
        beyond, last = torch.where(sky, beyond, hit.hits.distance), hit.body
    colors, depths, alphas = (torch.stack(column, 1) for column in zip(*found, strict=True))
    return colors, depths, alphas


def _intersect_front(
    world: World, rays: SpaceRays, beyond: Tensor, last: Tensor
) -> tuple[SurfaceHit, Tensor, Tensor]:
    """Return the next surface that is not a closed body's inner side, and from where it is the next."""
    closed = torch.tensor([*(body.shape.closed for body in world.bodies), False], device=beyond.device)
    while True:
        hit = world.intersect(rays, beyond, last)
        inner = closed[hit.body]  # -1, which is nothing, is the last entry
        rows = inner.nonzero()[:, 0]
        normal, _ = world.surfaces(pick(rays, rows), pick(hit, rows))
        inner[rows] = dot(normal, rays.direction[rows]) > 0
        if not bool(inner.any()):
            return hit, beyond, last
        beyond = torch.where(inner, hit.hits.distance, beyond)
        last = torch.where(inner, hit.body, last)
