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
from bokehnet.optics.over import transmittance

__all__ = ["DeepLayers", "FlatPixels", "deep_layers", "flatten", "two_surfaces"]

Array = NDArray[np.float64]

# Numbers per batch.
_BATCH_SIZE = 2**21

# Overlapping samples of a pixel, beyond which splitting them takes too long.
_MAX_OVERLAPPING_SAMPLES = 4096

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
    for count in np.unique(counts[counts > 0]).tolist():
        same_count = np.flatnonzero(counts == count)
        step = max(1, _BATCH_SIZE // (8 * count * (len(channels) + 2)))
        for first in range(0, len(same_count), step):
            pixels = same_count[first : first + step]
            index = starts[pixels][:, None] + np.arange(count)
            near = samples.values["Z"][index].astype(np.float64)
            far = np.maximum(samples.values.get("ZBack", samples.values["Z"])[index].astype(np.float64), near)
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
    """Split samples at all sample boundaries, and merge those that then fill the same depths."""
    if near.shape[1] > _MAX_OVERLAPPING_SAMPLES:
        raise ImageFileError(
            f"expected at most {_MAX_OVERLAPPING_SAMPLES} overlapping deep samples in a pixel, "
            f"found {near.shape[1]}"
        )
    ends = np.sort(np.concatenate([near, far], axis=1), axis=1)
    depths, coverages, colours = [], [], []
    for k, (present, fraction) in _cuts(near, far, ends):
        coverage = 1 - (1 - alpha) ** fraction  # Beer-Lambert
        scale = np.divide(coverage, alpha, out=np.array(fraction), where=alpha > 0)
        merged = _merged(
            present, np.where(present, coverage, 0), np.where(present, scale, 0)[..., None] * colour
        )
        depths.append(ends[:, k])
        coverages.append(merged[0])
        colours.append(merged[1])
    return np.stack(depths, 1), np.stack(coverages, 1), np.stack(colours, 1)


def _cuts(near: Array, far: Array, ends: Array) -> Iterator[tuple[int, tuple[NDArray[np.bool_], Array]]]:
    """Yield indices of boundaries, front to back, with the samples present and the fraction of each.

    Points at a depth come first, then the volumes from there to the next boundary.
    """
    new = np.diff(ends, axis=1, prepend=-np.inf) > 0
    point = near == far
    for k in range(ends.shape[1]):
        yield k, (point & (near == ends[:, k, None]) & new[:, k, None], np.ones_like(near))
        if k + 1 < ends.shape[1]:
            thickness = (ends[:, k + 1] - ends[:, k])[:, None]
            within = ~point & (near <= ends[:, k, None]) & (far >= ends[:, k + 1, None]) & (thickness > 0)
            yield k, (within, np.divide(thickness, far - near, out=np.ones_like(near), where=within))


def _merged(present: NDArray[np.bool_], alpha: Array, colour: Array) -> tuple[Array, Array]:
    """Mix samples at the same depths: coverage (pixels,) and colours (pixels, C)."""
    opaque = np.logical_and(present, alpha >= 1)
    coverage = 1 - np.prod(1 - alpha, axis=1)
    with np.errstate(divide="ignore"):
        density = -np.log1p(-np.where(opaque, 0, alpha))
    weight = np.divide(density, alpha, out=np.ones_like(alpha), where=alpha > 0)
    total = density.sum(axis=1)
    scale = np.divide(coverage, total, out=np.ones_like(coverage), where=total > 0)
    mixed = np.einsum("pk,pkc->pc", np.where(present, weight, 0) * scale[:, None], colour)
    blocked = np.einsum("pk,pkc->pc", opaque / np.maximum(np.sum(opaque, axis=1, keepdims=True), 1), colour)
    return coverage, np.where(opaque.any(axis=1, keepdims=True), blocked, mixed)
