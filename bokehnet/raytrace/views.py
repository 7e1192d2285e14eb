"""Multi-view accumulation: the average of pinhole pictures from points of the pupil."""

from collections.abc import Iterator

import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.tracer import Tracer
from bokehnet.raytrace.world import World

__all__ = ["accumulate_views"]


def accumulate_views(
    world: World,
    camera: Camera,
    views: int,
    *,
    seed: int = 0,
    bounces: int = 2,
    antialiased: bool = False,
    device: torch.device | str = "cpu",
) -> Iterator[Tensor]:
    """Yield the mean (H, W, 3) of the first 1, 2, ... ``views`` pinhole pictures.

    The views fill the pupil evenly for any number; see ``method`` of
    :class:`bokehnet.raytrace.tracer.Tracer`.

    Args:
        world: The scene at mid-exposure.
        camera: Lens and sensor.
        views: Number of views.
        seed: Seed of the pupil points, and of the noise of lights and gloss.
        bounces: See :class:`bokehnet.raytrace.tracer.Tracer`.
        antialiased: Shift each view by a random fraction of a pixel; otherwise rays pass the pixel centres.
        device: Device that traces the rays.
    """
    check_at_least("views", views, 1)
    tracer = Tracer(
        world,
        camera,
        seed=seed,
        bounces=bounces,
        method="accumulation",
        antialiased=antialiased,
        device=device,
    )
    state = tracer.begin()
    for count in range(1, views + 1):
        state = tracer.advance(state, count)
        yield state.bokeh
