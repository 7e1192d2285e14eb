"""Compositing of rays into the scene with a post-process, as in breda, and by separate fields.

``composite_breda`` follows the listings of thesis 000, 5.1.2. ``composite_fields`` is what 5.1.4 proposes:
near and far field of the post-process are blurred apart and composited with those of the rays.

Faults of the first: its depth difference times the focus distance has a unit, so that the result depends on
    the scale of the scene; pixels in focus stay sharp under a near blur.

Source: Marsicano, "Rendering real time depth of field effects", 2023, 5.1.2 and 5.1.4.
"""

from collections.abc import Callable

import numpy as np

from bokehnet.baselines.gather.scatter_as_you_gather import TILE
from bokehnet.baselines.gather.tiles import dilated_tiles

__all__ = ["combined_factor", "composite_breda", "composite_fields", "in_focus_diameter", "split_fields"]

# Diameter of a disc that looks sharp on a print, mm, and width of the print, mm.
_SHARP_ON_PRINT_MM, _PRINT_WIDTH_MM = 0.2, 300.0

# Hit ratio above which a far pixel is the post-process, and coverage below which a field has no colour.
_HIT_RATIO, _MIN_COVERAGE = 0.3, 0.02


def in_focus_diameter(width: int) -> float:
    """Return the maximum diameter of the disc of a pixel in focus, pixels: 0.2 mm on a print 300 mm wide.

    As printed, c = 0.2 mm multiplies the pixel pitch of the sensor, where only a number of pixels has a
    meaning.
    """
    return _SHARP_ON_PRINT_MM * width / _PRINT_WIDTH_MM


def combined_factor(
    diameter: np.ndarray,
    largest_in_tile: np.ndarray,
    behind_nearest: np.ndarray,
    focus_distance: float,
    alpha: np.ndarray,
) -> np.ndarray:
    """Return the weight of the post-process over the sharp picture, 0 to 1, as the listing computes it.

    Args:
        diameter: Diameter of the circle of confusion, pixels, any shape.
        largest_in_tile: Largest diameter in the dilated tile, pixels.
        behind_nearest: Depth less the nearest depth in the dilated tile, metres.
        focus_distance: Distance in focus, metres.
        alpha: Coverage of the foreground in the post-process, 0 to 1.
    """
    delta = np.clip(1 - focus_distance * behind_nearest, 0, 1)
    foreground = largest_in_tile + delta * (diameter - largest_in_tile)
    return np.asarray(np.clip(diameter + alpha * (foreground - diameter), 0, 1))


def _tiled(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the maximum, and the maximum absolute value, of each pixel's dilated tile, (H, W)."""
    height, width = values.shape
    nearest, largest = dilated_tiles(np.asarray(values, np.float32), TILE)
    first, second = (
        np.repeat(np.repeat(part, TILE, 0), TILE, 1)[:height, :width] for part in (nearest, largest)
    )
    return first, second


def composite_breda(
    image: np.ndarray,
    post: np.ndarray,
    traced: tuple[np.ndarray, np.ndarray, np.ndarray],
    depth: np.ndarray,
    defocus: np.ndarray,
    focus_distance: float,
    alpha: np.ndarray,
) -> np.ndarray:
    """Return the composite of sharp picture, post-process and rays, (H, W, 3).

    Args:
        image: All-in-focus picture, (H, W, 3).
        post: Picture of the post-process, (H, W, 3).
        traced: Mean light of the rays, (H, W, 3), the fraction that hits in front of focus, and their number,
            (H, W).
        depth: Depth, mm, (H, W).
        defocus: Signed blur radius, pixels, (H, W).
        focus_distance: Distance in focus, mm.
        alpha: Coverage of the foreground in the post-process, (H, W).
    """
    rays, hit_ratio, sent = traced
    near_disparity, _ = _tiled(1 / depth)
    largest = 2 * _tiled(defocus)[1]
    diameter = 2 * np.abs(defocus)
    behind = (depth - 1 / near_disparity) / 1000
    factor = combined_factor(diameter, largest, behind, focus_distance / 1000, alpha)[..., None]
    color = image + factor * (post - image)
    t = np.clip(hit_ratio / _HIT_RATIO, 0, 1)[..., None]
    far = rays + t * t * (3 - 2 * t) * (color - rays)
    near_or_far = np.where((defocus > 0)[..., None], rays, far)
    result = np.where((sent > 0)[..., None], near_or_far, color)
    return np.where((diameter <= in_focus_diameter(image.shape[1]))[..., None], image, result)


def split_fields(
    image: np.ndarray, defocus: np.ndarray, blur: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return near colours, far colours (H, W, 3) and near coverage (H, W) of a post-process by fields.

    The light of each field and its mask are blurred alike; their quotient is the field's colour. Pixels of
    the other field are in focus meanwhile, so that they cover nothing beyond themselves.

    Args:
        image: All-in-focus picture, (H, W, 3).
        defocus: Signed blur radius, pixels, (H, W).
        blur: Post-process that blurs a picture by its defocus.
    """
    colors = []
    coverage = np.zeros(defocus.shape)
    for near in (True, False):
        mask = (defocus > 0) == near
        radius = np.where(mask, defocus, 0).astype(np.float32)
        light = blur(np.where(mask[..., None], image, 0).astype(np.float32), radius)
        cover = blur(np.repeat(mask[..., None], 3, -1).astype(np.float32), radius)[..., 0]
        known = cover > _MIN_COVERAGE
        color = np.where(known[..., None], light / np.maximum(cover, _MIN_COVERAGE)[..., None], image)
        colors.append(color)
        if near:
            coverage = np.clip(cover, 0, 1)
    return colors[0], colors[1], coverage


def composite_fields(
    post_fields: tuple[np.ndarray, np.ndarray, np.ndarray],
    near_light: np.ndarray,
    far_light: np.ndarray,
    counts: np.ndarray,
) -> np.ndarray:
    """Return near over far, (H, W, 3): visible colours of the post-process, all else of the rays.

    A field of the post-process has no noise, and a coverage that it cannot know; the rays know the coverage,
    and the colours of what no pixel shows.

    Args:
        post_fields: Result of :func:`split_fields`.
        near_light: Mean light of rays that hit in front of focus, (H, W, 3).
        far_light: Mean light of the other rays, (H, W, 3).
        counts: Number of rays of both fields, (2, H, W).
    """
    near, far, coverage = post_fields
    sent = counts.sum(0)
    ratio = np.where(sent > 0, counts[0] / np.maximum(sent, 1), coverage)[..., None]
    hidden = (counts[1] > 0) & (1 - coverage < 0.5)
    near = np.where(((counts[0] > 0) & (coverage < 0.5))[..., None], near_light, near)
    far = np.where(hidden[..., None], far_light, far)
    return far + ratio * (near - far)
