"""Multi-view accumulation: many pinhole pictures, each from one point of the pupil, averaged."""

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

    Any number of views fills the pupil evenly; see ``method`` of :class:`bokehnet.raytrace.tracer.Tracer`.

    Args:
        world: The scene, in the middle of the shutter's opening.
        camera: Lens and sensor.
        views: How many.
        seed: Of the points of the pupil, and of the noise of lights and gloss.
        bounces: See :class:`bokehnet.raytrace.tracer.Tracer`.
        antialiased: Move each view by a part of a pixel of its own; else rays go through pixels' centres.
        device: Where rays are followed.
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
