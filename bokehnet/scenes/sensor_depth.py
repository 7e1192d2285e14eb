"""Depth along the normal of a tilted sensor."""

import torch
from torch import Tensor

from bokehnet.lenses import TiltShift
from bokehnet.raytrace.camera import Camera

__all__ = ["depth_along_sensor"]


def depth_along_sensor(camera: Camera, depth: Tensor) -> Tensor:
    """Return depths along the axis of the lens as depths along the normal of the sensor.

    With this depth, the inverse depth of scene planes is affine over the picture, as image-space renderers
    assume. For an untilted sensor both depths are equal.

    Args:
        camera: Lens and sensor.
        depth: Depth of each pixel through the pupil centre, mm, (H, W, ...).
    """
    lens = camera.lens
    if not (isinstance(lens, TiltShift) and any(lens.tilt)):
        return depth
    sensor_points, offset = lens.place(
        torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], dtype=torch.float64)
    )
    corners = torch.cat([sensor_points, -offset[:, None]], -1)
    normal = torch.linalg.cross(corners[1] - corners[0], corners[2] - corners[0])
    sensor = camera.sensor_xy(depth.device, torch.float64)
    slope = lens.sample_rays(sensor, torch.zeros_like(sensor)).slope
    ratio = slope @ normal[:2].to(slope) + float(normal[2])
    return depth * ratio.reshape(*ratio.shape, *[1] * (depth.ndim - 2)).to(depth)
