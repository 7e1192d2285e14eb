"""Regions with clipped pixels, their features for LightNet, and their light before and after recovery."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.light.bright_picture import Array, BrightPicture, Floats, Indices
from bokehnet.light.components import Components
from bokehnet.light.config import DEFAULT_CONFIG
from bokehnet.light.recovery import estimated_light, picture_of
from bokehnet.light.regions import LightRegions, light_regions
from bokehnet.onnx_session import OnnxSession

__all__ = ["MeasuredRegions", "Network", "learned_sums", "measured_regions", "open_network"]

# Function from features (regions, FEATURES) to the binary logarithm of gains (regions, 3).
Network = Callable[[Array], Array]

# Distances from the edge of the clipped pixels at which the light around them is measured, pixels.
_STEPS_PX = (1, 2, 3, 4, 6, 8, 12, 16)

# Smallest light in logarithmic features, relative to the clip level.
_DARK = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MeasuredRegions:
    """Regions of a picture that hold clipped pixels, and their light relative to the clip level.

    Attributes:
        regions: Regions.
        features: Features, (regions, FEATURES).
        stored: Sums of the stored light, (regions, 3).
        closed: Sums of the light of the closed form, (regions, 3).
        surround: Light around each region, (regions, 3).
        recovered: Picture of the closed form, (H, W, 3).
    """

    regions: LightRegions
    features: Array
    stored: Floats
    closed: Floats
    surround: Floats
    recovered: Array


def measured_regions(image: Array, nearness: Array | None) -> MeasuredRegions | None:
    """Measure the regions of a picture that hold clipped pixels; None if nothing in it is clipped light.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        nearness: Map in which near is large, (H, W).
    """
    picture = picture_of(image, nearness, DEFAULT_CONFIG)
    if picture is None:
        return None
    regions, recovered = light_regions(picture), estimated_light(picture)
    if regions.pixels.count == 0:
        return None
    stored, closed = regions.sums(image), regions.sums(recovered)
    profile, edges = _profile(picture, regions.pixels)
    own = _features(picture, regions.pixels, profile, edges, np.log2(closed / stored))
    weight = np.sqrt(edges + 1)[:, None]
    shared = np.tile((weight * own).sum(0) / weight.sum(), (len(own), 1))
    return MeasuredRegions(
        regions=regions,
        features=np.concatenate([own, shared], 1).astype(np.float32),
        stored=stored,
        closed=closed,
        surround=profile[:, -1],
        recovered=recovered,
    )


def learned_sums(image: Array, nearness: Array | None, network: Network) -> Floats | None:
    """Return the sums of light of the regions of a picture according to LightNet, relative to the clip level.

    They are those of :attr:`bokehnet.scene.scene.Scene.light_sums`; None if nothing is clipped light.

    Args:
        image: Scene-linear picture, (H, W, 3), decoded from display-referred values of 0 to 1.
        nearness: Map in which near is large, (H, W).
        network: Function from features (regions, FEATURES) to logarithmic gains (regions, 3).
    """
    measured = measured_regions(image, nearness)
    if measured is None:
        return None
    return measured.stored * np.exp2(network(measured.features).astype(np.float64))


def open_network(path: Path) -> Network:
    """Open an exported LightNet."""
    session = OnnxSession(str(path))

    def log_gain(features: Array) -> Array:
        rows = np.concatenate([features, features[:1]])  # the export needs two regions
        return np.asarray(session.run({"features": rows})[0][:-1])

    return log_gain


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
    """Return the features of each region by itself, half of the features of LightNet."""
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
