"""Depth peeling: the first, second, ... surface along each pinhole ray."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.distribution import Distribution
from bokehnet.raytrace.paths import trace_paths
from bokehnet.raytrace.space import SpaceRays, dot
from bokehnet.raytrace.tables import pick
from bokehnet.raytrace.tracer import lens_rays
from bokehnet.raytrace.world import SurfaceHit, World

__all__ = ["Peeled", "peel"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Peeled:
    """Surfaces along the rays through the pixels' centres and the middle of the pupil, front to back.

    Attributes:
        colors: Radiance of each surface by itself, (H, W, L, 3).
        depth: mm, (H, W, L); infinite for the sky. It never decreases from layer to layer.
        coverage: Alpha, (H, W, L). The sky, or the backdrop, is a last surface of alpha 1; where nothing
            is behind it, coverage and colours are 0.
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
    progress: Callable[[int, int], None] | None = None,
) -> Peeled:
    """Take a scene apart, surface by surface.

    Sides of closed bodies that are seen from within do not count: no ray of the lens comes there.

    Args:
        world: The scene, in the middle of the shutter's opening.
        camera: Lens and sensor.
        layers: How many surfaces of each ray to keep.
        samples: Paths per surface, for lights and gloss.
        seed: Of their noise.
        bounces: See :class:`bokehnet.raytrace.tracer.Tracer`.
        device: Where rays are followed.
        progress: Called with the number of layers done and of all.

    Source:
        Everitt, "Interactive order-independent transparency", 2001; here with k-th intersections of rays.
    """
    check_at_least("layers", layers, 1)
    check_at_least("samples", samples, 1)
    device = torch.device(device)
    sensor = camera.sensor_xy(device, torch.float32).reshape(-1, 2)
    rays, _ = lens_rays(camera, sensor, torch.zeros_like(sensor), torch.zeros_like(sensor[:, 0]))
    distribution = Distribution(len(sensor), bounces, seed, device)
    points = distribution.points(0, samples)
    backdrop = world.backdrop
    behind = torch.inf if backdrop is None or backdrop.disparity == 0 else 1 / backdrop.disparity
    beyond, last = torch.zeros_like(sensor[:, 0]), torch.full((len(sensor),), -1, device=device)
    ended = torch.zeros_like(last, dtype=torch.bool)
    found: list[tuple[Tensor, Tensor, Tensor]] = []
    for layer in range(layers):
        hit, beyond, last = _intersect_front(world, rays, beyond, last)
        color = torch.zeros(len(sensor), 3, device=device)
        alpha = torch.zeros_like(beyond)
        for sample in range(samples):

            def numbers(
                dimension: Tensor, row: Tensor, point: Tensor = points[sample : sample + 1]
            ) -> Tensor:
                return distribution.path_number(point, slice(0, len(sensor)), dimension, row)

            seen = trace_paths(world, rays, numbers, bounces, start=(beyond, last), first_only=True)
            color += seen.color / samples
            alpha = seen.coverage
        sky = hit.body < 0
        alpha = torch.where(sky, 1, alpha)
        color = torch.where(alpha[:, None] > 0, color / alpha.clamp_min(1e-6)[:, None], 0)
        color, alpha = torch.where(ended[:, None], 0, color), torch.where(ended, 0, alpha)
        depth = torch.where(sky, behind, hit.hits.distance)
        if found:
            depth = torch.maximum(depth, found[-1][1])  # bodies beyond the backdrop cover it
        found.append((color, depth, alpha))
        ended |= sky
        beyond, last = torch.where(sky, beyond, hit.hits.distance), hit.body
        if progress is not None:
            progress(layer + 1, layers)
    size = (camera.height, camera.width)
    colors, depth, coverage = (torch.stack(column, 1) for column in zip(*found, strict=True))
    return Peeled(
        colors=colors.reshape(*size, layers, 3),
        depth=depth.reshape(*size, layers),
        coverage=coverage.reshape(*size, layers),
    )


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
