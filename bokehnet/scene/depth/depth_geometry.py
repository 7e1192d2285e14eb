"""Conversion of depth along rays and of z-buffers to metric disparity along the optical axis."""

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ParameterError
from bokehnet.io.window import Window

__all__ = ["disparity_between_planes", "planar_factor"]

Array = npt.NDArray[np.float32]


def planar_factor(
    size: tuple[int, int], window: Window, focal_length: float, sensor_width: float
) -> npt.NDArray[np.float64]:
    """Return depth along the axis over the length of the ray, for each pixel of a map, (h, w).

    A ray through the point (x, y) of the sensor, at the distance f from the pinhole, has the cosine
    f / sqrt(f^2 + x^2 + y^2) with the axis.

    Args:
        size: Height and width of the map, which covers the pixels of the window.
        window: Position of the pixels in the shown picture, whose width spans the sensor.
        focal_length: Distance of the sensor from the pinhole, mm.
        sensor_width: Width of the shown picture on the sensor, mm.

    Examples:
        >>> factor = planar_factor((1, 3), Window.whole(3, 1), focal_length=12, sensor_width=36)
        >>> [round(float(value), 3) for value in factor[0]]  # 45 degrees at both pixels beside the axis
        [0.707, 1.0, 0.707]
    """
    pitch = sensor_width / window.display_width
    rows = window.y + (np.arange(size[0]) + 0.5) * window.height / size[0] - window.display_height / 2
    columns = window.x + (np.arange(size[1]) + 0.5) * window.width / size[1] - window.display_width / 2
    squares = (pitch / window.pixel_aspect * rows[:, None]) ** 2 + (pitch * columns[None]) ** 2
    factor: npt.NDArray[np.float64] = focal_length / np.sqrt(focal_length**2 + squares)
    return factor


def disparity_between_planes(values: Array, kind: str, near: float, far: float) -> Array:
    """Return metric disparity, 1/mm, of stored values from 0 to 1 between two planes.

    A z-buffer is linear in inverse depth, 1/d = (1 - z) / near + z / far (Akenine-Möller, Haines and Hoffman,
    "Real-Time Rendering", chapter 4.7); planar depth is linear in depth, d = near + z (far - near).

    Args:
        values: Stored values, (H, W), 0 at the first plane and 1 at the second, NaN without data.
        kind: "zbuffer" or "planar".
        near: Distance of the plane of value 0, metres; reversed z-buffers store their far plane there.
        far: Distance of the plane of value 1, metres; may be infinite for a z-buffer.

    Examples:
        >>> values = np.array([[0, 0.5, 1]], np.float32)
        >>> disparity = disparity_between_planes(values, "zbuffer", near=0.1, far=np.inf)
        >>> (1000 * disparity).round(2).tolist()  # 1/m
        [[10.0, 5.0, 0.0]]
    """
    fraction = values.astype(np.float64)
    finite = fraction[np.isfinite(fraction)]
    if finite.size and (finite.min() < -1e-6 or finite.max() > 1 + 1e-6):
        raise ParameterError(
            "depth.kind",
            expected="stored values of 0 to 1 between `depth.near` and `depth.far`",
            shown=f"{finite.min():g} to {finite.max():g}",
        )
    if kind == "zbuffer":
        return (((1 - fraction) / near + fraction / far) / 1000).astype(np.float32)
    return (1 / (1000 * (near + fraction * (far - near)))).astype(np.float32)
