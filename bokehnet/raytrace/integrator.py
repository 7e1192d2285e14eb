"""Pictures of a scene: averages over pupil and pixel of what single rays see.

Each pass follows one ray per pixel, so memory is that of a few pictures for any number of samples. All
planes that a ray meets are composited front to back in the order of their depth along that ray.
"""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.lenses import Rays
from bokehnet.optics.sampling import disc_from_square, halton, rotate_points
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.intersect import PreparedPlane, centre_rays, look_up_background, prepare_plane
from bokehnet.raytrace.scene import Scene

__all__ = ["Progress", "render_all_in_focus", "render_bokeh", "render_disparity"]

# Called with the number of passes done and the number of all passes.
Progress = Callable[[int, int], None]


def render_bokeh(
    scene: Scene, camera: Camera, samples_per_pixel: int, seed: int, progress: Progress | None = None
) -> Tensor:
    """Render what ``camera`` sees through its whole pupil.

    Args:
        scene: Planes and background; textures give device and dtype.
        camera: Lens and sensor; render one scene with many cameras for many focus distances and apertures.
        samples_per_pixel: Rays per pixel; the error falls faster than its square root.
        seed: Same seed, same picture.
        progress: Called after each pass.

    Returns:
        Scene-linear picture, (H, W, 3).

    Raises:
        ParameterError: ``samples_per_pixel`` is less than 1.

    Source:
        Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984.
    """
    return _integrate(scene, camera, samples_per_pixel, seed, True, progress)


def render_all_in_focus(
    scene: Scene, camera: Camera, samples_per_pixel: int, seed: int, progress: Progress | None = None
) -> Tensor:
    """Render through the middle of the pupil alone: all sharp, averaged over the area of each pixel.

    Arguments, result and errors are those of :func:`render_bokeh`.
    """
    return _integrate(scene, camera, samples_per_pixel, seed, False, progress)


@torch.no_grad()
def render_disparity(scene: Scene, camera: Camera) -> Tensor:
    """Return inverse depth, 1/mm, (H, W), of the first surface with alpha >= 0.5 at each pixel centre.

    A background at infinity has disparity 0.
    """
    rays = centre_rays(camera, scene.background.texture.device, scene.background.texture.dtype)
    disparity = torch.full_like(rays.slope[..., 0], scene.background.disparity)
    for plane in _prepare(scene, camera, rays):
        seen, depth = plane.intersect(_crop(rays, plane.window))
        here = disparity[plane.window]
        disparity[plane.window] = torch.where(seen[3] >= 0.5, torch.maximum(here, 1 / depth), here)
    return disparity


@torch.no_grad()
def _integrate(
    scene: Scene, camera: Camera, samples_per_pixel: int, seed: int, pupil: bool, progress: Progress | None
) -> Tensor:
    check_at_least("samples_per_pixel", samples_per_pixel, 1)
    device, dtype = scene.background.texture.device, scene.background.texture.dtype
    groups = _group_by_depth(_prepare(scene, camera, centre_rays(camera, device, dtype)))
    sensor_xy = camera.sensor_xy(device, dtype)
    points = torch.tensor(_sample_points(samples_per_pixel), dtype=dtype, device=device)
    generator = torch.Generator().manual_seed(seed)
    size = (camera.height, camera.width)
    # One shift per pixel for the pupil and one for its area: neighbours do not share their noise.
    shifts = torch.rand(4, *size, generator=generator, dtype=dtype).to(device).permute(1, 2, 0)
    total = torch.zeros(3, *size, device=device, dtype=dtype)
    no_pupil = torch.zeros_like(sensor_xy)
    for index in range(samples_per_pixel):
        jitter = rotate_points(points[index, 2:], shifts[..., 2:]) - 0.5
        pupil_uv = disc_from_square(rotate_points(points[index, :2], shifts[..., :2])) if pupil else no_pupil
        rays = camera.lens.sample_rays(sensor_xy + camera.pixel_pitch * jitter, pupil_uv)
        _add_pass(total, scene, groups, rays)
        if progress is not None:
            progress(index + 1, samples_per_pixel)
    return (total / samples_per_pixel).permute(1, 2, 0).contiguous()


def _sample_points(count: int) -> np.ndarray:
    """Return ``count`` points (count, 4) that fill the pupil (first two) and the pixel (last two) evenly.

    Source:
        Hammersley, "Monte Carlo methods for solving multivariable problems", 1960: the first coordinate
        of a Halton sequence may be the index itself when the count is known.
    """
    even = (np.arange(count) + 0.5) / count
    return np.stack([even, halton(count, 2), halton(count, 3), halton(count, 5)], -1)


def _prepare(scene: Scene, camera: Camera, centre: Rays) -> list[PreparedPlane]:
    prepared = (prepare_plane(plane, camera, centre) for plane in scene.planes)
    return [plane for plane in prepared if plane is not None]


def _group_by_depth(planes: list[PreparedPlane]) -> list[list[PreparedPlane]]:
    """Split planes into groups, near to far, whose ranges of depth do not overlap.

    Only planes of one group can change their order from ray to ray.
    """
    groups: list[list[PreparedPlane]] = []
    farthest = 0.0
    for plane in sorted(planes, key=lambda plane: plane.nearest):
        if groups and plane.nearest <= farthest:
            groups[-1].append(plane)
        else:
            groups.append([plane])
        farthest = max(farthest, plane.farthest)
    return groups


def _add_pass(total: Tensor, scene: Scene, groups: list[list[PreparedPlane]], rays: Rays) -> None:
    """Add to ``total`` (3, H, W) the light of one ray per pixel."""
    through = torch.ones_like(total[0])
    for group in groups:
        window = group[0].window if len(group) == 1 else _join([plane.window for plane in group])
        hits = [plane.intersect(_crop(rays, window)) for plane in group]
        seen = _composite(hits)
        total[:, *window].addcmul_(seen[:3], through[window])
        through[window] *= 1 - seen[3]
    total.addcmul_(look_up_background(scene.background, rays), through)


def _composite(hits: list[tuple[Tensor, Tensor]]) -> Tensor:
    """Composite premultiplied hits (4, h, w) by their depths (h, w), the nearest first, for each ray.

    Comparing all pairs is faster than sorting for the few planes of a group.
    """
    if len(hits) == 1:
        return hits[0][0]
    result = torch.zeros_like(hits[0][0])
    clear = [1 - seen[3] for seen, _ in hits]
    for i, (seen, depth) in enumerate(hits):
        through = torch.ones_like(depth)
        for j, (_, other) in enumerate(hits):
            if j != i:  # of two planes at one depth the first hides the second
                before = other <= depth if j < i else other < depth
                through *= torch.where(before, clear[j], 1.0)
        result.addcmul_(seen, through)
    return result


def _crop(rays: Rays, window: tuple[slice, slice]) -> Rays:
    return Rays(origin=rays.origin[window], slope=rays.slope[window])


def _join(windows: list[tuple[slice, slice]]) -> tuple[slice, slice]:
    """Return the smallest window that holds all ``windows``."""
    rows, columns = zip(*windows, strict=True)
    return (
        slice(min(part.start for part in rows), max(part.stop for part in rows)),
        slice(min(part.start for part in columns), max(part.stop for part in columns)),
    )
