"""What a deep pixel shows: its samples as two surfaces, or flattened to one colour, coverage and depth.

A deep pixel holds samples along its line of sight: points, or volumes from one depth to another. The two
surfaces are what lies before and behind the widest gap in disparity between them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.exr.deep_chunks import DeepSamples
from bokehnet.optics.over import transmittance
from bokehnet.optics.pixels.pixel_layers import merge_surfaces

__all__ = ["DeepLayers", "FlatPixels", "deep_layers", "flatten", "two_surfaces"]

Array = NDArray[np.float64]

# Numbers that are worked on at a time.
_BATCH = 2**21

# Overlapping samples of a pixel, beyond which cutting them takes too long.
_MOST_SAMPLES = 4096

# A number of samples (pixels, samples) and their colours (pixels, samples, channels), front to back.
_Pieces = tuple[Array, Array, Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlatPixels:
    """Deep pixels, flattened.

    Attributes:
        light: Channels one over the other, premultiplied, (H, W, C), float32; 0 where nothing is.
        coverage: (H, W), float32.
        depth: Of the first sample by which at least half of the coverage is reached, (H, W), float32: the
            surface that fills more of the pixel, not a wisp before it. Infinite where nothing is.
    """

    light: NDArray[np.float32]
    coverage: NDArray[np.float32]
    depth: NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, eq=False)
class DeepLayers:
    """Deep pixels as two surfaces: ``front.light + (1 - front.coverage) * back.light`` is what they show.

    Attributes:
        front: What lies before the widest gap in disparity, or all there is.
        back: What lies behind it, as if nothing stood before; nothing at infinity where there is no gap.
    """

    front: FlatPixels
    back: FlatPixels


def flatten(samples: DeepSamples, channels: Sequence[str]) -> FlatPixels:
    """Lay the samples of each pixel over each other, front to back.

    Args:
        samples: With Z, and with ZBack and A where there are volumes and coverage; without A all are opaque.
        channels: Which of them are wanted as light; A counts as one.

    Source: Hillman, "The theory of OpenEXR deep samples", openexr.com, 2013: splitting, merging and over.
    """
    result = _empty(samples, len(channels))
    for pixels, pieces in _batches(samples, channels):
        _put(result, pixels, pieces, np.ones(pieces[0].shape, bool))
    return result


def two_surfaces(samples: DeepSamples, channels: Sequence[str]) -> DeepLayers:
    """Part the samples of each pixel at the widest gap in disparity, and flatten both sides.

    Args:
        samples: As for :func:`flatten`; depth in any unit.
        channels: As for :func:`flatten`.
    """
    front, back = _empty(samples, len(channels)), _empty(samples, len(channels))
    for pixels, pieces in _batches(samples, channels):
        seen = np.where(pieces[1] > 0, pieces[0], np.nan)
        for k in range(1, seen.shape[1]):  # what covers nothing takes no part in gaps
            seen[:, k] = np.where(np.isnan(seen[:, k]), seen[:, k - 1], seen[:, k])
        with np.errstate(divide="ignore"):
            gaps = np.nan_to_num(-np.diff(1 / seen, axis=1, append=np.nan), nan=0.0)
        parted = gaps.argmax(axis=1)
        parted[gaps.max(axis=1, initial=0) <= 0] = seen.shape[1]
        before = np.arange(seen.shape[1]) <= parted[:, None]
        _put(front, pixels, pieces, before)
        _put(back, pixels, pieces, ~before)
    return DeepLayers(front=front, back=back)


def deep_layers(
    samples: DeepSamples, channels: Sequence[str], most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Merge the samples of each pixel to at most ``most`` layers, parted at the widest gaps in disparity.

    Args:
        samples: As for :func:`flatten`; depth in any unit.
        channels: As for :func:`flatten`.
        most: Layers of a pixel.

    Returns:
        Light of each layer by itself (H, W, most, C) for one channel or three, depth (H, W, most), infinite
        where nothing is, and coverage (H, W, most), front to back.
    """
    shape = (*samples.counts.shape, most)
    colors = np.zeros((*shape, len(channels)), np.float32)
    disparity, coverage = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for pixels, (depth, alpha, colour) in _batches(samples, channels):
        light = np.divide(colour, alpha[..., None], out=np.zeros_like(colour), where=alpha[..., None] > 0)
        three = np.broadcast_to(light, (*depth.shape, 3))[:, None]
        with np.errstate(divide="ignore"):
            inverse = (1 / depth)[:, None]
        merged = merge_surfaces(three, inverse, alpha[:, None], most)
        colors.reshape(-1, most, len(channels))[pixels] = merged[0][..., : len(channels)]
        disparity.reshape(-1, most)[pixels], coverage.reshape(-1, most)[pixels] = merged[1:]
    with np.errstate(divide="ignore"):
        return colors, np.divide(1, disparity, dtype=np.float32), coverage


