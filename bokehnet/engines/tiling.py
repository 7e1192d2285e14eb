"""IUNet in tiles: bounded memory, and no work where the error map is zero."""

from collections.abc import Iterator

import numpy as np

from bokehnet.arrays.pyramid import upsample2
from bokehnet.inference.coarse_to_fine import Level, RefineNetwork

__all__ = ["refine_in_tiles"]

# Halo of a tile, pixels: eight 3x3 convolutions at half size, two windows of 5 for the mask, one coarse pixel
# of interpolation; rounded up to an even number.
HALO = 24

TILE = 384


def _spans(length: int) -> Iterator[tuple[int, int]]:
    """Divide ``length`` (even) into spans of at most ``TILE``, all even."""
    for first in range(0, length, TILE):
        yield first, min(length, first + TILE)


def refine_in_tiles(
    iunet: RefineNetwork, level: Level, coarse: np.ndarray, error_map: np.ndarray
) -> np.ndarray:
    """Run IUNet on the tiles within ``HALO`` of an error map above zero; elsewhere interpolate ``coarse``.

    Args:
        iunet: Refining network, whose receptive field must not exceed ``HALO``.
        level: Arrays of a batch of one, sides even.
        coarse: Bokeh at half the size, (1, 3, H/2, W/2).
        error_map: Error map, (1, 1, H, W).

    Returns:
        (1, 3, H, W); inside a refined tile the same as from the whole picture at once. A skipped tile is
        so far from every pixel in use that it cannot reach one at a finer level either.
    """
    height, width = level.image.shape[-2:]
    result = np.ascontiguousarray(upsample2(coarse))
    for top, bottom in _spans(height):
        for left, right in _spans(width):
            y0, y1 = max(0, top - HALO), min(height, bottom + HALO)
            x0, x1 = max(0, left - HALO), min(width, right + HALO)
            window = np.s_[..., y0:y1, x0:x1]
            if not error_map[window].any():
                continue
            half = np.s_[..., y0 // 2 : y1 // 2, x0 // 2 : x1 // 2]
            features = None if level.features is None else level.features[window]
            refined = iunet(
                level.image[window], level.defocus[window], level.classical[window], coarse[half], features
            )
            result[..., top:bottom, left:right] = refined[..., top - y0 : bottom - y0, left - x0 : right - x0]
    return result
