"""Faults of depth maps for the repair benchmark: wrong at edges in the ways of networks and sensors.

In: exact disparity, (H, W), 0 to 1, and a random generator. Out: the faulty map, (H, W).
"""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from scipy.ndimage import (
    gaussian_filter,
    map_coordinates,
    maximum_filter,
    minimum_filter,
    uniform_filter,
    zoom,
)

__all__ = ["FAULTS"]

# Faults: functions of the exact map and a random generator that return a map, (H, W).
Fault = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def _morphology(values: np.ndarray, _: np.random.Generator, *, sizes: tuple[int, ...]) -> np.ndarray:
    """Return the map after grey-scale dilations (positive sizes) and erosions (negative sizes)."""
    for size in sizes:
        values = (maximum_filter if size > 0 else minimum_filter)(values, abs(size), mode="nearest")
    return values


def _blurred(values: np.ndarray, _: np.random.Generator, *, sigma: float) -> np.ndarray:
    return np.asarray(gaussian_filter(values, sigma, mode="nearest"), np.float32)


def _coarse(values: np.ndarray, _: np.random.Generator, *, factor: int) -> np.ndarray:
    """Return the map at a fraction of its size, enlarged by bilinear interpolation."""
    height, width = values.shape
    small = zoom(uniform_filter(values, factor), 1 / factor, order=1)
    return np.asarray(zoom(small, (height / small.shape[0], width / small.shape[1]), order=1), np.float32)


def _ringing(values: np.ndarray, _: np.random.Generator, *, factor: int) -> np.ndarray:
    """Return the map at a fraction of its size, enlarged by cubic splines, which overshoot at edges."""
    height, width = values.shape
    small = zoom(uniform_filter(values, factor), 1 / factor, order=1)
    return np.asarray(zoom(small, (height / small.shape[0], width / small.shape[1]), order=3), np.float32)


def _jagged(values: np.ndarray, rng: np.random.Generator, *, reach: float) -> np.ndarray:
    """Return the map with edges displaced by a smooth random field of up to ``reach`` pixels."""
    fields = [gaussian_filter(rng.standard_normal(values.shape), 10) for _ in range(2)]
    y, x = np.mgrid[: values.shape[0], : values.shape[1]]
    place = [y + reach * fields[0] / np.abs(fields[0]).max(), x + reach * fields[1] / np.abs(fields[1]).max()]
    return np.asarray(gaussian_filter(map_coordinates(values, place, order=0, mode="nearest"), 1), np.float32)


def _moved(values: np.ndarray, _: np.random.Generator, *, offset: tuple[int, int]) -> np.ndarray:
    """Return the map displaced down and to the right, its border repeated."""
    padding = [(max(pixels, 0), max(-pixels, 0)) for pixels in offset]
    padded = np.pad(values, padding, "edge")
    rows, columns = (
        slice(max(-pixels, 0), max(-pixels, 0) + side)
        for pixels, side in zip(offset, values.shape, strict=True)
    )
    return padded[rows, columns]


def _network_like(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the map as a depth network makes it: two sizes coarser, edges a pixel off, bent tones."""
    bent = values ** np.float32(0.8)
    return _blurred(_jagged(_coarse(bent, rng, factor=2), rng, reach=2.0), rng, sigma=0.7)


def _wide(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the map with larger foregrounds and soft edges, as of networks and of matching in windows."""
    return _blurred(_morphology(values, rng, sizes=(5,)), rng, sigma=1.5)


def _with_noise(values: np.ndarray, rng: np.random.Generator, *, deviation: float) -> np.ndarray:
    return np.asarray(values + deviation * rng.standard_normal(values.shape), np.float32)


def _noisy(values: np.ndarray, rng: np.random.Generator, *, deviation: float) -> np.ndarray:
    """Return the map with smaller foregrounds and noise in each pixel, as of sensors."""
    return _with_noise(_morphology(values, rng, sizes=(-5,)), rng, deviation=deviation)


def _speckled(values: np.ndarray, rng: np.random.Generator, *, fraction: float) -> np.ndarray:
    """Return the map with soft edges and some wrong single pixels, as of stereo matching."""
    result = _blurred(values, rng, sigma=2.5)
    is_wrong = rng.random(values.shape) < fraction
    result[is_wrong] = rng.uniform(values.min(), values.max(), int(is_wrong.sum()))
    return result


FAULTS: Mapping[str, Fault] = {
    "blurred": partial(_blurred, sigma=2.5),
    "eroded": partial(_morphology, sizes=(-5,)),
    "dilated": partial(_morphology, sizes=(5,)),
    "opened": partial(_morphology, sizes=(-7, 7)),
    "coarse": partial(_coarse, factor=4),
    "ringing": partial(_ringing, factor=4),
    "jagged": partial(_jagged, reach=4.0),
    "moved": partial(_moved, offset=(-2, 3)),
    "network": _network_like,
    "wide": _wide,
    "noisy": partial(_noisy, deviation=0.03),
    "noise": partial(_with_noise, deviation=0.08),
    "speckled": partial(_speckled, fraction=0.002),
}
