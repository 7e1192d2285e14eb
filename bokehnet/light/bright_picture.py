"""Quantities of a picture that decide which of its clipped pixels are light."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.light.clip_level import ClipLevel
from bokehnet.light.config import LightConfig

__all__ = [
    "Array",
    "BrightPicture",
    "CellSums",
    "Floats",
    "Indices",
    "Mask",
    "cell_sums",
    "point_sums",
    "ramp",
]

Array = npt.NDArray[np.float32]
Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class CellSums:
    """Sums over squares around square cells of pixels.

    Attributes:
        values: Sums, (rows of cells, columns of cells, ...).
        step: Side of a cell, pixels.
    """

    values: Array
    step: int

    def at(self, rows: Indices, columns: Indices) -> Array:
        """Return the sums at pixels, (N, ...)."""
        return np.asarray(self.values[rows // self.step, columns // self.step])


def cell_sums(
    layer: npt.NDArray[np.generic], reach: float, mask: npt.NDArray[np.bool_] | None = None
) -> CellSums:
    """Return the sums of a layer (H, W, ...) over squares of half-width ``reach`` pixels.

    All pixels of a cell, an eighth of the reach wide, have the same square. The rows of a cell are added in
    float32.

    Args:
        layer: Layer.
        reach: Half-width of the squares, pixels.
        mask: Pixels that count, (H, W); None for all.
    """
    step = max(1, round(reach / 8))
    starts = np.arange(0, layer.shape[0], step)
    rows = np.empty((len(starts), *layer.shape[1:]), np.float32)
    ones = np.ones(layer.shape[:2], np.bool_) if mask is None else mask
    for row, start in zip(rows, starts, strict=True):
        block = layer[start : start + step].astype(np.float32, copy=False)
        weights = ones[start : start + step].astype(np.float32)
        np.einsum("ij...,ij->j...", block, weights, out=row)
    sums = np.add.reduceat(rows, np.arange(0, layer.shape[1], step), 1, dtype=np.float64)
    return _around(np.asarray(sums, np.float64), reach, step)


def point_sums(values: Array, at: tuple[Indices, ...], shape: tuple[int, ...], reach: float) -> CellSums:
    """Return the sums of values of few pixels over squares; see :func:`cell_sums`.

    Args:
        values: Values of each pixel, (N, channels).
        at: Rows and columns of the pixels, (N,) each.
        shape: Height and width of the picture.
        reach: Half-width of the squares, pixels.
    """
    step = max(1, round(reach / 8))
    height, width = (-(-side // step) for side in shape)
    cells = at[0] // step * width + at[1] // step
    channels = values.astype(np.float64).T
    sums = [np.bincount(cells, channel, height * width).astype(np.float64) for channel in channels]
    return _around(np.stack(sums, -1).reshape(height, width, -1), reach, step)


def _around(sums: Floats, reach: float, step: int) -> CellSums:
    """Return the sums over squares of half-width ``reach`` pixels of the sums of cells."""
    radius = max(1, round(reach / step))
    for axis in (0, 1):
        total = np.cumsum(np.insert(sums, 0, 0.0, axis=axis), axis=axis)
        size = sums.shape[axis]
        high = np.minimum(np.arange(size) + radius + 1, size)
        sums = np.take(total, high, axis) - np.take(total, np.maximum(np.arange(size) - radius, 0), axis)
    return CellSums(sums.astype(np.float32), step)


def ramp(value: npt.ArrayLike, ends: tuple[float, float]) -> Floats:
    """Return a smooth step from 0 at the first end to 1 at the second; the ends may fall.

    Examples:
        >>> ramp([0, 1, 2], (0, 2)).tolist(), float(ramp(0.1, (0.3, 0.1)))
        ([0.0, 0.5, 1.0], 1.0)
    """
    t = np.clip((np.asarray(value, np.float64) - ends[0]) / (ends[1] - ends[0]), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


@dataclass(frozen=True, slots=True, eq=False)
class BrightPicture:
    """Picture with its clip level and the brightness of its dark parts.

    Attributes:
        image: Scene-linear picture, (H, W, 3).
        levels: Clip level of all channels.
        lowest: Smallest channel, (H, W).
        highest: Largest channel, (H, W).
        nearness: Map in which near is large, (H, W); None if unknown.
        median: Median of ``lowest``, relative to the clip level.
        config: Constants.
    """

    image: Array
    levels: ClipLevel
    lowest: Array
    highest: Array
    nearness: Array | None
    median: float
    config: LightConfig
    _dark: tuple[CellSums, CellSums]

    @classmethod
    def of(
        cls, image: Array, nearness: Array | None, levels: ClipLevel, config: LightConfig
    ) -> "BrightPicture":
        """Measure a picture."""
        red, green, blue = (image[..., channel] for channel in range(3))
        lowest = np.minimum(np.minimum(red, green), blue)  # an eighth of the time of image.min(-1)
        highest = np.maximum(np.maximum(red, green), blue)
        reach = config.surround_reach * float(np.hypot(*lowest.shape))
        dark = lowest < config.bright * levels.clipped
        steps = tuple(max(1, side // 500) for side in lowest.shape)
        return cls(
            image=image,
            levels=levels,
            lowest=lowest,
            highest=highest,
            nearness=nearness,
            median=float(np.median(lowest[:: steps[0], :: steps[1]])) / levels.clipped,
            config=config,
            _dark=(cell_sums(lowest, reach, dark), cell_sums(dark, reach)),
        )

    @property
    def level(self) -> float:
        """Light from which a channel is clipped."""
        return self.levels.clipped

    @property
    def diagonal(self) -> float:
        """Diagonal, pixels."""
        return float(np.hypot(*self.lowest.shape))

    def surround(self, rows: Indices, columns: Indices) -> Floats:
        """Return the mean light of the dark pixels around pixels (N,), relative to the clip level."""
        light, count = (sums.at(rows, columns).astype(np.float64) for sums in self._dark)
        return np.where(count > 0.5, light / np.maximum(count, 1) / self.level, self.config.bright)

    def relative_nearness(self, rows: Indices, columns: Indices) -> Floats:
        """Return the nearness of pixels (N,), 0 for the farthest to 1; 0 for all without a map."""
        if self.nearness is None:
            return np.zeros(len(rows))
        low, high = float(self.nearness.min()), float(self.nearness.max())
        return (self.nearness[rows, columns].astype(np.float64) - low) / max(high - low, 1e-30)

    def is_far(self, rows: Indices, columns: Indices) -> Mask:
        """Return whether pixels (N,) are in the farthest layer; False for all without a map."""
        if self.nearness is None:
            return np.zeros(len(rows), bool)
        return np.asarray(self.relative_nearness(rows, columns) <= self.config.far)
