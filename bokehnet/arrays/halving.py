"""Pictures, maps and masks at half their size, computed without a larger copy."""

import numpy as np

from bokehnet.arrays.pyramid import downsample2, pad_to_multiple
from bokehnet.arrays.row_blocks import make_in_row_blocks

__all__ = ["half_image", "half_map", "half_mask", "halvings"]


def half_map(disparity: np.ndarray) -> np.ndarray:
    """Return a map (H, W) at half its size."""
    height, width = (-(-side // 2) for side in disparity.shape)

    def make(rows: slice) -> np.ndarray:
        return downsample2(pad_to_multiple(disparity[2 * rows.start : 2 * rows.stop], 2))

    return make_in_row_blocks(make, (height, width), np.float32)


def half_mask(mask: np.ndarray) -> np.ndarray:
    """Return a mask (H, W) at half its size: a pixel is set if one of its four is set."""
    return np.logical_or.reduce([pad_to_multiple(mask, 2)[y::2, x::2] for y in (0, 1) for x in (0, 1)])


def half_image(image: np.ndarray) -> np.ndarray:
    """Return a picture (3, H, W) at half its size, without a larger copy of it."""
    height, width = (-(-side // 2) for side in image.shape[1:])

    def make(rows: slice) -> np.ndarray:
        return downsample2(pad_to_multiple(image[:, 2 * rows.start : 2 * rows.stop], 2)).transpose(1, 2, 0)

    return make_in_row_blocks(make, (height, width, 3), np.float32).transpose(2, 0, 1)


def halvings(
    image: np.ndarray, disparity: np.ndarray, max_side: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return a picture (3, H, W) and its map (H, W) at every size from the full one to at most ``max_side``.

    Args:
        image: Picture, (3, H, W).
        disparity: Map, (H, W).
        max_side: Maximum side of the smallest size, pixels.

    Returns:
        Pictures and maps, the full size first; each size is half the one before, rounded up.

    Examples:
        >>> pictures, maps = halvings(np.ones((3, 6, 9)), np.ones((6, 9)), 4)
        >>> [values.shape for values in maps]
        [(6, 9), (3, 5), (2, 3)]
    """
    pictures, maps = [image], [disparity]
    while max(maps[-1].shape) > max_side:
        pictures.append(half_image(pictures[-1]))
        maps.append(half_map(maps[-1]))
    return pictures, maps
