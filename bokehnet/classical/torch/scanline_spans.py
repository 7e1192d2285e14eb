"""Spans that the pixels of a picture illuminate, as tensors in batches of about two million."""

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

# Approximate number of spans per batch; a span needs about 200 bytes.
_SPANS_PER_BATCH = 1 << 21

# Number of radii beyond the radius table that are listed at once.
_FAR_RADII_PER_BATCH = 256


class Sources(NamedTuple):
    """Pixels that share a table of spans.

    Attributes:
        spans: Table as tensors.
        pixels: Index of each pixel in the flat picture, (n,), int64.
        shapes: Index of its shape in the table, (n,).
        along: Radius of the pixel minus that of the shape, pixels, (n,).
        clip: Second pupil as seen from the pixels; None without a cat's-eye.
    """

    spans: Any
    pixels: Tensor
    shapes: Tensor
    along: Tensor
    clip: Clip | None


class Batch(NamedTuple):
    """Spans of some sources.

    Attributes:
        sources: Range of the sources.
        owner: Source of each span, relative to the first source, (m,).
        left: Index of the left end of each span in the flat rows, (m,). Rows have one additional pixel, and
            there is one additional row above and below.
        right: The same for the right end, (m,).
        part: Fraction of the source's light on each pixel, (m,).
        slope: Derivative of ``part`` by the radius, (m,).
    """

    sources: slice
    owner: Tensor
    left: Tensor
    right: Tensor
    part: Tensor
    slope: Tensor


def _to_device(spans: Spans, like: Tensor) -> Any:
    """Return a table of spans as tensors: integer positions, and fractions in the dtype of ``like``."""
    places = [torch.from_numpy(column).to(like.device) for column in spans[:4]]
    parts = [torch.from_numpy(column).to(like) for column in spans[4:]]
    return Spans._make([*places, *parts])  # type: ignore[arg-type]


@lru_cache(maxsize=8)
def _radius_table_tensors(
    aperture: Aperture | None, reach: int, dtype: torch.dtype, device: torch.device
) -> tuple[RadiusTable, Any, Tensor]:
    """Return a radius table, and its spans and radii as tensors."""
    table = make_radius_table(aperture, reach)
    spans = _to_device(table.spans, torch.empty(0, dtype=dtype, device=device))
    return table, spans, torch.from_numpy(table.radii).to(device)


def find_sources(defocus: Tensor, aperture: Aperture | None, view: View | None) -> Iterator[Sources]:
    """Yield all blurred pixels, grouped by the table that contains their shapes.

    Args:
        defocus: Signed blur radius in pixels, (H, W); only discs may exceed the radius table.
        aperture: Shape of the aperture; None for a disc.
        view: Position of this grid in the full-size picture; None without a cat's-eye.
    """
    height, width = defocus.shape
    signed = defocus.detach().flatten().double().clamp(-LARGEST_RADIUS, LARGEST_RADIUS)
    radius = signed.abs()
    largest = float(radius.max())
    if largest <= SMALLEST_RADIUS:
        return
    reach = radius_table_limit(aperture, largest)
    table, spans, radii = _radius_table_tensors(aperture, reach, defocus.dtype, defocus.device)
    pixels = ((radius > SMALLEST_RADIUS) & (radius < table.limit)).nonzero().flatten()
    shapes = torch.searchsorted(radii, radius[pixels], right=True) - 1
    along = radius[pixels] - radii[shapes]
    clip = None
    if view is not None:
        clip = make_clip(view, pixels % width, pixels // width, signed[pixels])
        clip = Clip(*(column.to(defocus.dtype) for column in clip))
    if table.two_sided:
        shapes = shapes + len(radii) * (signed[pixels] < 0)
    yield Sources(spans, pixels, shapes, along.to(defocus.dtype), clip)
    if largest < table.limit:
        return
    far = (radius >= table.limit).nonzero().flatten()
    steps = torch.floor(FAR_STEPS * torch.log2(radius[far] / table.limit)).long()
    along = (radius[far] - far_radius(steps)).to(defocus.dtype)
    distinct, shapes = torch.unique(steps, return_inverse=True)
    for begin in range(0, len(distinct), _FAR_RADII_PER_BATCH):
        far_spans = list_far_discs(
            distinct[begin : begin + _FAR_RADII_PER_BATCH].cpu().numpy(), height, width
        )
        selected = ((shapes >= begin) & (shapes < begin + _FAR_RADII_PER_BATCH)).nonzero().flatten()
        yield Sources(
            _to_device(far_spans, defocus), far[selected], shapes[selected] - begin, along[selected], None
        )


def _cut(counts: Tensor) -> tuple[list[int], list[int]]:
    """Return bounds of sources and of spans for batches of about ``_SPANS_PER_BATCH`` spans."""
    ends = counts.cumsum(0)
    total = int(ends[-1])
    marks = _SPANS_PER_BATCH * torch.arange(1, -(-total // _SPANS_PER_BATCH), device=counts.device)
    cuts = torch.searchsorted(ends, marks, right=True)
    sources, spans = torch.stack([cuts, (ends - counts)[cuts]]).tolist()
    return [0, *sources, len(counts)], [0, *spans, total]


def list_batches(sources: Sources, height: int, width: int) -> Iterator[Batch]:
    """Yield the spans of sources in batches of limited size, in the order of pixels.

    Args:
        sources: Sources from :func:`find_sources`.
        height: Height of the picture, pixels.
        width: Width of the picture, pixels.
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
        if begin == end:  # a single source filled the previous batch
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
