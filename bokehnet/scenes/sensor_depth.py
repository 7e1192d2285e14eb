"""Depth as a picture on a tilted sensor counts it: along the normal of the sensor."""

import torch
from torch import Tensor

from bokehnet.lenses import TiltShift
from bokehnet.raytrace.camera import Camera

__all__ = ["depth_along_sensor"]


def depth_along_sensor(camera: Camera, depth: Tensor) -> Tensor:
    """Return depths along the axis of the lens as depths along the normal of the sensor.

    Counted so, planes of the scene are affine in inverse depth over the picture, as renderers that work on
    pictures take them to be. For a sensor that is not tilted both depths are the same.

    Args:
        camera: Lens and sensor.
        depth: Of what each pixel sees through the middle of the pupil, mm, (H, W, ...).
    """
    lens = camera.lens
    if not (isinstance(lens, TiltShift) and any(lens.tilt)):
        return depth
    place, behind = lens.place(torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], dtype=torch.float64))
    corners = torch.cat([place, -behind[:, None]], -1)
    normal = torch.linalg.cross(corners[1] - corners[0], corners[2] - corners[0])
    sensor = camera.sensor_xy(depth.device, torch.float64)
    slope = lens.sample_rays(sensor, torch.zeros_like(sensor)).slope
    share = slope @ normal[:2].to(slope) + float(normal[2])
    return depth * share.reshape(*share.shape, *[1] * (depth.ndim - 2)).to(depth)