def _empty(samples: DeepSamples, channels: int) -> FlatPixels:
    shape = samples.counts.shape
    return FlatPixels(
        light=np.zeros((*shape, channels), np.float32),
        coverage=np.zeros(shape, np.float32),
        depth=np.full(shape, np.inf, np.float32),
    )


def _put(result: FlatPixels, pixels: NDArray[np.intp], pieces: _Pieces, taken: NDArray[np.bool_]) -> None:
    """Flatten those pieces that are taken, into the pixels with these numbers."""
    depth, alpha, colour = pieces
    alpha = np.where(taken, alpha, 0)
    through, ahead = transmittance(alpha)
    light = result.light.reshape(result.coverage.size, colour.shape[2])
    light[pixels] = np.einsum("pk,pkc->pc", ahead * taken, colour)
    coverage = 1 - through[:, -1]
    result.coverage.reshape(-1)[pixels] = coverage
    reached = taken & (1 - through >= 0.5 * coverage[:, None])  # the first, where nothing covers
    first = depth[np.arange(len(depth)), reached.argmax(axis=1)]
    result.depth.reshape(-1)[pixels] = np.where(reached.any(axis=1), first, np.inf)


def _batches(samples: DeepSamples, channels: Sequence[str]) -> Iterator[tuple[NDArray[np.intp], _Pieces]]:
    """Yield numbers of pixels, those of equal counts together, and their samples front to back."""
    counts = samples.counts.reshape(-1)
    starts = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 0]).tolist():
        alike = np.flatnonzero(counts == count)
        step = max(1, _BATCH // (8 * count * (len(channels) + 2)))
        for first in range(0, len(alike), step):
            pixels = alike[first : first + step]
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
                yield pixels[mixed], _tidied(near[mixed], far[mixed], alpha[mixed], colour[mixed])


def _tidied(near: Array, far: Array, alpha: Array, colour: Array) -> _Pieces:
    """Cut samples wherever one begins or ends, and merge those that then fill the same depths."""
    if near.shape[1] > _MOST_SAMPLES:
        raise ImageFileError(
            f"expected at most {_MOST_SAMPLES} overlapping deep samples in a pixel, found {near.shape[1]}"
        )
    ends = np.sort(np.concatenate([near, far], axis=1), axis=1)
    depths, covers, colours = [], [], []
    for k, (place, part) in _cuts(near, far, ends):
        cover = 1 - (1 - alpha) ** part  # Beer-Lambert
        share = np.divide(cover, alpha, out=np.array(part), where=alpha > 0)
        merged = _merged(place, np.where(place, cover, 0), np.where(place, share, 0)[..., None] * colour)
        depths.append(ends[:, k])
        covers.append(merged[0])
        colours.append(merged[1])
    return np.stack(depths, 1), np.stack(covers, 1), np.stack(colours, 1)


def _cuts(near: Array, far: Array, ends: Array) -> Iterator[tuple[int, tuple[NDArray[np.bool_], Array]]]:
    """Yield numbers of ends, front to back: which samples are there, and which part of each.

    Points where a depth is met first, then what reaches from there to the next end.
    """
    new = np.diff(ends, axis=1, prepend=-np.inf) > 0
    point = near == far
    for k in range(ends.shape[1]):
        yield k, (point & (near == ends[:, k, None]) & new[:, k, None], np.ones_like(near))
        if k + 1 < ends.shape[1]:
            thickness = (ends[:, k + 1] - ends[:, k])[:, None]
            within = ~point & (near <= ends[:, k, None]) & (far >= ends[:, k + 1, None]) & (thickness > 0)
            yield k, (within, np.divide(thickness, far - near, out=np.ones_like(near), where=within))


def _merged(place: NDArray[np.bool_], alpha: Array, colour: Array) -> tuple[Array, Array]:
    """Mix samples of the same depths: coverage (pixels,) and colours (pixels, C)."""
    opaque = np.logical_and(place, alpha >= 1)
    cover = 1 - np.prod(1 - alpha, axis=1)
    with np.errstate(divide="ignore"):
        density = -np.log1p(-np.where(opaque, 0, alpha))
    weight = np.divide(density, alpha, out=np.ones_like(alpha), where=alpha > 0)
    total = density.sum(axis=1)
    scale = np.divide(cover, total, out=np.ones_like(cover), where=total > 0)
    mixed = np.einsum("pk,pkc->pc", np.where(place, weight, 0) * scale[:, None], colour)
    blocked = np.einsum("pk,pkc->pc", opaque / np.maximum(np.sum(opaque, axis=1, keepdims=True), 1), colour)
    return cover, np.where(opaque.any(axis=1, keepdims=True), blocked, mixed)
