"""Large lights: skies and windows, told from bright matter by how much of them is clipped."""

import numpy as np

from bokehnet.light.bright_picture import Array, BrightPicture, Floats, Indices, Mask, cell_sums, ramp
from bokehnet.light.components import Components, connected_components
from bokehnet.light.edges import edge_pixels, sharpness

__all__ = ["add_areas"]


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
    the level where its shading is brightest: much of it stays below.
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
    weight = far * ramp(fill, config.fill_far) + (1 - far) * ramp(fill, config.fill)
    weight = weight * ramp(surround, config.surround[::-1])
    weight *= ramp(clipped.sum() / picture.lowest.size, config.high_key[::-1])
    return np.asarray(weight * (weight >= config.min_weight))


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
    has_shoulder = picture.levels.code < 255
    far = float(picture.is_far(rows, columns).mean())
    # Nearer regions are more often matter.
    margin = 0.0 if has_shoulder else (1 - far) * config.near_sharpness
    excess = config.area_sharp_gain * (sharpness(near) - config.matter_sharpness[has_shoulder] - margin)
    lowest_gain = config.area_gain_min[has_shoulder]
    measured = float(np.clip(1 + excess, lowest_gain, config.area_gain_max))
    return (1 - blurred) * measured + blurred * config.area_gain


def _color_around(picture: BrightPicture, bright: Mask, rows: Indices, columns: Indices) -> Floats:
    """Return the colour of unclipped bright pixels around pixels, raised to a power, of mean 1, (N, 3)."""
    shown = bright & (picture.highest < picture.levels.shoulder)
    reach = picture.config.surround_reach * picture.diagonal
    color = cell_sums(picture.image, reach, shown).at(rows, columns).astype(np.float64) + 1e-3
    return np.asarray((color / color.mean(-1, keepdims=True)) ** picture.config.color_power)


def _eroded(mask: Mask) -> Mask:
    """Return the pixels whose four neighbours are in the mask; the border counts as inside."""
    padded = np.pad(mask, 1, mode="edge")
    return np.asarray(mask & padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:])
