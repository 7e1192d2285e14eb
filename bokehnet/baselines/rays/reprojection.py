"""What rays of the last frame brought, where its surfaces are now.

Each pixel takes over the sums of the pixel that its surface was at, if that showed the same depth; sums count
for no more than so many rays, so that what changes is forgotten.

Faults: a pixel inside a wide blur shows more surfaces than its own, and they move in other ways.

Source: Tan et al., 2022, as thesis 000 gives it, 5.0; Schied et al., "Spatiotemporal variance-guided
filtering", High-Performance Graphics 2017, for the test of depth.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_same_size
from bokehnet.errors import ShapeError

__all__ = ["History"]

# Depths that differ by less than this share are one surface; rays that a sum counts for at most.
_SAME_DEPTH, _MOST_RAYS = 0.1, 64.0


@dataclass(frozen=True, kw_only=True, eq=False)
class History:
    """Sums over the rays of each pixel of a frame.

    Attributes:
        light: Of the near and the far field, (2, H * W, 3).
        count: Rays of both, (2, H * W).
        first: Of the luminance, (H * W,).
        second: Of its square, (H * W,).
        depth: Of the frame's pixels, mm, (H, W).
    """

    light: np.ndarray
    count: np.ndarray
    first: np.ndarray
    second: np.ndarray
    depth: np.ndarray

    def moved(self, motion: np.ndarray, depth: np.ndarray) -> "History":
        """The same for the next frame.

        Args:
            motion: Where each pixel's surface was, from where it is, pixels (right, down), (H, W, 2).
            depth: Of the next frame's pixels, as those surfaces had it before, mm, (H, W).

        Raises:
            ShapeError: Sizes that differ.
        """
        check_same_size("history", self.depth, "depth", depth)
        if motion.shape != (*depth.shape, 2):
            raise ShapeError(f"motion: expected shape {(*depth.shape, 2)}, got {motion.shape}")
        height, width = depth.shape
        y, x = np.mgrid[:height, :width]
        before_x = np.round(x + motion[..., 0]).astype(np.int64)
        before_y = np.round(y + motion[..., 1]).astype(np.int64)
        inside = (before_x >= 0) & (before_x < width) & (before_y >= 0) & (before_y < height)
        place = np.clip(before_y, 0, height - 1) * width + np.clip(before_x, 0, width - 1)
        same = np.abs(self.depth.ravel()[place] - depth) <= _SAME_DEPTH * depth
        kept = place.ravel()
        rays = self.count[:, kept].sum(0)
        share = np.where((inside & same).ravel(), np.minimum(1.0, _MOST_RAYS / np.maximum(rays, 1.0)), 0.0)
        return History(
            light=self.light[:, kept] * share[:, None],
            count=self.count[:, kept] * share,
            first=self.first[kept] * share,
            second=self.second[kept] * share,
            depth=depth,
        )
