"""Renderer of scenes of planes: averages the light of single rays over pupil and pixel.

Each pass traces one ray per pixel, so memory is that of a few pictures for any number of samples. The planes
that a ray meets are composited front to back by their depth along that ray.
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

# Tolerance of side tests, as a fraction of a plane's distance from the lens.
_SIDE_TOLERANCE = 1e-6


def render_bokeh(
    scene: Scene, camera: Camera, samples_per_pixel: int, seed: int, progress: Progress | None = None
) -> Tensor:
    """Render the picture of ``camera`` through its whole pupil.

    Args:
        scene: Planes and background; textures give device and dtype.
        camera: Lens and sensor; focus distance and f-number are those of the lens.
        samples_per_pixel: Rays per pixel; the error decreases faster than with its square root.
        seed: Seed of the sample positions.
        progress: Called after each pass.

    Returns:
        Scene-linear picture, (H, W, 3).

    Raises:
        ParameterError: ``samples_per_pixel`` is below 1.

    Source:
        Cook, Porter and Carpenter, "Distributed ray tracing", SIGGRAPH 1984.
    """
    return _integrate(scene, camera, samples_per_pixel, seed, True, progress)


def render_all_in_focus(
    scene: Scene, camera: Camera, samples_per_pixel: int, seed: int, progress: Progress | None = None
) -> Tensor:
    """Render through the pupil centre only: all in focus, averaged over the area of each pixel.

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
        color, depth = plane.intersect(_crop(rays, plane.window))
        current = disparity[plane.window]
        disparity[plane.window] = torch.where(color[3] >= 0.5, torch.maximum(current, 1 / depth), current)
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
    # Every pixel shifts pupil and area positions independently, so neighbours have independent noise.
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
        Hammersley, "Monte Carlo methods for solving multivariable problems", 1960: for a known count, the
        index itself can serve as first coordinate.
    """
    even = (np.arange(count) + 0.5) / count
    return np.stack([even, halton(count, 2), halton(count, 3), halton(count, 5)], -1)


def _prepare(scene: Scene, camera: Camera, centre: Rays) -> list[PreparedPlane]:
    prepared = (prepare_plane(plane, camera, centre) for plane in scene.planes)
    return [plane for plane in prepared if plane is not None]


@dataclass(frozen=True, slots=True)
class _Occluder:
    """Plane that can occlude another one in ``window``; ``always`` if it is in front for all rays."""

    index: int
    window: Window
    always: bool


def _find_occluders(planes: list[PreparedPlane], camera: Camera) -> list[list[_Occluder]]:
    """Return the possible occluders of each plane, so that few pairs need a comparison per ray.

    Source:
        Newell, Newell and Sancha, "A solution to the hidden surface problem", 1972: the order of two polygons
        is known if one lies entirely on one side of the other's plane.
    """
    reach = _pupil_reach(camera)
    occluders: list[list[_Occluder]] = []
    for i, plane in enumerate(planes):
        in_front = []
        for j, other in enumerate(planes):
            window = _intersection(plane.window, other.window)
            if i == j or window is None:
                continue
            order = _order(other, plane, reach)
            if order is None:
                reverse = _order(plane, other, reach)
                order = None if reverse is None else not reverse
            if order is not False:
                in_front.append(_Occluder(j, window, bool(order)))
        occluders.append(in_front)
    return occluders


def _order(plane: PreparedPlane, other: PreparedPlane, reach: float) -> bool | None:
    """Return whether all rays meet ``plane`` before ``other``, from its sides; ``None`` if unknown."""
    if np.hypot(*plane.normal[:2]) * reach >= 1:  # the plane cuts the pupil, so rays start on both sides
        return None
    sides = other.corners @ plane.normal - 1
    if (sides < -_SIDE_TOLERANCE).all():
        return False
    return True if (sides > _SIDE_TOLERANCE).all() else None


def _pupil_reach(camera: Camera) -> float:
    """Return the maximum distance from the axis at which rays of ``camera`` leave the lens, mm."""
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
    """Add the light of one ray per pixel to ``total`` (3, H, W).

    The light of a plane is attenuated by all planes that the ray meets before it. Comparing pairs of planes
    is faster than sorting, because most pairs do not overlap in the picture or have the same order for all
    rays.
    """
    hits = [plane.intersect(_crop(rays, plane.window)) for plane in planes]
    clear = [1 - color[3] for color, _ in hits]
    unblocked = torch.ones_like(total[0])
    for i, (plane, (color, depth)) in enumerate(zip(planes, hits, strict=True)):
        transmittance = torch.ones_like(depth)
        for occluder in occluders[i]:
            j = occluder.index
            own_window = _relative(occluder.window, plane.window)
            occluder_window = _relative(occluder.window, planes[j].window)
            passing = clear[j][occluder_window]
            if not occluder.always:  # at equal depth, the first plane occludes the second
                occluder_depth = hits[j][1][occluder_window]
                nearer = occluder_depth <= depth[own_window] if j < i else occluder_depth < depth[own_window]
                passing = torch.where(nearer, passing, 1.0)
            transmittance[own_window] *= passing
        total[:, *plane.window].addcmul_(color[:3], transmittance)
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
    """Return ``window`` relative to the first row and column of ``outer``."""
    rows, columns = (
        slice(part.start - whole.start, part.stop - whole.start)
        for part, whole in zip(window, outer, strict=True)
    )
    return rows, columns
