"""Large lights: skies and windows, distinguished from bright matter by the fraction that is clipped."""

from statistics import NormalDist

import numpy as np

from bokehnet.light.bright_picture import Array, BrightPicture, Floats, Indices, Mask, point_sums, ramp
from bokehnet.light.components import Components, connected_components
from bokehnet.light.config import LightConfig
from bokehnet.light.edges import edge_pixels, sharpness

__all__ = ["add_areas", "censored_radiance"]

_MAX_LOG_RADIANCE = 5.0


def add_areas(picture: BrightPicture, result: Array, used: Mask) -> None:
    """Add the missing light of regions that are clipped in all channels to ``result`` (H, W, 3).

    Args:
        picture: Picture.
        result: Changed in place.
        used: Pixels of lamps, which stay unchanged, (H, W).
    """
    bright = (picture.lowest >= picture.config.bright * picture.level) & ~used
    regions = connected_components(bright)
    if regions.count == 0:
        return
    clipped = picture.lowest[regions.rows, regions.columns] >= picture.level
    weight = _light_weights(picture, regions, bright, clipped)
    lit = np.flatnonzero((weight > 0)[regions.labels])
    if len(lit) == 0:
        return
    rows, columns = regions.rows[lit], regions.columns[lit]
    gain = _radiance(picture, rows[clipped[lit]], columns[clipped[lit]])
    span = max(picture.levels.top - picture.levels.shoulder, 1e-6)
    shape = np.clip((picture.lowest[rows, columns] - picture.levels.shoulder) / span, 0, 1) ** 2
    factor = (gain - 1) * weight[regions.labels[lit]] * shape
    color = _color_around(picture, bright, rows, columns)
    result[rows, columns] += (factor[:, None] * color * picture.image[rows, columns]).astype(np.float32)


def _light_weights(picture: BrightPicture, regions: Components, bright: Mask, clipped: Mask) -> Floats:
    """Return the certainty, 0 to 1, that bright regions are light and not matter, (regions,).

    The radiance of a light is far above the clip level, so that all of its inside is clipped. Matter reaches
    the level where its shading is brightest: much of it stays below, and its distribution of radiance says
    that the clipped rest is hardly above.
    """
    config = picture.config
    area = regions.sums()
    far = regions.sums(picture.is_far(regions.rows, regions.columns)) / area
    surround = regions.sums(picture.surround(regions.rows, regions.columns)) / area
    inner = _eroded(_eroded(bright))[regions.rows, regions.columns]
    inner_area, inner_clipped = regions.sums(inner), regions.sums(inner & clipped)
    fill = np.empty(regions.count)
    for layer, n in zip((far >= 0.5, far < 0.5), config.pooled_pixels, strict=True):
        pooled = inner_clipped[layer].sum() / max(float(inner_area[layer].sum()), 1)
        fill[layer] = (inner_clipped[layer] + n * pooled) / (inner_area[layer] + n)
    farthest, nearer = _shading_certainty(picture, regions)
    weight = far * farthest * ramp(fill, config.fill_far) + (1 - far) * nearer * ramp(fill, config.fill)
    weight = weight * ramp(surround, config.surround[::-1])
    weight *= ramp(clipped.sum() / picture.lowest.size, config.high_key[::-1])
    return np.asarray(weight * (weight >= config.min_weight))


def _shading_certainty(picture: BrightPicture, regions: Components) -> Floats:
    """Return the certainty, 0 to 1, that the bright regions of the farthest and of nearer layers are light.

    Matter is shaded smoothly across the clip level. Only cells of even light count, because branches and
    bars before a light darken it as well.
    """
    config, at = picture.config, (regions.rows, regions.columns)
    side = max(config.cell_px, round(config.cell * picture.diagonal))
    cells = at[0] // side * (picture.lowest.shape[1] // side + 1) + at[1] // side
    light = np.minimum(picture.lowest[at] / picture.level, 1).astype(np.float64)
    area = np.bincount(cells)
    is_even = area == side * side
    mean, square = (np.bincount(cells, values) / np.maximum(area, 1) for values in (light, light**2))
    is_even &= square - mean**2 <= (config.even_light * mean) ** 2
    is_far = np.bincount(cells, picture.is_far(*at)) >= 0.5 * area
    clipped, shortfall = np.bincount(cells, light >= 1), np.bincount(cells, -np.log(light))
    ends = config.shading[picture.levels.code < 255]
    certainty = []
    for layer, clutter in zip((is_even & is_far, is_even & ~is_far), config.clutter, strict=True):
        bright, shown = float(clipped[layer].sum()), float((area - clipped)[layer].sum())
        kept = max(shown - clutter * (bright + shown), 0) / max(shown, 1)
        radiance = censored_radiance(bright, kept * shown, kept * float(shortfall[layer].sum()))
        certainty.append(float(ramp(radiance, ends)))
    return np.array(certainty)


