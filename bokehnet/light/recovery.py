"""Recovery of the light that a display-referred picture has clipped."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.light.clip_level import ClipLevel, clip_levels
from bokehnet.light.components import Components, connected_components
from bokehnet.light.config import DEFAULT_CONFIG, LightConfig

__all__ = ["RecoveredLight", "recover_light"]

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RecoveredLight:
    """Picture with recovered light.

    Attributes:
        image: Scene-linear picture, (H, W, 3); the input itself if nothing was recovered.
        fraction: Fraction of the pixels that were brightened.
        largest: Largest estimated radiance, relative to the clip level; 1 if nothing was recovered.
    """

    image: Array
    fraction: float = 0.0
    largest: float = 1.0


def recover_light(
    image: Array, defocus: Array | None = None, config: LightConfig = DEFAULT_CONFIG, strength: float = 1.0
) -> RecoveredLight:
    """Estimate the radiance of clipped light and leave bright matter unchanged.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        defocus: Signed blur radius, (H, W), positive in front of focus; tells the farthest layer.
        config: Constants.
        strength: Factor on the recovered excess over the clip level; 0 recovers nothing.
    """
    levels = _common_levels(image, config)
    if levels is None or strength <= 0:
        return RecoveredLight(image=image)
    scene = _Bright.of(image, defocus, levels, config)
    excess = np.zeros_like(image)
    is_lamp = _add_lamps(scene, excess, config)
    _add_areas(scene, excess, is_lamp, config)
    changed = excess.max(-1) > 0
    if not changed.any():
        return RecoveredLight(image=image)
    result = image + np.float32(strength) * excess
    return RecoveredLight(
        image=result,
        fraction=float(changed.mean()),
        largest=float((result[changed] / scene.level).max()),
    )


def _common_levels(image: Array, config: LightConfig) -> tuple[float, float] | None:
    """Return the light from which channels are clipped and the start of the shoulder; None without clipping."""
    pixels = image.shape[0] * image.shape[1]
    levels = clip_levels(
        image,
        lowest=config.lowest_level,
        min_pixels=max(8, int(config.min_fraction * pixels)),
        min_pile=config.min_pile,
        margin=config.margin,
    )
    known = [level for level in levels if level is not None]
    if len(known) < 2:
        return None
    codes = [level.code for level in known]
    if max(codes) - min(codes) > config.level_spread:
        return None
    return min(level.clipped for level in known), float(np.median([level.shoulder for level in known]))


@dataclass(frozen=True, slots=True, eq=False)
class _Bright:
    """Picture with the quantities that decide what is light.

    Attributes:
        image: Scene-linear picture, (H, W, 3).
        level: Clip level.
        shoulder: Light from which the tone curve compresses.
        lowest: Smallest channel, (H, W).
        highest: Largest channel, (H, W).
        surround: Mean of ``highest`` over the dark pixels around each pixel, relative to the level, (H, W).
        far: True in the farthest layer, (H, W).
        median: Median of ``highest``, relative to the level.
        diagonal: Diagonal, pixels.
    """

    image: Array
    level: float
    shoulder: float
    lowest: Array
    highest: Array
    surround: Array
    far: Mask
    median: float
    diagonal: float

    @classmethod
    def of(
        cls, image: Array, defocus: Array | None, levels: tuple[float, float], config: LightConfig
    ) -> "_Bright":
        level, shoulder = levels
        lowest, highest = image.min(-1), image.max(-1)
        diagonal = float(np.hypot(*lowest.shape))
        return cls(
            image=image,
            level=level,
            shoulder=shoulder,
            lowest=lowest,
            highest=highest,
            surround=_dark_mean(lowest, config.bright * level, config.surround_reach * diagonal) / level,
            far=_farthest(defocus, lowest.shape, config.far),
            median=float(np.median(lowest[:: max(1, lowest.shape[0] // 500), :: max(1, lowest.shape[1] // 500)]))
            / level,
            diagonal=diagonal,
        )


def _dark_mean(values: Array, limit: float, reach: float) -> Array:
    """Return the mean of the values below ``limit`` in a square of half-width ``reach`` pixels, (H, W)."""
    step = max(1, round(reach / 8))
    height, width = values.shape
    dark = values < limit
    shape = (-(-height // step), -(-width // step))
    sums = np.zeros((2, *shape))
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    for index, array in enumerate((np.where(dark, values, 0), dark)):
        sums[index] = np.add.reduceat(np.add.reduceat(array, rows, 0, dtype=np.float64), columns, 1)
    radius = max(1, round(reach / step))
    for axis in (1, 2):
        total = np.cumsum(np.insert(sums, 0, 0.0, axis=axis), axis=axis)
        size = sums.shape[axis]
        high = np.minimum(np.arange(size) + radius + 1, size)
        low = np.maximum(np.arange(size) - radius, 0)
        sums = np.take(total, high, axis) - np.take(total, low, axis)
    mean = np.where(sums[1] > 0.5, sums[0] / np.maximum(sums[1], 1), limit).astype(np.float32)
    return np.repeat(np.repeat(mean, step, 0), step, 1)[:height, :width]


def _farthest(defocus: Array | None, shape: tuple[int, ...], fraction: float) -> Mask:
    if defocus is None:
        return np.zeros(shape, bool)
    low, high = float(defocus.min()), float(defocus.max())
    return defocus <= low + fraction * (high - low)


def _ramp(value: npt.ArrayLike, ends: tuple[float, float]) -> npt.NDArray[np.float64]:
    """Return a smooth step from 0 at the first end to 1 at the second; ends may fall."""
    t = np.clip((np.asarray(value, np.float64) - ends[0]) / (ends[1] - ends[0]), 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _add_lamps(scene: _Bright, excess: Array, config: LightConfig) -> Mask:
    """Add the excess of small lights in dark surroundings; return the mask of their pixels."""
    used = np.zeros(scene.lowest.shape, bool)
    night = float(_ramp(scene.median, config.night[::-1]))
    if night == 0:
        return used
    half = config.bright * scene.level
    regions = connected_components(scene.highest >= half)
    at = regions.rows, regions.columns
    area = regions.sums()
    clipped = regions.sums(scene.highest[at] >= scene.level)
    surround = regions.sums(scene.surround[at]) / area
    radius = np.sqrt(area / np.pi)
    weight = (
        night
        * (radius <= config.lamp_radius * scene.diagonal)
        * _ramp(clipped / area, config.lamp_fill)
        * _ramp(surround, config.lamp_surround[::-1])
    )
    halo = _halo(scene, regions, area)
    for channel in range(3):
        values = scene.image[(*at, channel)].astype(np.float64)
        above = values >= half
        channel_area = regions.sums(above)
        channel_clipped = regions.sums(values >= scene.level)
        channel_radius = np.sqrt(channel_area / np.pi)
        gain = halo * config.halo_gain * channel_radius + (1 - halo) * config.lamp_gain
        flux = gain * np.where(halo > 0.5, channel_area, channel_clipped) * scene.level
        shape = np.clip((values - half) / (scene.level - half), 0, 1) ** 2
        total = np.maximum(regions.sums(shape), 1e-6)
        missing = np.maximum(flux - regions.sums(np.where(above, values, 0)), 0) * weight * (channel_clipped > 0)
        excess[(*at, channel)] += (missing / total)[regions.labels] * shape
    used[at] = (weight > 0)[regions.labels]
    return used


def _halo(scene: _Bright, regions: Components, area: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return 1 for regions with the halo of a point of light, 0 for those with a sharp edge."""
    level = 0.15
    wide = connected_components(scene.highest >= level * scene.level)
    index = np.full(scene.lowest.shape, -1, np.intp)
    index[wide.rows, wide.columns] = wide.labels
    first = np.unique(regions.labels, return_index=True)[1]
    parent = index[regions.rows[first], regions.columns[first]]
    inside = np.bincount(parent, area, wide.count)
    growth = np.sqrt(wide.sums() / np.pi)[parent], np.sqrt(inside / np.pi)[parent]
    slope = (growth[0] - growth[1] - 0.6) / np.maximum(growth[1], 0.5)
    return _ramp(slope, (0.1, 0.3))


