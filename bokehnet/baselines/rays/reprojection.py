"""Reprojection of the ray sums of the last frame.

Each pixel inherits the sums of the pixel where its surface was, if the depth agrees; the weight of the sums
is limited to a number of rays, so that outdated light fades.

Faults: a pixel inside a wide blur shows several surfaces with different motion.

Source: Tan et al., 2022, after thesis 000, 5.0; Schied et al., "Spatiotemporal variance-guided
filtering", High-Performance Graphics 2017, for the test of depth.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_same_size
from bokehnet.errors import ShapeError

__all__ = ["History"]

# Maximum relative depth difference of one surface; maximum number of rays that a sum counts for.
_MAX_DEPTH_DIFFERENCE, _MAX_HISTORY_RAYS = 0.1, 64.0


@dataclass(frozen=True, kw_only=True, eq=False)
class History:
    """Sums over the rays of each pixel of a frame.

    Attributes:
        light: Light of near and far field, (2, H * W, 3).
        count: Rays of near and far field, (2, H * W).
        first: Sum of the luminance, (H * W,).
        second: Sum of the squared luminance, (H * W,).
        depth: Depth of the frame's pixels, mm, (H, W).
    """

    light: np.ndarray
    count: np.ndarray
    first: np.ndarray
    second: np.ndarray
    depth: np.ndarray

    def moved(self, motion: np.ndarray, depth: np.ndarray) -> "History":
        """Return the history for the next frame.

        Args:
            motion: Offset from each pixel to the previous position of its surface, pixels (right, down), (H,
                W, 2).
            depth: Previous depth of the surfaces in the next frame's pixels, mm, (H, W).

        Raises:
            ShapeError: The sizes differ.
        """
        check_same_size("history", self.depth, "depth", depth)
        if motion.shape != (*depth.shape, 2):
            raise ShapeError(f"motion: expected shape {(*depth.shape, 2)}, got {motion.shape}")
        height, width = depth.shape
        y, x = np.mgrid[:height, :width]
        before_x = np.round(x + motion[..., 0]).astype(np.int64)
        before_y = np.round(y + motion[..., 1]).astype(np.int64)
        inside = (before_x >= 0) & (before_x < width) & (before_y >= 0) & (before_y < height)
        source = np.clip(before_y, 0, height - 1) * width + np.clip(before_x, 0, width - 1)
        consistent = np.abs(self.depth.ravel()[source] - depth) <= _MAX_DEPTH_DIFFERENCE * depth
        sources = source.ravel()
        rays = self.count[:, sources].sum(0)
        weight = np.where(
            (inside & consistent).ravel(), np.minimum(1.0, _MAX_HISTORY_RAYS / np.maximum(rays, 1.0)), 0.0
        )
        return History(
            light=self.light[:, sources] * weight[:, None],
            count=self.count[:, sources] * weight,
            first=self.first[sources] * weight,
            second=self.second[sources] * weight,
            depth=depth,
        )
