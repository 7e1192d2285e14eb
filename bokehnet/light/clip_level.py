"""Clip level of each channel, from the pile of pixels at the top of the histogram."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["ClipLevel", "clip_levels"]

LEVELS = 256


@dataclass(frozen=True, slots=True)
class ClipLevel:
    """Clip level of a channel, in scene-linear light.

    Attributes:
        code: Level as 8-bit sRGB code.
        clipped: Light from which a pixel counts as clipped.
        top: Light of the level itself.
        shoulder: Light from which the tone curve compresses; equal to ``clipped`` for a hard clip.
        channels: Number of channels that clip at this level.
    """

    code: int
    clipped: float
    top: float
    shoulder: float
    channels: int = 1


def srgb_light(codes: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the linear light of 8-bit sRGB codes, which may be fractions (IEC 61966-2-1)."""
    v = np.asarray(codes, np.float64) / (LEVELS - 1)
    return np.where(v <= 0.04045, v / 12.92, ((np.maximum(v, 0.04045) + 0.055) / 1.055) ** 2.4)


def top_histogram(channel: npt.NDArray[np.float32], lowest: int) -> npt.NDArray[np.int64]:
    """Return the number of pixels of each 8-bit sRGB code, (256,); codes below ``lowest`` count none."""
    bright = channel[channel > srgb_light(lowest - 0.5)]
    edges = srgb_light(np.arange(lowest, LEVELS - 1) + 0.5)
    codes = lowest + np.searchsorted(edges, bright)
    return np.bincount(codes, minlength=LEVELS)


def clip_levels(
    image: npt.NDArray[np.float32], *, lowest: int, min_pixels: int, min_pile: float, margin: int
) -> tuple[ClipLevel | None, ...]:
    """Return the clip level of each channel; None for a channel that is not clipped.

    A channel is clipped at code k if the codes k - 1 to k + 1 hold ``min_pile`` times as many pixels per code
    as k - 15 to k - 6, and hardly any pixel is above: light that falls off smoothly has no pile, and a bright
    surface that is not clipped has as many pixels above its peak as below.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        lowest: Minimum clip level, 8-bit sRGB code.
        min_pixels: Minimum number of pixels of a pile.
        min_pile: Minimum ratio of a pile to the codes below.
        margin: Number of codes below the clip level that count as clipped; covers JPEG noise.
    """
    return tuple(
        _level(top_histogram(image[..., c], lowest - 32), lowest, min_pixels, min_pile, margin)
        for c in range(image.shape[-1])
    )


def _level(
    histogram: npt.NDArray[np.int64], lowest: int, min_pixels: int, min_pile: float, margin: int
) -> ClipLevel | None:
    padded = np.append(histogram, 0)
    piles = padded[:-1] + padded[1:] + np.concatenate([[0], histogram[:-1]])
    piles[:lowest] = 0
    highest = int(piles.max(initial=0))
    if highest < min_pixels:
        return None
    level = int(np.flatnonzero(piles >= 0.5 * highest)[-1])
    level -= int(histogram[level] < histogram[level - 1])  # the pile ends one code above its edge
    pile = histogram[level - 1 : level + 2].sum()
    below = histogram[level - 15 : level - 5]
    above = histogram[level + 2 :].sum()
    if pile < min_pixels or pile / 3 < min_pile * below.mean() or above > 0.15 * pile:
        return None
    raised = histogram[level - 15 : level] > 1.5 * max(
        float(np.median(histogram[level - 30 : level - 15])), 1
    )
    width = margin + int(np.argmin(raised[::-1])) if not raised.all() else margin + len(raised)
    return ClipLevel(
        code=level,
        clipped=float(srgb_light(level - margin - 0.5)),
        top=float(srgb_light(level)),
        shoulder=float(srgb_light(level - width - 0.5)),
    )
