"""Warnings about unintended blur: a picture entirely sharp or entirely blurred, often by a wrong unit."""

import math

import numpy as np
import numpy.typing as npt

from bokehnet.scene.depth.depth_source import DepthMap
from bokehnet.scene.focus import FocusedLens

__all__ = ["unexpected_blur"]

# Maximum blur radius, relative to the picture's diagonal, of a sharp picture: half the circle of confusion of
# common depth-of-field tables, 1/1500 of the diagonal.
_MAX_SHARP_RADIUS = 1 / 3000

# Minimum blur radius of an unsharp pixel, pixels.
_MIN_BLURRED_RADIUS_PX = 1.5

_ROWS_PER_BLOCK = 256

Array = npt.NDArray[np.float32]


def unexpected_blur(
    depth: DepthMap, ends: tuple[float, float], lens: FocusedLens, defocus: Array
) -> tuple[str, ...]:
    """Return a warning if everything is sharp, or if nothing is and the focus lies outside the scene.

    Args:
        depth: Depth map of the source.
        ends: Smallest and largest disparity before the repair.
        lens: Lens with its focus.
        defocus: Blur radius of each pixel, (H, W), pixels.

    Examples:
        >>> from bokehnet.io.window import Window
        >>> from bokehnet.settings.settings import CameraSettings, FocusSettings
        >>> from bokehnet.scene.focus import focus_lens
        >>> values = np.full((4, 6), 0.25, np.float32)
        >>> depth = DepthMap(values=values, kind="relative", origin="input.disparity")
        >>> lens = focus_lens(depth, Window.whole(6, 4), FocusSettings(value=0.75), CameraSettings(blur=8))
        >>> unexpected_blur(depth, (0.25, 0.25), lens, lens.defocus(values))
        ('nothing is sharp: focus is at 0.75, disparity 0.25 to 0.25, blur radius 4 to 4 pixels',)
    """
    if depth.origin == "input.constant_disparity":
        return ()
    starts = range(0, len(defocus), _ROWS_PER_BLOCK)
    blocks = [np.abs(defocus[start : start + _ROWS_PER_BLOCK]) for start in starts]
    smallest, largest = min(float(b.min()) for b in blocks), max(float(b.max()) for b in blocks)
    low, high = ends
    if depth.kind == "metric" and largest < _MAX_SHARP_RADIUS * math.hypot(*defocus.shape):
        warning = "everything is sharp"
    elif smallest > _MIN_BLURRED_RADIUS_PX and lens.plane is None and (lens.far > high or lens.near < low):
        warning = "nothing is sharp"
    else:
        return ()
    focus, remedy = f"{lens.near:g}", ""
    scene_range = f"disparity {low:g} to {high:g}"
    if lens.distance is not None:
        focus = f"{lens.distance:g} m"
        scene_range = f"depth {_metres(high)} to {_metres(low)} m"
        remedy = "; if this is unintended, check `depth.unit` (1/m for a map of 1/z) and the camera"
    radii = f"blur radius {smallest:.3g} to {largest:.3g} pixels"
    return (f"{warning}: focus is at {focus}, {scene_range}, {radii}{remedy}",)


def _metres(disparity: float) -> str:
    return f"{1 / (1000 * disparity) if disparity > 0 else math.inf:.4g}"