def censored_radiance(clipped: float, shown: float, shortfall: float) -> float:
    """Return the mean radiance of the clipped pixels of matter, relative to the clip level.

    Radiance has a log-normal distribution that the clip level censors. The fraction of the pixels below it
    says how many standard deviations the mean is from the level, their mean distance from it how large one
    is. One clipped pixel and a half at half the level are added: without others, the radiance is high.

    Args:
        clipped: Number of clipped pixels.
        shown: Number of unclipped ones.
        shortfall: Sum of the logarithms of the clip level over the light of these.

    Source:
        Cohen, "Estimating the mean and variance of normal populations from singly truncated and doubly
        truncated samples", Annals of Mathematical Statistics 21 (4), 1950.

    Examples:
        >>> light = np.exp(np.random.default_rng(0).normal(0.1, 0.2, 20000))  # a white wall in the sun
        >>> below = light[light < 1]
        >>> measured = censored_radiance((light >= 1).sum(), len(below), -np.log(below).sum())
        >>> bool(abs(measured - light[light >= 1].mean()) < 0.02), censored_radiance(5000, 0, 0) > 5
        (True, True)
    """
    clipped, shown, shortfall = clipped + 1, shown + 0.5, shortfall + 0.5 * np.log(2)
    normal, below = NormalDist(), shown / (shown + clipped)
    mean = normal.inv_cdf(1 - below)  # in standard deviations above the level
    density = normal.pdf(mean)
    deviation = shortfall / shown / max(density / below - mean, 1e-6)
    return float(np.exp(min(deviation * (mean + density / (1 - below)), _MAX_LOG_RADIANCE)))


def _radiance(picture: BrightPicture, rows: Indices, columns: Indices) -> float:
    """Return the common radiance of large lights, measured by their edges where these are sharp.

    Args:
        picture: Picture.
        rows: Rows of the clipped pixels of large lights, (N,).
        columns: Their columns, (N,).
    """
    config = picture.config
    _, near_y, near_x, next_y, next_x = edge_pixels(
        picture.lowest, picture.level, rows, columns, config.edge_dark * picture.level
    )
    if len(near_y) < config.min_edge_pixels:
        return config.area_gain
    around = picture.surround(near_y, near_x)
    near = np.maximum(picture.lowest[near_y, near_x] / picture.level - around, 0)
    further = np.maximum(picture.lowest[next_y, next_x] / picture.level - around, 0)
    blurred = float(ramp(further.sum() / max(float(near.sum()), 1e-6), config.edge_blur))
    # Nearer regions are more often matter.
    margin = (1 - float(picture.is_far(rows, columns).mean())) * config.near_sharpness
    measured = _edge_radiance(config, sharpness(near), margin, picture.levels.code < 255)
    return (1 - blurred) * measured + blurred * config.area_gain


def _edge_radiance(config: LightConfig, sharp: float, margin: float, has_shoulder: bool) -> float:
    """Return the radiance of a large light whose edges have a sharpness.

    Behind a Gaussian point spread function, the light that an edge leaves outside the clipped pixels falls
    with the logarithm of the radiance. Edges parallel to the pixels are all covered by the same fraction, so
    that they can look sharper than any light makes them.

    Args:
        config: Constants.
        sharp: Sharpness of the edges.
        margin: Sharpness above that of far lights for the same radiance, with a hard clip.
        has_shoulder: Whether the tone curve ends below white.
    """
    above = sharp - config.matter_sharpness[has_shoulder] - (0.0 if has_shoulder else margin)
    aligned = float(ramp(sharp, config.aligned_sharpness[has_shoulder]))
    log_radiance = (1 - aligned) * config.area_sharp_gain[has_shoulder] * above
    radiance = np.exp(log_radiance + aligned * np.log(config.aligned_gain))
    return float(np.clip(radiance, config.area_gain_min[has_shoulder], config.area_gain_max))


def _color_around(picture: BrightPicture, bright: Mask, rows: Indices, columns: Indices) -> Floats:
    """Return the colour of unclipped bright pixels around pixels, raised to a power, of mean 1, (N, 3)."""
    shown = np.nonzero(bright & (picture.highest < picture.levels.shoulder))
    reach = picture.config.surround_reach * picture.diagonal
    color = point_sums(picture.image[shown], shown, picture.lowest.shape, reach).at(rows, columns) + 1e-3
    return np.asarray((color / color.mean(-1, keepdims=True)) ** picture.config.color_power)


def _eroded(mask: Mask) -> Mask:
    """Return the pixels whose four neighbours are in the mask; the border counts as inside."""
    padded = np.pad(mask, 1, mode="edge")
    return np.asarray(mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:])
