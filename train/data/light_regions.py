"""Regions with clipped pixels, their features for LightNet, and their light before and after recovery."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bokehnet.light.bright_picture import Array, BrightPicture, Floats, Indices
from bokehnet.light.components import Components, connected_components
from bokehnet.light.config import DEFAULT_CONFIG
from bokehnet.light.recovery import common_levels, is_drawing, recover_light
from bokehnet.models.light import FEATURES

__all__ = ["LightRegions", "light_regions", "with_region_light"]

# Distances from the edge of the clipped pixels at which the light around them is measured, pixels.
_STEPS_PX = (1, 2, 3, 4, 6, 8, 12, 16)

# Smallest light in logarithmic features, relative to the clip level.
_DARK = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LightRegions:
    """Regions of a picture that hold clipped pixels.

    Light is relative to the clip level, sums are over the pixels of a region.

    Attributes:
        pixels: Pixels of the regions.
        features: Features, (regions, FEATURES).
        stored: Sums of the stored light, (regions, 3).
        closed: Sums of the light of the closed form, (regions, 3).
        surround: Light around each region, (regions, 3).
        recovered: Picture of the closed form, (H, W, 3).
        level: Clip level.
    """

    pixels: Components
    features: Array
    stored: Floats
    closed: Floats
    surround: Floats
    recovered: Array
    level: float

    def sums(self, image: Array) -> Floats:
        """Return the sums of an image (H, W, 3) over regions, relative to the clip level, (regions, 3)."""
        values = image[self.pixels.rows, self.pixels.columns].astype(np.float64) / self.level
        return np.stack([self.pixels.sums(values[:, channel]) for channel in range(3)], -1)


def light_regions(image: Array, nearness: Array | None) -> LightRegions | None:
    """Measure the regions of a picture that hold clipped pixels; None if nothing in it is clipped light.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        nearness: Map in which near is large, (H, W).
    """
    config = DEFAULT_CONFIG
    levels = common_levels(image, config)
    if levels is None or is_drawing(image, levels.clipped, config):
        return None
    picture = BrightPicture.of(image, nearness, levels, config)
    pixels = _with_clipped(connected_components(picture.highest >= config.bright * levels.clipped), picture)
    if pixels is None:
        return None
    recovered = recover_light(image, nearness).image
    result = LightRegions(
        pixels=pixels,
        features=np.zeros((pixels.count, FEATURES), np.float32),
        stored=np.zeros((pixels.count, 3)),
        closed=np.zeros((pixels.count, 3)),
        surround=np.zeros((pixels.count, 3)),
        recovered=recovered,
        level=levels.clipped,
    )
    result.stored[:], result.closed[:] = result.sums(image), result.sums(recovered)
    profile, edges = _profile(picture, pixels)
    result.surround[:] = profile[:, -1]
    own = _features(picture, pixels, profile, edges, np.log2(result.closed / result.stored))
    weight = np.sqrt(edges + 1)[:, None]
    shared = np.tile((weight * own).sum(0) / weight.sum(), (pixels.count, 1))
    result.features[:] = np.concatenate([own, shared], 1)
    return result


def with_region_light(image: Array, regions: LightRegions, log_gain: Array) -> Array:
    """Return a picture whose regions have a gain on their stored light.

    The excess is distributed within a region as the closed form distributes it; in a region that it leaves
    unchanged, as the square of the light above half the clip level.

    Args:
        image: Scene-linear picture, (H, W, 3).
        regions: Its regions.
        log_gain: Binary logarithm of the gain on the sums, (regions, 3).
    """
    at, labels = (regions.pixels.rows, regions.pixels.columns), regions.pixels.labels
    excess = (regions.recovered[at] - image[at]).astype(np.float64)
    half = DEFAULT_CONFIG.bright * regions.level
    shape = np.clip((image[at].astype(np.float64) - half) / (regions.level - half), 0, 1) ** 2
    flux = regions.stored * np.maximum(np.exp2(log_gain.astype(np.float64)) - 1, 0) * regions.level
    result = image.copy()
    whole = regions.pixels.sums(excess.sum(-1))
    for channel in range(3):
        weights = np.where(whole[labels] > 0, excess[:, channel], shape[:, channel])
        sums = regions.pixels.sums(weights)
        weights = np.where(sums[labels] > 0, weights, shape.max(-1))
        scale = flux[:, channel] / np.maximum(regions.pixels.sums(weights), 1e-6)
        result[(*at, channel)] += (scale[labels] * weights).astype(np.float32)
    return result


def _with_clipped(pixels: Components, picture: BrightPicture) -> Components | None:
    """Return the components with a clipped pixel, renumbered; None without any."""
    if pixels.count == 0:
        return None
    clipped = pixels.sums(picture.highest[pixels.rows, pixels.columns] >= picture.level) > 0
    if not clipped.any():
        return None
    number = np.cumsum(clipped) - 1
    inside = clipped[pixels.labels]
    return Components(
        pixels.rows[inside],
        pixels.columns[inside],
        number[pixels.labels[inside]],
        int(clipped.sum()),
    )


def _profile(picture: BrightPicture, pixels: Components) -> tuple[Floats, Floats]:
    """Return the mean light at some steps from the clipped pixels (regions, steps, 3), and their edges.

    The second value counts the pairs of a clipped pixel and an unclipped neighbour, (regions,).
    """
    height, width = picture.lowest.shape
    core = np.flatnonzero(picture.highest[pixels.rows, pixels.columns] >= picture.level)
    rows, columns, labels = pixels.rows[core], pixels.columns[core], pixels.labels[core]
    sums = np.zeros((pixels.count, len(_STEPS_PX), 3))
    counts = np.zeros((pixels.count, len(_STEPS_PX)))
    for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (-1, 1), (1, -1), (1, 1)):
        edge = _inside(rows + down, columns + right, height, width)
        index = np.flatnonzero(edge)
        is_edge = picture.highest[rows[index] + down, columns[index] + right] < picture.level
        index = index[is_edge]
        for number, step in enumerate(_STEPS_PX):
            y, x = rows[index] + step * down, columns[index] + step * right
            inside = _inside(y, x, height, width)
            label, light = labels[index][inside], picture.image[y[inside], x[inside]] / picture.level
            counts[:, number] += np.bincount(label, minlength=pixels.count)
            for channel in range(3):
                sums[:, number, channel] += np.bincount(label, np.minimum(light[:, channel], 1), pixels.count)
    return (sums + _DARK) / (counts[..., None] + 1), counts[:, 0]


def _inside(rows: Indices, columns: Indices, height: int, width: int) -> npt.NDArray[np.bool_]:
    return (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)


def _features(
    picture: BrightPicture, pixels: Components, profile: Floats, edges: Floats, closed: Floats
) -> Floats:
    """Return the features of each region by itself, (regions, FEATURES / 2)."""
    at, levels = (pixels.rows, pixels.columns), picture.levels
    area, count = pixels.sums(), pixels.count
    light = picture.image[at].astype(np.float64) / picture.level
    clipped = light >= 1
    shown = light.max(-1) < levels.shoulder / levels.clipped
    color = np.stack([pixels.sums(light[:, c] * shown) for c in range(3)], -1) + 1e-2
    half_level = picture.lowest[at] >= picture.config.bright * picture.level
    numbers = [
        np.log2(area),
        np.log2(area) - 2 * np.log2(picture.diagonal),
        np.log2(edges + 1) - 0.5 * np.log2(area),
        *(pixels.sums(clipped[:, c]) / area for c in range(3)),
        pixels.sums(clipped.all(-1)) / area,
        pixels.sums(clipped.all(-1)) / (pixels.sums(half_level) + 1),
        pixels.sums(shown) / area,
        *(pixels.sums(light[:, c]) / area for c in range(3)),
        *np.log2(color / color.mean(-1, keepdims=True)).T,
        np.log2(pixels.sums(picture.surround(*at)) / area + _DARK),
        pixels.sums(picture.relative_nearness(*at)) / area,
        pixels.sums(picture.is_far(*at)) / area,
        np.full(count, np.log2(picture.median + _DARK)),
        np.full(count, np.log2(clipped.all(-1).sum() / picture.lowest.size + 1e-5)),
        np.full(count, np.log2(count)),
        np.full(count, float(levels.code < 255)),
        np.full(count, levels.shoulder / levels.clipped),
        *closed.T,
    ]
    return np.concatenate([np.stack(numbers, -1), np.log2(profile).reshape(count, -1)], 1)
