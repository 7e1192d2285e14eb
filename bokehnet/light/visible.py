"""Light of lamps in pixels with an unclipped channel, from that channel and the colour of the edges."""

from dataclasses import dataclass

import numpy as np

from bokehnet.light.bright_picture import BrightPicture, Floats, Mask
from bokehnet.light.components import Components
from bokehnet.light.edges import DARK_SIDE_PX, edge_pixels, sharpness

__all__ = ["VisibleLight", "edge_light", "visible_light"]

# Added to the light of each channel, so that colours of lamps without edges are white.
_MIN_LIGHT = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class VisibleLight:
    """Light of lamps in their brightest channel, relative to the clip level.

    Attributes:
        flux: Sum over the pixels with an unclipped channel, (regions,).
        hidden: Number of the other pixels, (regions,).
        least: Minimum radiance of these, (regions,).
        shoulder: Light at which the tone curve of the camera clips, 1 for a hard clip.
    """

    flux: Floats
    hidden: Floats
    least: Floats
    shoulder: float


def edge_light(
    picture: BrightPicture, regions: Components, is_lamp: Mask, is_sharp: Mask
) -> tuple[Floats, float]:
    """Return the colour of each light, (regions, 3), 1 in its brightest channel, and the sharpness of edges.

    A light that covers a fraction of an edge pixel shows its own colour there, in addition to that of the
    dark side, unless a channel is clipped. Pixels near the clip level count less: a shoulder changes them.

    Args:
        picture: Picture.
        regions: Bright regions.
        is_lamp: Regions whose colour is measured, (regions,).
        is_sharp: Regions whose edges count for the sharpness, (regions,).
    """
    at = regions.rows, regions.columns
    core = np.flatnonzero((picture.highest[at] >= picture.level) & is_lamp[regions.labels])
    dark = picture.config.edge_dark * picture.level
    rows, columns = at[0][core], at[1][core]
    index, y, x, *_ = edge_pixels(picture.highest, picture.level, rows, columns, dark)
    down, right = y - rows[index], x - columns[index]
    dark_side = picture.image[y + (DARK_SIDE_PX - 1) * down, x + (DARK_SIDE_PX - 1) * right]
    light = np.maximum(picture.image[y, x] - dark_side, 0).astype(np.float64) / picture.level
    labels, weights = regions.labels[core[index]], (1 - light.max(-1)) ** 2
    sums = [np.bincount(labels, weights * light[:, c], regions.count) for c in range(3)]
    color = np.stack(sums, -1).astype(np.float64) + _MIN_LIGHT
    above = np.maximum(picture.highest[y, x] / picture.level - picture.surround(y, x), 0)
    return color / color.max(-1, keepdims=True), sharpness(above[is_sharp[labels]])


def visible_light(picture: BrightPicture, regions: Components, color: Floats) -> VisibleLight:
    """Measure the light of lamps of one colour each in all pixels with an unclipped channel.

    Args:
        picture: Picture.
        regions: Bright regions.
        color: Colour of each, (regions, 3), 1 in its brightest channel.
    """
    config = picture.config
    light = picture.image[regions.rows, regions.columns].astype(np.float64) / picture.level
    own = color[regions.labels]
    highest = light.max(-1)
    shown = np.clip(1 - light, 0, 1) ** 2 * own
    radiance = (shown * light).sum(-1) / np.maximum((shown * own).sum(-1), 1e-9)
    is_hidden = np.logical_not(((light < 1) & (own > config.min_color)).any(-1))
    shoulder = _shoulder(picture, light, own)
    return VisibleLight(
        flux=regions.sums(np.where(is_hidden, 0, np.maximum(radiance, highest))),
        hidden=regions.sums(is_hidden),
        least=shoulder / np.maximum(color.min(-1), config.min_color),
        shoulder=shoulder,
    )


def _shoulder(picture: BrightPicture, light: Floats, color: Floats) -> float:
    """Return the light at which the tone curve clips, from pixels just below the clip level.

    There the weak channels, which are far below any shoulder, say how bright the strongest one is.

    Args:
        picture: Picture.
        light: Light of pixels, relative to the clip level, (N, 3).
        color: Colour of their lamps, (N, 3).
    """
    config = picture.config
    highest = light.max(-1)
    is_weak = (light < config.bright) & (color < config.weak_color)
    usable = (highest > config.near_clip) & (highest < 1) & is_weak.any(-1)
    if not usable.any():
        return 1.0
    weights = (is_weak * color)[usable]
    radiance = (weights * light[usable]).sum(-1) / (weights * color[usable]).sum(-1)
    count = len(radiance)
    measured = np.clip(np.quantile(radiance, config.shoulder_quantile), 1, config.max_shoulder)
    return float(1 + (measured - 1) * count / (count + config.shoulder_pixels))
