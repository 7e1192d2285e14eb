"""Optical vignetting on tensors: clip each span to the second pupil.

The disc and its chords are documented in :mod:`bokehnet.classical.scatter.cats_eye`. The second pupil covers
an interval of each row and the pixels at its two ends partially. A span of constant light therefore becomes
three: its first pixel, its last pixel, and the fully covered pixels between them.

The result is divided by its sum, so that a source keeps all its light. No table of these sums is needed,
because all spans of a source are processed together.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from bokehnet.classical.scatter.cats_eye import SMALLEST_SHARE, View

__all__ = ["Clip", "clip_spans", "make_clip"]

# Half chord that covers every row, pixels.
_UNLIMITED_PX = 1e6

# Units per 1 of integer sums, whose bits do not depend on the order of the additions.
_UNITS = 2.0**52


class Clip(NamedTuple):
    """Second pupil as seen from n sources.

    Attributes:
        radius: Blur radius in pixels, (n,); 0 to disable the second pupil.
        u: Centre of the second pupil in radii, to the right, with the sign of the defocus, (n,).
        v: The same downwards, (n,).
    """

    radius: Tensor
    u: Tensor
    v: Tensor


class ClippedSpans(NamedTuple):
    """Spans after clipping, (m,), as in :class:`bokehnet.classical.scatter.scanline_spans.Spans`."""

    left: Tensor
    right: Tensor
    part: Tensor
    slope: Tensor


def make_clip(view: View, x: Tensor, y: Tensor, signed: Tensor) -> Clip:
    """Return the second pupil as seen from n sources.

    Args:
        view: Position of the grid in the full-size picture.
        x: Columns of the sources, (n,).
        y: Rows of the sources, (n,).
        signed: Signed defocus of the sources, pixels, (n,).
    """
    sign = signed.sign()
    return Clip(signed.abs(), sign * (view.u + x * view.du), sign * (view.v + y * view.dv))


def _area(t: Tensor) -> Tensor:
    """Return the area under the upper half of the unit circle from 0 to ``t``."""
    t = t.clamp(-1.0, 1.0)
    return 0.5 * (t * torch.sqrt(1.0 - t * t) + torch.asin(t))


def _rise(t: Tensor) -> Tensor:
    """Return the derivative of :func:`_area`: height of the half circle, 0 outside."""
    return torch.sqrt((1.0 - t * t).clamp(min=0.0))


def _chords(k: Tensor, radius: Tensor, v: Tensor) -> tuple[Tensor, Tensor]:
    """Return half the chord of each row plus half a pixel, less for narrow chords, and its derivative."""
    is_unclipped = radius == 0
    radius = radius.where(~is_unclipped, 1.0)
    low, high = (k - 0.5) / radius - v, (k + 0.5) / radius - v
    area = _area(high) - _area(low)
    half = radius * radius * area
    growth = 2 * radius * area + (k - 0.5) * _rise(low) - (k + 0.5) * _rise(high)
    growth = growth * torch.where(half < 0.5, 2.0, 1.0).to(growth.dtype)
    half = half + half.clamp(max=0.5)
    return half.where(~is_unclipped, _UNLIMITED_PX), growth.where(~is_unclipped, 0.0)


def _cut(
    clip: Clip, owner: Tensor, rows: Tensor, left: Tensor, right: Tensor, part: Tensor, slope: Tensor
) -> ClippedSpans:
    """Return 3 m clipped spans: m first pixels, m last pixels, and m fully covered interiors."""
    radius, u, v = (column.index_select(0, owner) for column in clip)
    half, half_growth = _chords(rows.to(part.dtype), radius, v)
    centre = radius * u
    first = torch.maximum(left, (centre - half).ceil().int())
    last = torch.minimum(right - 1, (centre + half).floor().int())
    parts, slopes = [], []
    for pixel, exists in ((first, first <= last), (last, first < last)):
        distance = pixel - centre
        cover = half - distance.abs()
        growth = (half_growth + distance.sign() * u).where((cover > 0) & (cover < 1), 0.0)
        cover = cover.clamp(0.0, 1.0)
        parts.append((part * cover).where(exists, 0.0))
        slopes.append((slope * cover + part * growth).where(exists, 0.0))
    between = first + 1 < last
    parts.append(part.where(between, 0.0))
    slopes.append(slope.where(between, 0.0))
    lefts = torch.cat([first, last, first + 1])
    rights = torch.cat([first + 1, last + 1, torch.maximum(last, first + 1)])
    return ClippedSpans(lefts, rights, torch.cat(parts), torch.cat(slopes))


def _sum(light: Tensor, owner: Tensor, sources: int) -> Tensor:
    """Return the sums of (m,) numbers by owner, (sources,)."""
    sums = torch.zeros(sources, dtype=torch.int64, device=light.device)
    return sums.index_add_(0, owner, (light * _UNITS).round_().long()).to(light.dtype).div_(_UNITS)


def clip_spans(
    clip: Clip, owner: Tensor, rows: Tensor, left: Tensor, right: Tensor, part: Tensor, slope: Tensor
) -> ClippedSpans:
    """Clip all spans of n sources.

    Args:
        clip: Second pupil as seen from the sources.
        owner: Source of each span, (m,).
        rows: Row of each span relative to its source, (m,).
        left: First column, (m,).
        right: Column after the last, (m,).
        part: Fraction of the source's light on each pixel, (m,); the fractions of a source sum to 1.
        slope: Derivative of ``part`` by the radius, (m,).

    Returns:
        3 m spans, three times in the order of owners, whose fractions sum to 1 again. Empty spans have
        fractions of 0. Sources whose light would be nearly all clipped are not clipped.
    """
    sources = len(clip.radius)
    cut = _cut(clip, owner, rows, left, right, part, slope)
    owners, length = owner.repeat(3), cut.right - cut.left
    passed = _sum(cut.part * length, owners, sources)
    is_blocked = passed <= SMALLEST_SHARE
    if is_blocked.any():
        clip = clip._replace(radius=clip.radius.where(~is_blocked, 0.0))
        cut = _cut(clip, owner, rows, left, right, part, slope)
        length, passed = cut.right - cut.left, passed.where(~is_blocked, 1.0)
    growth = _sum(cut.slope * length, owners, sources) / passed
    parts = cut.part / passed.index_select(0, owners)
    slopes = cut.slope / passed.index_select(0, owners) - parts * growth.index_select(0, owners)
    return cut._replace(part=parts, slope=slopes)
