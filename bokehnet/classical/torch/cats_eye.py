"""Optical vignetting on tensors: what part of each span passes the second pupil.

The same disc and chords as in :mod:`bokehnet.classical.scatter.cats_eye`, where they are explained. The
second pupil covers an interval of each row, the pixels at its two ends in part: a span of equal parts becomes
three, its first pixel, its last one and those between, which are covered whole.

What passes is divided by its sum, so that a source keeps all its light. No table of such sums is needed:
all spans of a source are at hand at once. Needs torch.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from bokehnet.classical.scatter.cats_eye import SMALLEST_SHARE, View

__all__ = ["Clip", "clip_spans", "make_clip"]

# Half a chord that covers any row whole, pixels.
_ENDLESS = 1e6

# Sums are kept as whole numbers, so that their bits do not depend on the order of the additions.
_FINE = 2.0**52


class Clip(NamedTuple):
    """The second pupil as n sources see it.

    Attributes:
        radius: Blur radius in pixels, (n,); 0 where the second pupil is left out.
        u: Its centre in radii, to the right, with the sign of the defocus, (n,).
        v: The same, down.
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
    """Return how the second pupil clips n sources.

    Args:
        view: Where the grid lies in the full-size picture.
        x: Columns of the sources, (n,).
        y: Rows.
        signed: Their defocus in pixels.
    """
    sign = signed.sign()
    return Clip(signed.abs(), sign * (view.u + x * view.du), sign * (view.v + y * view.dv))


def _area(t: Tensor) -> Tensor:
    """Area under the unit circle's upper half from 0 to ``t``."""
    t = t.clamp(-1.0, 1.0)
    return 0.5 * (t * torch.sqrt(1.0 - t * t) + torch.asin(t))


def _rise(t: Tensor) -> Tensor:
    """Derivative of :func:`_area`: height of the half circle, 0 outside."""
    return torch.sqrt((1.0 - t * t).clamp(min=0.0))


def _chords(k: Tensor, radius: Tensor, v: Tensor) -> tuple[Tensor, Tensor]:
    """Half of each row's chord and half a pixel, less where it is narrow; its derivative by the radius."""
    whole = radius == 0
    radius = radius.where(~whole, 1.0)
    low, high = (k - 0.5) / radius - v, (k + 0.5) / radius - v
    area = _area(high) - _area(low)
    half = radius * radius * area
    growth = 2 * radius * area + (k - 0.5) * _rise(low) - (k + 0.5) * _rise(high)
    growth = growth * torch.where(half < 0.5, 2.0, 1.0).to(growth.dtype)
    half = half + half.clamp(max=0.5)
    return half.where(~whole, _ENDLESS), growth.where(~whole, 0.0)


def _cut(
    clip: Clip, owner: Tensor, rows: Tensor, left: Tensor, right: Tensor, part: Tensor, slope: Tensor
) -> ClippedSpans:
    """Cut spans to what is covered: 3 m, of which the third m are covered whole."""
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
    """Sum (m,) numbers by their owners, (sources,)."""
    sums = torch.zeros(sources, dtype=torch.int64, device=light.device)
    return sums.index_add_(0, owner, (light * _FINE).round_().long()).to(light.dtype).div_(_FINE)


def clip_spans(
    clip: Clip, owner: Tensor, rows: Tensor, left: Tensor, right: Tensor, part: Tensor, slope: Tensor
) -> ClippedSpans:
    """Clip all spans of n sources.

    Args:
        clip: How the second pupil clips the sources.
        owner: Source of each span, (m,).
        rows: Row, counted from the source, likewise.
        left: First column.
        right: Column behind the last.
        part: Part of the light on each pixel; a source's parts sum to one.
        slope: Its derivative by the radius.

    Returns:
        3 m spans, three times in the owners' order, whose parts sum to one again. Those that do not exist
        have parts of 0. Where the second pupil would leave next to nothing it is left out.
    """
    sources = len(clip.radius)
    cut = _cut(clip, owner, rows, left, right, part, slope)
    owners, length = owner.repeat(3), cut.right - cut.left
    share = _sum(cut.part * length, owners, sources)
    hidden = share <= SMALLEST_SHARE
    if hidden.any():
        clip = clip._replace(radius=clip.radius.where(~hidden, 0.0))
        cut = _cut(clip, owner, rows, left, right, part, slope)
        length, share = cut.right - cut.left, share.where(~hidden, 1.0)
    growth = _sum(cut.slope * length, owners, sources) / share
    parts = cut.part / share.index_select(0, owners)
    slopes = cut.slope / share.index_select(0, owners) - parts * growth.index_select(0, owners)
    return cut._replace(part=parts, slope=slopes)
