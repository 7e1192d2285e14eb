"""Convert deep pixels to two surfaces, or flatten them to one colour, coverage and depth.

A deep pixel holds samples along its line of sight: points, or volumes from one depth to another. The two
surfaces are the samples in front of and behind the widest gap in disparity between them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.exr.deep_chunks import DeepSamples
from bokehnet.optics.pixels.over import transmittance

__all__ = ["DeepLayers", "FlatPixels", "deep_layers", "flatten", "two_surfaces"]

Array = NDArray[np.float64]

# Numbers per batch.
_BATCH_SIZE = 2**21

# Upper bound of the samples of a pixel, which are processed at once.
_MAX_PIXEL_SAMPLES = 2**16

# Depth and coverage (pixels, samples) and colours (pixels, samples, channels), front to back.
_Pieces = tuple[Array, Array, Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatPixels:
    """Flattened deep pixels.

    Attributes:
        light: Composited channels, premultiplied, (H, W, C), float32; 0 in empty pixels.
        coverage: Coverage, (H, W), float32.
        depth: Depth of the first sample at which at least half of the coverage is reached, (H, W), float32:
            the surface that fills most of the pixel, not a wisp in front of it. Infinite in empty pixels.
    """

    light: NDArray[np.float32]
    coverage: NDArray[np.float32]
    depth: NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class DeepLayers:
    """Deep pixels as two surfaces with the composite ``front.light + (1 - front.coverage) * back.light``.

    Attributes:
        front: Samples in front of the widest gap in disparity, or all samples.
        back: Samples behind it, unoccluded; empty and at infinity if there is no gap.
    """

    front: FlatPixels
    back: FlatPixels


def flatten(samples: DeepSamples, channels: Sequence[str]) -> FlatPixels:
    """Composite the samples of each pixel, front to back.

    Args:
        samples: Samples with Z, optionally ZBack for volumes and A for coverage; without A all are opaque.
        channels: Channels to return as light; may include A.

    Raises:
        ImageFileError: A pixel has more than 65536 samples.

    Source: Hillman, "The theory of OpenEXR deep samples", openexr.com, 2013: splitting, merging and over.
    """
    result = _empty(samples, len(channels))
    for pixels, pieces in _batches(samples, channels):
        _put(result, pixels, pieces, np.ones(pieces[0].shape, bool))
    return result


def two_surfaces(samples: DeepSamples, channels: Sequence[str]) -> DeepLayers:
    """Split the samples of each pixel at the widest gap in disparity, and flatten both groups.

    Args:
        samples: See :func:`flatten`; depth in any unit.
        channels: See :func:`flatten`.
    """
    front, back = _empty(samples, len(channels)), _empty(samples, len(channels))
    for pixels, pieces in _batches(samples, channels):
        seen = np.where(pieces[1] > 0, pieces[0], np.nan)
        for k in range(1, seen.shape[1]):  # samples without coverage do not bound gaps
            seen[:, k] = np.where(np.isnan(seen[:, k]), seen[:, k - 1], seen[:, k])
        with np.errstate(divide="ignore"):
            gaps = np.nan_to_num(-np.diff(1 / seen, axis=1, append=np.nan), nan=0.0)
        split = gaps.argmax(axis=1)
        split[gaps.max(axis=1, initial=0) <= 0] = seen.shape[1]
        before = np.arange(seen.shape[1]) <= split[:, None]
        _put(front, pixels, pieces, before)
        _put(back, pixels, pieces, ~before)
    return DeepLayers(front=front, back=back)


def deep_layers(
    samples: DeepSamples, channels: Sequence[str], max_layers: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Merge the samples of each pixel into at most ``max_layers`` layers, split at the widest disparity gaps.

    Args:
        samples: See :func:`flatten`; depth in any unit.
        channels: See :func:`flatten`.
        max_layers: Maximum number of layers per pixel.

    Returns:
        Light of each layer, not premultiplied, (H, W, max_layers, C) for one channel or three, depth
        (H, W, max_layers), infinite in empty layers, and coverage (H, W, max_layers), front to back.
    """
    from bokehnet.optics.pixels.pixel_layers import merge_surfaces  # imports numba, 0.2 s

    shape = (*samples.counts.shape, max_layers)
    colors = np.zeros((*shape, len(channels)), np.float32)
    disparity, coverage = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for pixels, (depth, alpha, colour) in _batches(samples, channels):
        light = np.divide(colour, alpha[..., None], out=np.zeros_like(colour), where=alpha[..., None] > 0)
        rgb = np.broadcast_to(light, (*depth.shape, 3))[:, None]
        with np.errstate(divide="ignore"):
            inverse = (1 / depth)[:, None]
        merged = merge_surfaces(rgb, inverse, alpha[:, None], max_layers)
        colors.reshape(-1, max_layers, len(channels))[pixels] = merged[0][..., : len(channels)]
        disparity.reshape(-1, max_layers)[pixels], coverage.reshape(-1, max_layers)[pixels] = merged[1:]
    with np.errstate(divide="ignore"):
        return colors, np.divide(1, disparity, dtype=np.float32), coverage


