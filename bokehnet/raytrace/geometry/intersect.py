"""Intersection of rays with textured planes.

Each plane is prepared once per picture: its equations are reduced to a few numbers, and only the window of
    pixels that it can reach is traced.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from bokehnet.lenses import Rays
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.scene import Background, Plane

__all__ = ["PreparedPlane", "Window", "centre_rays", "look_up_background", "prepare_plane"]

Window = tuple[slice, slice]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PreparedPlane:
    """Plane with precomputed equations for the ray tracer.

    Attributes:
        texture: Premultiplied RGB and alpha, (1, 4, Ht, Wt).
        window: Rows and columns of the picture that the plane can reach.
        normal: Vector of the plane's equation ``normal . p = 1``.
        u_dual: ``u_dual . p - u_offset`` is the texture coordinate of a point p of the plane along the
            columns; -1 and 1 are the outer edges of the outer texels.
        v_dual: Like ``u_dual``, along the rows.
        u_offset: See ``u_dual``.
        v_offset: See ``v_dual``.
        corners: Corners, mm, (4, 3).
    """

    texture: Tensor
    window: Window
    normal: np.ndarray
    u_dual: np.ndarray
    v_dual: np.ndarray
    u_offset: float
    v_offset: float
    corners: np.ndarray

    def intersect(self, rays: Rays) -> tuple[Tensor, Tensor]:
        """Return premultiplied RGB with alpha, (4, h, w), and depth, mm, (h, w), for rays (h, w, 2)."""
        ox, oy, sx, sy = rays.origin[..., 0], rays.origin[..., 1], rays.slope[..., 0], rays.slope[..., 1]
        (nx, ny, nz), (ux, uy, uz), (vx, vy, vz) = (
            [float(number) for number in vector] for vector in (self.normal, self.u_dual, self.v_dual)
        )
        if nx == ny == 0:
            depth = torch.full_like(sx, 1 / nz)
        else:
            along = (sx * nx).add_(sy, alpha=ny).add_(nz)
            along = torch.where(along.abs() < 1e-12, 1e-12, along)  # parallel: moves the hit far outside
            depth = (ox * -nx).sub_(oy, alpha=ny).add_(1).div_(along)
        x, y = torch.addcmul(ox, sx, depth), torch.addcmul(oy, sy, depth)
        grid = torch.empty(1, *x.shape, 2, device=x.device, dtype=x.dtype)
        torch.add(x * ux, y, alpha=uy, out=grid[0, ..., 0]).add_(depth, alpha=uz).sub_(self.u_offset)
        torch.add(x * vx, y, alpha=vy, out=grid[0, ..., 1]).add_(depth, alpha=vz).sub_(self.v_offset)
        color = grid_sample(self.texture, grid, padding_mode="zeros", align_corners=False)[0]
        return color, depth


def prepare_plane(plane: Plane, camera: Camera, centre: Rays) -> PreparedPlane | None:
    """Return ``plane`` with precomputed equations, or None if no ray of ``camera`` can meet it.

    Args:
        plane: The plane.
        camera: Camera; the blur of its lens widens the window of the plane.
        centre: Rays through the pupil centre, from :func:`centre_rays`.
    """
    corners = plane.corners
    window = _window(corners, camera, centre)
    if window is None:
        return None
    centre_point, u, v = (np.array(vector, float) for vector in (plane.centre, plane.u_axis, plane.v_axis))
    normal = np.cross(u, v)
    u_dual, v_dual = (dual / (normal @ normal) for dual in (np.cross(v, normal), np.cross(normal, u)))
    # Bilinear lookup fades over half a texel beyond the texture; the scale ends the fade at the plane's edge.
    u_dual *= 1 + 1 / plane.texture.shape[2]
    v_dual *= 1 + 1 / plane.texture.shape[1]
    distance = normal @ centre_point
    if distance == 0:  # exactly edge-on from the pupil centre: not visible
        return None
    return PreparedPlane(
        texture=plane.texture[None],
        window=window,
        normal=normal / distance,
        u_dual=u_dual,
        v_dual=v_dual,
        u_offset=float(u_dual @ centre_point),
        v_offset=float(v_dual @ centre_point),
        corners=corners,
    )


def centre_rays(camera: Camera, device: torch.device, dtype: torch.dtype) -> Rays:
    """Return the rays from the pixel centres through the pupil centre, (H, W, 2)."""
    sensor_xy = camera.sensor_xy(device, dtype)
    return camera.lens.sample_rays(sensor_xy, torch.zeros_like(sensor_xy))


def look_up_background(background: Background, rays: Rays) -> Tensor:
    """Return the colour (3, h, w) of the background along rays (h, w, 2)."""
    position = rays.slope + background.disparity * rays.origin if background.disparity else rays.slope
    extent = torch.tensor(background.half_extent, device=position.device, dtype=position.dtype)
    grid = (position / extent)[None]
    return grid_sample(background.texture[None], grid, padding_mode="reflection", align_corners=False)[0]


def _window(corners: np.ndarray, camera: Camera, centre: Rays) -> Window | None:
    """Return the rows and columns that the blurred image of a convex polygon can reach, or None."""
    slopes = corners[:, :2] / corners[:, 2:]
    blur = max(abs(float(camera.lens.coc_radius(1 / z))) for z in corners[:, 2]) / camera.pixel_pitch + 1.5
    inside = torch.ones(camera.height, camera.width, dtype=torch.bool)
    for axis, size in ((0, camera.width), (1, camera.height)):
        slope = centre.slope[..., axis].cpu()
        # A picture one pixel wide has no neighbour to measure the step; its window is the whole picture.
        step = slope.diff(dim=1 - axis).abs().max() if size > 1 else torch.inf
        margin = float(blur * step)
        inside &= (slope >= slopes[:, axis].min() - margin) & (slope <= slopes[:, axis].max() + margin)
    rows, columns = inside.any(1).nonzero()[:, 0], inside.any(0).nonzero()[:, 0]
    if not len(rows):
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
