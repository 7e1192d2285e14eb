"""Multi-view accumulation: many pinhole pictures, each from one point of the pupil, averaged."""

from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.distribution import Distribution
from bokehnet.raytrace.paths import trace_paths
from bokehnet.raytrace.tracer import lens_rays
from bokehnet.raytrace.world import World

__all__ = ["accumulate_views"]


@torch.no_grad()
def accumulate_views(
    world: World,
    camera: Camera,
    views: int,
    *,
    seed: int = 0,
    bounces: int = 2,
    device: torch.device | str = "cpu",
) -> Iterator[Tensor]:
    """Yield the mean (H, W, 3) of the first 1, 2, ... ``views`` pinhole pictures.

    All pixels of a view share its point of the pupil, so few views show as so many ghosts instead of noise.
    The points are those of a Halton sequence: any number of views fills the pupil evenly. Rays go through
    the pixels' centres; what is in focus is not antialiased.

    Args:
        world: The scene, in the middle of the shutter's opening.
        camera: Lens and sensor.
        views: How many.
        seed: Of the noise of lights and gloss.
        bounces: See :class:`bokehnet.raytrace.tracer.Tracer`.
        device: Where rays are followed.

    Source:
        Haeberli and Akeley, "The accumulation buffer: hardware support for high-quality rendering",
        SIGGRAPH 1990.
    """
    check_at_least("views", views, 1)
    device = torch.device(device)
    sensor = camera.sensor_xy(device, torch.float32).reshape(-1, 2)
    distribution = Distribution(len(sensor), bounces, seed, device)
    everywhere = slice(0, len(sensor))
    halton_square = np.stack([halton(views, 2), halton(views, 3)], -1)
    square = torch.tensor(halton_square, dtype=torch.float32, device=device)
    still = torch.zeros_like(sensor[:, 0])
    mean = torch.zeros(len(sensor), 3, device=device)
    for view, pupil_uv in enumerate(disc_from_square(square)):
        points = distribution.points(view, 1)

        def numbers(dimension: Tensor, row: Tensor, points: Tensor = points) -> Tensor:
            return distribution.path_number(points, everywhere, dimension, row)

        rays, weight = lens_rays(camera, sensor, pupil_uv.expand_as(sensor), still)
        seen = trace_paths(world, rays, numbers, bounces).color * weight[:, None]
        mean = mean + (seen - mean) / (view + 1)
        yield mean.reshape(camera.height, camera.width, 3)
