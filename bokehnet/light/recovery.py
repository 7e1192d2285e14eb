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


def _common_levels(image: Array, config: LightConfig) -> ClipLevel | None:
    """Return the clip level of the whole picture; None unless at least two channels clip at the same one."""
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
    return ClipLevel(
        code=min(codes),
        clipped=min(level.clipped for level in known),
        top=min(level.top for level in known),
        shoulder=float(np.median([level.shoulder for level in known])),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Bright:
    """Picture with the quantities that decide what is light.

    Attributes:
        image: Scene-linear picture, (H, W, 3).
        level: Light from which a channel is clipped.
        top: Light of the clip level itself.
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
    top: float
    shoulder: float
    lowest: Array
    highest: Array
    surround: Array
    far: Mask
    median: float
    diagonal: float

    @classmethod
    def of(
        cls, image: Array, defocus: Array | None, levels: ClipLevel, config: LightConfig
    ) -> "_Bright":
        level = levels.clipped
        lowest, highest = image.min(-1), image.max(-1)
        diagonal = float(np.hypot(*lowest.shape))
        return cls(
            image=image,
            level=level,
            top=levels.top,
            shoulder=levels.shoulder,
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
    dark = values < limit
    sums = _box_sums([np.where(dark, values, 0), dark.astype(np.float32)], reach)
    return np.where(sums[..., 1] > 0.5, sums[..., 0] / np.maximum(sums[..., 1], 1), np.float32(limit))


def _box_sums(layers: list[Array], reach: float) -> Array:
    """Return sums over squares of half-width ``reach`` pixels around each pixel, (H, W, layers).

    All pixels of a cell, an eighth of the reach wide, have the same square.
    """
    step = max(1, round(reach / 8))
    height, width = layers[0].shape
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    radius = max(1, round(reach / step))
    result = []
    for layer in layers:
        sums = np.add.reduceat(np.add.reduceat(layer, rows, 0, dtype=np.float64), columns, 1)
        for axis in (0, 1):
            total = np.cumsum(np.insert(sums, 0, 0.0, axis=axis), axis=axis)
            size = sums.shape[axis]
            high = np.minimum(np.arange(size) + radius + 1, size)
            sums = np.take(total, high, axis) - np.take(total, np.maximum(np.arange(size) - radius, 0), axis)
        result.append(np.repeat(np.repeat(sums.astype(np.float32), step, 0), step, 1)[:height, :width])
    return np.stack(result, -1)


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
    if regions.count == 0:
        return used
    at = regions.rows, regions.columns
    area = regions.sums()
    clipped = regions.sums(scene.highest[at] >= scene.level)
    surround = regions.sums(scene.surround[at]) / area
    is_small = np.sqrt(area / np.pi) <= config.lamp_radius * scene.diagonal
    night *= float(_ramp(clipped[is_small].sum() / max(clipped.sum(), 1), config.lamp_share))
    weight = (
        night
        * is_small
        * _ramp(clipped / area, config.lamp_fill)
        * _ramp(surround, config.lamp_surround[::-1])
    )
    # Bright matter of a saturated colour clips in one channel alone.
    second = np.sort(scene.image[at], axis=-1)[:, 1]
    weight *= regions.sums(second >= scene.level) > 0
    halo = _Halo.of(scene, regions, area, config)
    central = _centrality(scene, regions, halo.weight, config)
    color, sharpness = _edge_light(scene, regions, (weight > 0) & (halo.weight < 0.5), config)
    sharp_flux = float(np.clip(config.sharp_gain * sharpness, *config.lamp_gain)) * clipped
    limit = config.max_lamp_gain * clipped
    for channel in range(3):
        values = scene.image[(*at, channel)].astype(np.float64)
        is_clipped = regions.sums(values >= scene.level) > 0
        flux = halo.weight * halo.flux(scene, channel) + (1 - halo.weight) * color[:, channel] * sharp_flux
        flux = np.minimum(flux, limit)
        shape = central * np.clip((values - half) / (scene.level - half), 0, 1) ** 2
        total = np.maximum(regions.sums(shape), 1e-6)
        missing = np.maximum(flux * scene.level - regions.sums(values), 0) * weight * is_clipped
        excess[(*at, channel)] += (missing / total)[regions.labels] * shape
    used[at] = (weight > 0)[regions.labels]
    return used


def _centrality(
    scene: _Bright, regions: Components, halo: npt.NDArray[np.float64], config: LightConfig
) -> npt.NDArray[np.float64]:
    """Return the weight of each pixel in the light of its lamp, large in the middle of the clipped core.

    Edge pixels of a sharp lamp are clipped although it covers them in part, so that pixels count by their
    clipped neighbours. The light of a point is where the least clipped channel is brightest.
    """
    clipped = np.pad(scene.highest >= scene.level, 1)
    neighbors = np.zeros(len(regions.rows))
    for down in range(3):
        for right in range(3):
            neighbors += clipped[regions.rows + down, regions.columns + right]
    whole = scene.image[regions.rows, regions.columns].sum(-1, dtype=np.float64)
    peak = np.zeros(regions.count)
    np.maximum.at(peak, regions.labels, whole)
    weight = halo[regions.labels]
    point = (whole / peak[regions.labels]) ** (config.concentration * weight)
    return np.asarray(point * (neighbors / 9) ** (config.edge_power * (1 - weight)))


def _edge_pixels(
    values: Array, level: float, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp], dark: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the unclipped neighbours of clipped pixels at edges towards the dark.

    Args:
        values: Light of each pixel, (H, W).
        level: Clip level.
        rows: Rows of clipped pixels, (N,).
        columns: Their columns, (N,).
        dark: Light up to which the pixel three steps away counts as dark.

    Returns:
        Indices of the clipped pixels, and rows and columns of their neighbours, (pairs,) each.
    """
    height, width = values.shape
    pairs = []
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            near, far = (rows + down, columns + right), (rows + 3 * down, columns + 3 * right)
            keep = (far[0] >= 0) & (far[0] < height) & (far[1] >= 0) & (far[1] < width)
            index = np.flatnonzero(keep)
            index = index[values[near[0][index], near[1][index]] < level]
            index = index[values[far[0][index], far[1][index]] < dark]
            pairs.append(np.stack([index, near[0][index], near[1][index]]))
    index, near_rows, near_columns = np.concatenate(pairs, axis=1)
    return index, near_rows, near_columns


def _edge_light(
    scene: _Bright, regions: Components, is_lamp: npt.NDArray[np.bool_], config: LightConfig
) -> tuple[npt.NDArray[np.float64], float]:
    """Return the colour of each light, (regions, 3), 1 in its brightest channel, and the sharpness of edges.

    An edge pixel that a light covers by a fraction a shows a times its radiance if that is not clipped: the
    unclipped edge pixels show its colour.
    """
    core = np.flatnonzero(
        (scene.highest[regions.rows, regions.columns] >= scene.level) & is_lamp[regions.labels]
    )
    dark = config.edge_dark * scene.level
    index, rows, columns = _edge_pixels(
        scene.highest, scene.level, regions.rows[core], regions.columns[core], dark
    )
    light = np.maximum(scene.image[rows, columns] - scene.surround[rows, columns, None] * scene.level, 0)
    labels = regions.labels[core[index]]
    sums = np.stack([np.bincount(labels, light[:, channel], regions.count) for channel in range(3)], -1) + 1e-3
    return sums / sums.max(-1, keepdims=True), _sharpness(light.max(-1) / scene.level)


def _sharpness(edge_light: npt.NDArray[np.floating]) -> float:
    """Return half the inverse of the mean light of edge pixels relative to the clip level.

    An edge pixel that light of radiance F covers by a fraction a is clipped if a > 1 / F. With a uniform in
    [0, 1] and the others clipped, the mean over all unclipped pixels at the edge, some of them not covered at
    all, falls as 1 / F; a wide point spread function raises it.
    """
    return 0.5 * max(len(edge_light), 1) / max(float(edge_light.sum()), 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class _Halo:
    """Halos of small lights: the regions where light is above a low level.

    Attributes:
        wide: Regions above that level.
        parent: Wide region of each light.
        portion: Portion of its wide region that belongs to each light, by area.
        weight: 1 for lights with the halo of a point of light, 0 for those with a sharp edge.
        config: Constants.
    """

    wide: Components
    parent: npt.NDArray[np.intp]
    portion: npt.NDArray[np.float64]
    weight: npt.NDArray[np.float64]
    config: LightConfig

    @classmethod
    def of(
        cls, scene: _Bright, regions: Components, area: npt.NDArray[np.float64], config: LightConfig
    ) -> "_Halo":
        wide = connected_components(scene.highest >= config.halo_level * scene.level)
        index = np.full(scene.lowest.shape, -1, np.intp)
        index[wide.rows, wide.columns] = wide.labels
        first = np.unique(regions.labels, return_index=True)[1]
        parent = index[regions.rows[first], regions.columns[first]]
        portion = area / np.bincount(parent, area, wide.count)[parent]
        radius = np.sqrt(area / np.pi)
        wide_radius = np.sqrt(wide.sums()[parent] * portion / np.pi)
        # A sharp edge widens by the pixel filter alone.
        growth = (wide_radius - radius - config.edge_width) / np.maximum(radius, 0.5)
        return cls(wide, parent, portion, _ramp(growth, config.halo_growth), config)

    def flux(self, scene: _Bright, channel: int) -> npt.NDArray[np.float64]:
        """Return the flux of each light in a channel, pixels at the clip level.

        The diffraction halo of a point of flux F at radius r is F L / (pi^3 r^3), for L = wavelength times
        f-number in pixels. So the radius at which it falls to a level gives F.

        Source:
            Born and Wolf, "Principles of optics", 8.5.2: 2 L / (pi^2 r) of the light is outside radius r.
        """
        level = self.config.halo_level
        above = scene.image[self.wide.rows, self.wide.columns, channel] >= level * scene.level
        radius = np.sqrt(self.wide.sums(above)[self.parent] * self.portion / np.pi)
        radius = np.maximum(radius - self.config.core_radius, 0)
        return np.asarray(level * np.pi**3 / self.config.diffraction * radius**3)


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
    weight *= weight >= config.min_weight
    core = np.flatnonzero(clipped & (weight > 0)[regions.labels])
    _, rows, columns = _edge_pixels(
        scene.lowest, scene.level, regions.rows[core], regions.columns[core], config.edge_dark * scene.level
    )
    edge_light = scene.lowest[rows, columns] / scene.level - scene.surround[rows, columns]
    sharpness = _sharpness(np.maximum(edge_light, 0)) if len(rows) >= config.min_edge_pixels else 0.0
    measured = float(np.clip(config.area_sharp_gain * sharpness, *config.area_gains))
    certainty = float(_ramp(sharpness, config.measurable))
    gain = certainty * measured + (1 - certainty) * config.area_gain
    span = max(scene.top - scene.shoulder, 1e-6)
    shape = np.clip((scene.lowest[at] - scene.shoulder) / span, 0, 1) ** 2
    factor = ((gain - 1) * weight[regions.labels] * shape)[:, None]
    excess[at] += (factor * scene.image[at] * _color_around(scene, bright, config)[at]).astype(np.float32)


def _color_around(scene: _Bright, bright: Mask, config: LightConfig) -> Array:
    """Return the colour of bright pixels that are not clipped around each pixel, (H, W, 3), of mean 1."""
    shown = bright & (scene.highest < scene.shoulder)
    reach = config.surround_reach * scene.diagonal
    sums = _box_sums([shown * scene.image[..., c] for c in range(3)], reach) + 1e-3
    return (sums / sums.mean(-1, keepdims=True)) ** config.color_power


def _eroded(mask: Mask) -> Mask:
    """Return the pixels whose four neighbours are in the mask; the border counts as inside."""
    padded = np.pad(mask, 1, mode="edge")
    return mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
