"""Which spans the pixels of a picture light, as tensors, a few million at a time. Needs torch."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import torch
from torch import Tensor

from bokehnet.classical.scatter.cats_eye import View
from bokehnet.classical.scatter.disc_scatter import LARGEST_RADIUS
from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS
from bokehnet.classical.scatter.scanline_spans import (
    FAR_STEPS,
    RadiusTable,
    Spans,
    far_radius,
    list_far_discs,
    make_radius_table,
    radius_table_limit,
)
from bokehnet.classical.torch.cats_eye import Clip, clip_spans, make_clip
from bokehnet.optics.aperture import Aperture

__all__ = ["Batch", "Sources", "find_sources", "list_batches"]

# Spans worked at once; each needs about 200 bytes.
_AT_ONCE = 1 << 21

# Steps of the discs beyond the radius table that are listed at once.
_FAR_AT_ONCE = 256


class Sources(NamedTuple):
    """Pixels that share a table of spans.

    Attributes:
        spans: The table, as tensors.
        pixels: Index of each pixel in the flat picture, (n,), int64.
        shapes: Its shape in the table, (n,).
        along: Its radius minus that of the shape, pixels, (n,).
        clip: How the second pupil clips it, where there is one.
    """

    spans: Any
    pixels: Tensor
    shapes: Tensor
    along: Tensor
    clip: Clip | None


class Batch(NamedTuple):
    """Spans of some sources.

    Attributes:
        sources: Which ones.
        owner: Source of each span, counted from the first of them, (m,).
        left: Index of its left end in the flat rows, (m,). A row has one pixel more than the picture, and
            there is one row more above and below.
        right: The same for its right end.
        part: Part of the light on each pixel, (m,).
        slope: Its derivative by the radius, (m,).
    """

    sources: slice
    owner: Tensor
    left: Tensor
    right: Tensor
    part: Tensor
    slope: Tensor


def _to_device(spans: Spans, like: Tensor) -> Any:
    """A table of spans as tensors: places as they are, parts in the dtype of ``like``."""
    places = [torch.from_numpy(column).to(like.device) for column in spans[:4]]
    parts = [torch.from_numpy(column).to(like) for column in spans[4:]]
    return Spans._make([*places, *parts])  # type: ignore[arg-type]


@lru_cache(maxsize=8)
def _radius_table_tensors(
    aperture: Aperture | None, reach: int, dtype: torch.dtype, device: torch.device
) -> tuple[RadiusTable, Any, Tensor]:
    """A radius table, and its spans and radii as tensors."""
    ladder = make_radius_table(aperture, reach)
    spans = _to_device(ladder.spans, torch.empty(0, dtype=dtype, device=device))
    return ladder, spans, torch.from_numpy(ladder.radii).to(device)


def find_sources(defocus: Tensor, aperture: Aperture | None, view: View | None) -> Iterator[Sources]:
    """Find all pixels that are not sharp, by the table that holds their shapes.

    Args:
        defocus: Signed radii in pixels, (H, W); no shape but a disc may be beyond the radius table.
        aperture: The opening; None for a disc.
        view: Where this grid lies in the full-size picture; None where there is no cat's-eye.
    """
    height, width = defocus.shape
    signed = defocus.detach().flatten().double().clamp(-LARGEST_RADIUS, LARGEST_RADIUS)
    radius = signed.abs()
    largest = float(radius.max())
    if largest <= SMALLEST_RADIUS:
        return
    reach = radius_table_limit(aperture, largest)
    ladder, spans, radii = _radius_table_tensors(aperture, reach, defocus.dtype, defocus.device)
    pixels = ((radius > SMALLEST_RADIUS) & (radius < ladder.limit)).nonzero().flatten()
    shapes = torch.searchsorted(radii, radius[pixels], right=True) - 1
    along = radius[pixels] - radii[shapes]
    clip = None
    if view is not None:
        clip = make_clip(view, pixels % width, pixels // width, signed[pixels])
        clip = Clip(*(column.to(defocus.dtype) for column in clip))
    if ladder.two_sided:
        shapes = shapes + len(radii) * (signed[pixels] < 0)
    yield Sources(spans, pixels, shapes, along.to(defocus.dtype), clip)
    if largest < ladder.limit:
        return
    far = (radius >= ladder.limit).nonzero().flatten()
    steps = torch.floor(FAR_STEPS * torch.log2(radius[far] / ladder.limit)).long()
    along = (radius[far] - far_radius(steps)).to(defocus.dtype)
    distinct, shapes = torch.unique(steps, return_inverse=True)
    for begin in range(0, len(distinct), _FAR_AT_ONCE):
        listed = list_far_discs(distinct[begin : begin + _FAR_AT_ONCE].cpu().numpy(), height, width)
        some = ((shapes >= begin) & (shapes < begin + _FAR_AT_ONCE)).nonzero().flatten()
        yield Sources(_to_device(listed, defocus), far[some], shapes[some] - begin, along[some], None)


def _cut(counts: Tensor) -> tuple[list[int], list[int]]:
    """Cut n sources into runs of about ``_AT_ONCE`` spans: first source and first span of each; the ends."""
    behind = counts.cumsum(0)
    total = int(behind[-1])
    marks = _AT_ONCE * torch.arange(1, -(-total // _AT_ONCE), device=counts.device)
    cuts = torch.searchsorted(behind, marks, right=True)
    sources, spans = torch.stack([cuts, (behind - counts)[cuts]]).tolist()
    return [0, *sources, len(counts)], [0, *spans, total]


def list_batches(sources: Sources, height: int, width: int) -> Iterator[Batch]:
    """List the sources' spans in batches of limited size, in the pixels' order.

    Args:
        sources: From :func:`find_sources`.
        height: Of the picture.
        width: Likewise.
    """
    if len(sources.pixels) == 0:
        return
    spans = sources.spans
    start = spans.first[sources.shapes]
    counts = spans.first[sources.shapes + 1] - start
    shift = start - (counts.cumsum(0) - counts)
    x, y = (sources.pixels % width).int(), (sources.pixels // width + 1).int()
    cut_sources, cut_spans = _cut(counts)
    counts = counts.int()
    for n in range(len(cut_sources) - 1):
        (begin, end), (first, last) = cut_sources[n : n + 2], cut_spans[n : n + 2]
        if begin == end:  # one source alone filled the batch before
            continue
        owner = torch.repeat_interleave(counts[begin:end], output_size=last - first)
        entry = torch.arange(last - first, dtype=torch.int32, device=owner.device)
        entry += (shift[begin:end] + first).int().index_select(0, owner)
        rows, left, right, part, slope = (column.index_select(0, entry) for column in spans[1:])
        part = part.addcmul_(sources.along[begin:end].index_select(0, owner), slope)
        if sources.clip is not None:
            clip = Clip(*(column[begin:end] for column in sources.clip))
            left, right, part, slope = clip_spans(clip, owner, rows, left, right, part, slope)
            owner, rows = owner.repeat(3), rows.repeat(3)
        row = rows.add_(y[begin:end].index_select(0, owner)).clamp_(0, height + 1).mul_(width + 1)
        column = x[begin:end].index_select(0, owner)
        left = left.add_(column).clamp_(0, width).add_(row)
        right = right.add_(column).clamp_(0, width).add_(row)
        yield Batch(slice(begin, end), owner, left, right, part.clamp_(min=0), slope)
