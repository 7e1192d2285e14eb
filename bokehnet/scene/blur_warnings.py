"""Blur that nobody means: all of a picture sharp, or nothing of it. Mostly a unit is wrong."""

import math

import numpy as np
import numpy.typing as npt

from bokehnet.scene.depth.depth_source import DepthMap
from bokehnet.scene.focus import FocusedLens

__all__ = ["odd_blur"]

# Blur radius over the diagonal of the picture below which all counts as sharp: half the circle of confusion
# of the common depth-of-field tables, 1/1500 of the diagonal.
_UNSEEN = 1 / 3000

# Blur radius, pixels, above which nobody calls a pixel sharp.
_SEEN = 1.5

_ROWS = 256  # at a time

Array = npt.NDArray[np.float32]


def odd_blur(
    depth: DepthMap, ends: tuple[float, float], lens: FocusedLens, defocus: Array
) -> tuple[str, ...]:
    """Return a line where all is sharp, or nothing and the focus lies beyond the scene; most leave none.

    Args:
        depth: The map as it came.
        ends: Smallest and largest disparity, before the map was repaired.
        lens: Lens and focus.
        defocus: Blur radius of each pixel, (H, W), pixels.

    Examples:
        >>> from bokehnet.io.window import Window
        >>> from bokehnet.settings.settings import CameraSettings, FocusSettings
        >>> from bokehnet.scene.focus import focus_lens
        >>> values = np.full((4, 6), 0.25, np.float32)
        >>> depth = DepthMap(values=values, kind="relative", origin="input.disparity")
        >>> lens = focus_lens(depth, Window.whole(6, 4), FocusSettings(value=0.75), CameraSettings(blur=8))
        >>> odd_blur(depth, (0.25, 0.25), lens, lens.defocus(values))
        ('nothing is sharp: focus is at 0.75, disparity 0.25 to 0.25, blur radius 4 to 4 pixels',)
    """
    if depth.origin == "input.constant_disparity":
        return ()
    blocks = [np.abs(defocus[first : first + _ROWS]) for first in range(0, len(defocus), _ROWS)]
    least, most = min(float(b.min()) for b in blocks), max(float(b.max()) for b in blocks)
    low, high = ends
    if depth.kind == "metric" and most < _UNSEEN * math.hypot(*defocus.shape):
        what = "all is sharp"
    elif least > _SEEN and lens.plane is None and (lens.far > high or lens.near < low):
        what = "nothing is sharp"
    else:
        return ()
    focus, remedy = f"{lens.near:g}", ""
    found = f"disparity {low:g} to {high:g}"
    if lens.distance is not None:
        focus = f"{lens.distance:g} m"
        found = f"depth {_metres(high)} to {_metres(low)} m"
        remedy = "; if that is not so, `depth.unit` or the camera is wrong, or the map holds 1/z (unit 1/m)"
    return (f"{what}: focus is at {focus}, {found}, blur radius {least:.3g} to {most:.3g} pixels{remedy}",)


def _metres(disparity: float) -> str:
    return f"{1 / (1000 * disparity) if disparity > 0 else math.inf:.4g}"