def _add_areas(scene: _Bright, excess: Array, used: Mask, config: LightConfig) -> None:
    """Add the excess of skies, windows and other lights that are clipped in all channels."""
    bright = (scene.lowest >= config.bright * scene.level) & ~used
    regions = connected_components(bright)
    if regions.count == 0:
        return
    at = regions.rows, regions.columns
    area = regions.sums()
    far = regions.sums(scene.far[at]) / area
    surround = regions.sums(scene.surround[at]) / area
    inner = _eroded(bright)[at]
    clipped = scene.lowest[at] >= scene.level
    inner_area, inner_clipped = regions.sums(inner), regions.sums(inner & clipped)
    fill = np.empty(regions.count)
    for layer in (far >= 0.5, far < 0.5):
        pooled = inner_clipped[layer].sum() / max(inner_area[layer].sum(), 1)
        n = config.pooled_pixels
        fill[layer] = (inner_clipped[layer] + n * pooled) / (inner_area[layer] + n)
    weight = far * _ramp(fill, config.fill_far) + (1 - far) * _ramp(fill, config.fill)
    weight *= _ramp(surround, config.surround[::-1])
    shape = np.clip((scene.lowest[at] - scene.shoulder) / max(scene.level - scene.shoulder, 1e-6), 0, 1) ** 2
    factor = (config.area_gain - 1) * weight[regions.labels] * shape
    excess[at] += (factor[:, None] * scene.image[at]).astype(np.float32)


def _eroded(mask: Mask) -> Mask:
    """Return the pixels whose four neighbours are in the mask; the border counts as inside."""
    padded = np.pad(mask, 1, mode="edge")
    return mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