def _empty(samples: DeepSamples, channels: int) -> FlatPixels:
    shape = samples.counts.shape
    return FlatPixels(
        light=np.zeros((*shape, channels), np.float32),
        coverage=np.zeros(shape, np.float32),
        depth=np.full(shape, np.inf, np.float32),
    )


def _put(result: FlatPixels, pixels: NDArray[np.intp], pieces: _Pieces, selected: NDArray[np.bool_]) -> None:
    """Flatten the selected pieces into the pixels with these indices."""
    depth, alpha, colour = pieces
    alpha = np.where(selected, alpha, 0)
    through, ahead = transmittance(alpha)
    light = result.light.reshape(result.coverage.size, colour.shape[2])
    light[pixels] = np.einsum("pk,pkc->pc", ahead * selected, colour)
    coverage = 1 - through[:, -1]
    result.coverage.reshape(-1)[pixels] = coverage
    reached = selected & (1 - through >= 0.5 * coverage[:, None])  # the first sample if nothing covers
    first = depth[np.arange(len(depth)), reached.argmax(axis=1)]
    result.depth.reshape(-1)[pixels] = np.where(reached.any(axis=1), first, np.inf)


def _batches(samples: DeepSamples, channels: Sequence[str]) -> Iterator[tuple[NDArray[np.intp], _Pieces]]:
    """Yield pixel indices, grouped by equal sample counts, and their samples front to back."""
    counts = samples.counts.reshape(-1)
    starts = np.cumsum(counts) - counts
    if counts.size and counts.max() > _MAX_PIXEL_SAMPLES:
        raise ImageFileError(
            f"expected at most {_MAX_PIXEL_SAMPLES} deep samples in a pixel, found {counts.max()}"
        )
    by_count = np.argsort(counts, kind="stable")
    groups = np.split(by_count, np.flatnonzero(np.diff(counts[by_count])) + 1)
    for same_count in groups:
        count = int(counts[same_count[0]]) if same_count.size else 0
        if not count:
            continue
        step = max(1, _BATCH_SIZE // (8 * count * (len(channels) + 2)))
        for first in range(0, len(same_count), step):
            pixels = same_count[first : first + step]
            index = starts[pixels][:, None] + np.arange(count)
            near = samples.values["Z"][index].astype(np.float64)
            far = np.maximum(samples.values.get("ZBack", samples.values["Z"])[index].astype(np.float64), near)
            far = np.where(np.isfinite(far), far, near)
            alpha = np.ones(near.shape)
            if "A" in samples.values:
                alpha = np.clip(samples.values["A"][index].astype(np.float64), 0, 1)
            colour = np.empty((*near.shape, len(channels)))
            for number, name in enumerate(channels):
                colour[..., number] = samples.values[name][index]
            order = np.lexsort((far, near), axis=1)
            near, far, alpha = (np.take_along_axis(x, order, 1) for x in (near, far, alpha))
            colour = np.take_along_axis(colour, order[..., None], 1)
            mixed = ((near[:, 1:] < far[:, :-1]) | (near[:, 1:] == near[:, :-1])).any(axis=1)
            if not mixed.all():
                yield pixels[~mixed], (near[~mixed], alpha[~mixed], colour[~mixed])
            if mixed.any():
                yield pixels[mixed], _split_and_merged(near[mixed], far[mixed], alpha[mixed], colour[mixed])


def _split_and_merged(near: Array, far: Array, alpha: Array, colour: Array) -> _Pieces:
    """Split samples at all sample boundaries, and merge those that then fill the same depths.

    The optical density of a volume, and its colour weighted by density, are proportional to the thickness of
    a piece (Beer-Lambert), so that running sums over the sorted boundaries give those of every piece.
    Opaque samples, of infinite density, are counted instead; they replace all others.
    """
    ends = np.concatenate([near, far], axis=1)
    order = np.argsort(ends, axis=1, kind="stable")
    ends = np.take_along_axis(ends, order, 1)
    point, opaque = near == far, alpha >= 1
    with np.errstate(divide="ignore"):
        density = -np.log1p(-np.where(opaque, 0, alpha))
    per_colour = np.divide(density, alpha, out=np.ones_like(alpha), where=alpha > 0)
    extent = np.where(point, 1, far - near)  # point samples keep their whole density
    clear, solid = np.where(opaque, 0, 1 / extent), opaque.astype(float)
    summed = np.concatenate(
        [
            np.stack([density * clear, solid, np.ones_like(alpha)], -1),
            (per_colour * clear)[..., None] * colour,
            solid[..., None] * colour,
        ],
        axis=-1,
    )
    points = _group_sums(np.where(point[..., None], summed, 0), ends, order)
    volumes = np.where(point[..., None], 0, summed)
    steps = np.take_along_axis(np.concatenate([volumes, -volumes], axis=1), order[..., None], 1)
    volumes = np.cumsum(steps.astype(np.longdouble), axis=1).astype(np.float64)[:, :-1]
    thickness = np.diff(ends, axis=1)
    volumes = volumes * (np.round(volumes[..., 2:3]) > 0) * (thickness > 0)[..., None]
    volumes[..., 0] *= thickness
    channels = colour.shape[2]
    volumes[..., 3 : 3 + channels] *= thickness[..., None]
    depth = np.stack([ends, ends], -1).reshape(len(ends), -1)[:, :-1]
    alternating = np.empty((len(ends), depth.shape[1], summed.shape[2]))
    alternating[:, 0::2], alternating[:, 1::2] = points, volumes
    total, blocked = np.maximum(alternating[..., 0], 0), np.round(alternating[..., 1])
    coverage = -np.expm1(-total)
    scale = np.divide(coverage, total, out=np.ones_like(total), where=total > 0)
    light = alternating[..., 3 : 3 + channels] * scale[..., None]
    behind = blocked > 0
    mean = alternating[..., 3 + channels :] / np.maximum(blocked, 1)[..., None]
    return depth, np.where(behind, 1, coverage), np.where(behind[..., None], mean, light)


def _group_sums(values: Array, ends: Array, order: NDArray[np.intp]) -> Array:
    """Sum the values (P, N, C) of points at equal depths, at the first of these sorted ends (P, 2N)."""
    pixels, count, channels = values.shape
    new = np.diff(ends, axis=1, prepend=-np.inf) > 0
    first = np.maximum.accumulate(np.where(new, np.arange(2 * count), 0), axis=1)
    position = np.empty_like(order)
    np.put_along_axis(position, order, first, 1)
    index = position[:, :count] + 2 * count * np.arange(pixels)[:, None]
    sums = [
        np.bincount(index.ravel(), values[..., channel].ravel(), 2 * count * pixels)
        for channel in range(channels)
    ]
    grouped: Array = np.stack(sums, -1).reshape(pixels, 2 * count, channels).astype(np.float64)
    return grouped
