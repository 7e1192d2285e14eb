"""Pictures of a scene: averages over pupil and pixel of what single rays see.

Each pass follows one ray per pixel, so memory is that of a few pictures for any number of samples. All
planes that a ray meets are composited front to back in the order of their depth along that ray.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.lenses import Rays
from bokehnet.optics.sampling import disc_from_square, halton, rotate_points
from bokehnet.progress import Progress
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.geometry.intersect import (
    PreparedPlane,
    Window,
    centre_rays,
    look_up_background,
    prepare_plane,
)
from bokehnet.raytrace.scene import Background, Scene

__all__ = ["Progress", "render_all_in_focus", "render_bokeh", "render_disparity"]

# Called with the number of passes done and the number of all passes.
# Sides of a plane are told apart beyond this share of its distance from the lens.
_SIDE_TOLERANCE = 1e-6


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
    planes = _prepare(scene, camera, centre_rays(camera, device, dtype))
    occluders = _find_occluders(planes, camera)
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
        _add_pass(total, scene.background, planes, occluders, rays)
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


@dataclass(frozen=True, slots=True)
class _Occluder:
    """A plane that may hide another one in ``window``; ``always`` when it is before it for all rays."""

    index: int
    window: Window
    always: bool


def _find_occluders(planes: list[PreparedPlane], camera: Camera) -> list[list[_Occluder]]:
    """Return for each plane those that may hide it, so that few pairs are compared ray by ray.

    Source:
        Newell, Newell and Sancha, "A solution to the hidden surface problem", 1972: the order of two
        polygons is known when one lies on one side of the plane of the other.
    """
    reach = _pupil_reach(camera)
    occluders: list[list[_Occluder]] = []
    for i, plane in enumerate(planes):
        before = []
        for j, other in enumerate(planes):
            window = _intersection(plane.window, other.window)
            if i == j or window is None:
                continue
            order = _order(other, plane, reach)
            if order is None:
                reverse = _order(plane, other, reach)
                order = None if reverse is None else not reverse
            if order is not False:
                before.append(_Occluder(j, window, bool(order)))
        occluders.append(before)
    return occluders


def _order(plane: PreparedPlane, other: PreparedPlane, reach: float) -> bool | None:
    """Tell from the sides of ``plane`` if all rays meet it before ``other``, or after; None if unknown."""
    if np.hypot(*plane.normal[:2]) * reach >= 1:  # the plane cuts the pupil, so rays start on both sides
        return None
    sides = other.corners @ plane.normal - 1
    if (sides < -_SIDE_TOLERANCE).all():
        return False
    return True if (sides > _SIDE_TOLERANCE).all() else None


def _pupil_reach(camera: Camera) -> float:
    """Distance from the axis, mm, within which rays of ``camera`` leave the lens."""
    angles = torch.linspace(0, 2 * torch.pi, 33, dtype=torch.float64)
    rim = torch.stack([angles.cos(), angles.sin()], -1)
    corners = camera.sensor_xy(rim.device, rim.dtype)[[[0], [-1]], [[0, -1]]].reshape(-1, 1, 2)
    origin = camera.lens.sample_rays(corners, rim.expand(len(corners), -1, -1)).origin
    return 1.01 * float(origin.norm(dim=-1).max())


def _add_pass(
    total: Tensor,
    background: Background,
    planes: list[PreparedPlane],
    occluders: list[list[_Occluder]],
    rays: Rays,
) -> None:
    """Add to ``total`` (3, H, W) the light of one ray per pixel.

    Light of a plane passes all planes that the ray meets before it. Comparing pairs of planes is faster
    than sorting, because most pairs do not overlap in the picture or have one order for all rays.
    """
    hits = [plane.intersect(_crop(rays, plane.window)) for plane in planes]
    clear = [1 - seen[3] for seen, _ in hits]
    unblocked = torch.ones_like(total[0])
    for i, (plane, (seen, depth)) in enumerate(zip(planes, hits, strict=True)):
        through = torch.ones_like(depth)
        for occluder in occluders[i]:
            j = occluder.index
            here = _relative(occluder.window, plane.window)
            there = _relative(occluder.window, planes[j].window)
            passing = clear[j][there]
            if not occluder.always:  # of two planes at one depth the first hides the second
                other = hits[j][1][there]
                before = other <= depth[here] if j < i else other < depth[here]
                passing = torch.where(before, passing, 1.0)
            through[here] *= passing
        total[:, *plane.window].addcmul_(seen[:3], through)
        unblocked[plane.window] *= clear[i]
    total.addcmul_(look_up_background(background, rays), unblocked)


def _crop(rays: Rays, window: Window) -> Rays:
    return Rays(origin=rays.origin[window], slope=rays.slope[window])


def _intersection(first: Window, second: Window) -> Window | None:
    starts = [max(a.start, b.start) for a, b in zip(first, second, strict=True)]
    stops = [min(a.stop, b.stop) for a, b in zip(first, second, strict=True)]
    if starts[0] >= stops[0] or starts[1] >= stops[1]:
        return None
    return slice(starts[0], stops[0]), slice(starts[1], stops[1])


def _relative(window: Window, outer: Window) -> Window:
    """Return ``window`` counted from the first row and column of ``outer``."""
    rows, columns = (
        slice(part.start - whole.start, part.stop - whole.start)
        for part, whole in zip(window, outer, strict=True)
    )
    return rows, columns
