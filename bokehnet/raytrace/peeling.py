"""Depth peeling: the first, second, ... surface of each pixel through the pupil centre."""

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


# Maximum number of rays per block.
_MAX_RAYS_CPU, _MAX_RAYS_GPU = 1 << 15, 1 << 21

# Surfaces of a pixel at most this fraction of the scene's disparity range apart are merged.
_MAX_MERGED_GAP = 2e-3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Peeled:
    """Surfaces of the pixels through the pupil centre, front to back.

    Attributes:
        colors: Radiance of each single surface, (H, W, L, 3).
        depth: Depth, mm, (H, W, L); infinite for the sky; never decreases from layer to layer.
        coverage: Covered fraction of the pixel times alpha, (H, W, L). The sky or the backdrop is a last
            surface of coverage 1; layers behind it have coverage and colours 0.
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
    """Decompose a scene into the surfaces of each pixel.

    Each sample is a ray through another position in the pixel, so that outlines have fractional coverage; the
    surfaces of all samples are merged (:func:`bokehnet.optics.pixels.pixel_layers.merge_surfaces`). A single
    sample is a ray through the pixel centre. Inner sides of closed bodies are ignored: no ray of the lens
    reaches them.

    Args:
        world: The scene at mid-exposure.
        camera: Lens and sensor.
        layers: Maximum number of surfaces per pixel and per ray.
        samples: Rays per pixel.
        seed: Seed of the ray positions.
        bounces: See :class:`bokehnet.raytrace.tracer.Tracer`.
        device: Device that traces the rays.
        progress: Called with the number of pixels done and the total number.

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
    background_depth = torch.inf if backdrop is None or backdrop.disparity == 0 else 1 / backdrop.disparity
    block = max(1, (_MAX_RAYS_CPU if device.type == "cpu" else _MAX_RAYS_GPU) // samples)
    blocks: list[_Surfaces] = []
    for first in range(0, len(sensor), block):
        pixels = torch.arange(first, min(first + block, len(sensor)), device=device)
        jitter = distribution.lens_samples(points, pixels).jitter
        position = sensor[pixels].repeat(samples, 1)
        if samples > 1:
            position += camera.pixel_pitch * jitter
        rays, _ = lens_rays(camera, position, torch.zeros_like(position), torch.zeros_like(position[:, 0]))
        blocks.append(
            _peel_rays(
                world,
                rays,
                layers,
                background_depth,
                bounces,
                partial(distribution.path_number, points, pixels),
            )
        )
        if progress is not None:
            progress(first + len(pixels), len(sensor))
    if samples == 1:
        colors, depth, coverage = (torch.cat(column) for column in zip(*blocks, strict=True))
    else:
        nearest = max(float((1 / depth).max()) for _, depth, _ in blocks)
        farthest = min(float((1 / depth).min()) for _, depth, _ in blocks)
        merged = [_merged(part, samples, layers, _MAX_MERGED_GAP * (nearest - farthest)) for part in blocks]
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
    """Merge the surfaces of ``samples`` rays per pixel, pixels in the fastest dimension, to pixel layers."""
    colors, depth, alpha = (
        part.reshape(samples, -1, *part.shape[1:]).transpose(0, 1).cpu().numpy() for part in surfaces
    )
    return merge_surfaces(colors, 1 / depth, alpha, layers, min_gap)


def _peel_rays(
    world: World,
    rays: SpaceRays,
    layers: int,
    background_depth: float,
    bounces: int,
    numbers: Callable[[Tensor, Tensor], Tensor],
) -> _Surfaces:
    """Return the surfaces along rays; a ray without a hit ends at ``background_depth``."""
    min_distance = torch.zeros_like(rays.origin[:, 0])
    last_body = torch.full_like(min_distance, -1, dtype=torch.int64)
    ended = torch.zeros_like(last_body, dtype=torch.bool)
    surfaces: list[_Surfaces] = []
    for _ in range(layers):
        hit, min_distance, last_body = _intersect_front(world, rays, min_distance, last_body)
        traced = trace_paths(world, rays, numbers, bounces, start=(min_distance, last_body), first_only=True)
        sky = hit.body < 0
        alpha = torch.where(sky, 1, traced.coverage)
        color = torch.where(alpha[:, None] > 0, traced.color / alpha.clamp_min(1e-6)[:, None], 0)
        color, alpha = torch.where(ended[:, None], 0, color), torch.where(ended, 0, alpha)
        depth = torch.where(sky, background_depth, hit.hits.distance)
        if surfaces:
            depth = torch.maximum(depth, surfaces[-1][1])  # bodies behind the backdrop occlude it
        surfaces.append((color, depth, alpha))
        ended |= sky
        min_distance, last_body = torch.where(sky, min_distance, hit.hits.distance), hit.body
    colors, depths, alphas = (torch.stack(column, 1) for column in zip(*surfaces, strict=True))
    return colors, depths, alphas


def _intersect_front(
    world: World, rays: SpaceRays, min_distance: Tensor, last_body: Tensor
) -> tuple[SurfaceHit, Tensor, Tensor]:
    """Return the next surface that is not an inner side, and ``min_distance`` and ``last_body`` before it."""
    closed = torch.tensor([*(body.shape.closed for body in world.bodies), False], device=min_distance.device)
    while True:
        hit = world.intersect(rays, min_distance, last_body)
        inner = closed[hit.body]  # -1, no body, selects the last entry
        rows = inner.nonzero()[:, 0]
        normal, _ = world.surfaces(pick(rays, rows), pick(hit, rows))
        inner[rows] = dot(normal, rays.direction[rows]) > 0
        if not bool(inner.any()):
            return hit, min_distance, last_body
        min_distance = torch.where(inner, hit.hits.distance, min_distance)
        last_body = torch.where(inner, hit.body, last_body)
