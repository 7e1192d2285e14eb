"""Depth maps as real estimators make them, from the scene itself.

Each function returns the depth in metres, (H, W). The faults come from how an estimator works, not from
noise that is added to an exact map: the stereo matcher compares two rendered pictures, the time-of-flight
camera averages light over its large pixels, the upsampling sees a coarse map and the sharp picture.
"""

from collections.abc import Callable

import numpy as np

from bokeh_bench.scenes import HEIGHT, WIDTH, Scene, camera
from bokeh_bench.tracing import SKY_DEPTH, pinhole_depth, render

__all__ = ["KINDS", "depth_map"]

# Distance of the two cameras of the stereo pair in pixel metres: disparity in pixels times depth in metres.
_STEREO_BASELINE, _STEREO_DISPARITIES, _STEREO_WINDOW = 12.0, 32, 7

# Factor of the resolution of the time-of-flight camera, its relative noise and its least usable light.
_TOF_FACTOR, _TOF_NOISE, _TOF_MIN_LIGHT = 4, 0.01, 0.02

# Factor of the coarse map that is upsampled, and sigmas of the joint bilateral filter, coarse pixels and
# colour.
_COARSE_FACTOR, _SPACE_SIGMA, _COLOR_SIGMA = 8, 0.7, 0.1


def _box(values: np.ndarray, size: int) -> np.ndarray:
    """Return the mean over a square of an odd size, border repeated."""
    half = size // 2
    padded = np.pad(values, [(half + 1, half), (half + 1, half)], mode="edge").cumsum(0).cumsum(1)
    total = padded[size:, size:] - padded[:-size, size:] - padded[size:, :-size] + padded[:-size, :-size]
    return np.asarray(total / size**2)


def _median(values: np.ndarray, size: int) -> np.ndarray:
    half = size // 2
    padded = np.pad(values, half, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, (size, size))
    return np.asarray(np.median(windows.reshape(*values.shape, -1), axis=-1))


def _resized(values: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return (h, w) interpolated linearly to another size, centres aligned, border repeated."""
    result = np.asarray(values, np.float64)
    for axis in range(2):
        count = result.shape[axis]
        position = np.clip((np.arange(shape[axis]) + 0.5) * count / shape[axis] - 0.5, 0, count - 1)
        low = np.minimum(position.astype(int), max(count - 2, 0))
        part = (position - low).reshape((-1, 1) if axis == 0 else (1, -1))
        upper = np.take(result, np.minimum(low + 1, count - 1), axis)
        result = np.take(result, low, axis) * (1 - part) + upper * part
    return result


def _blocks(values: np.ndarray, factor: int) -> np.ndarray:
    """Return the mean of blocks, (H / factor, W / factor, ...)."""
    height, width = values.shape[0] // factor, values.shape[1] // factor
    return np.asarray(values.reshape(height, factor, width, factor, *values.shape[2:]).mean((1, 3)))


def exact(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth at the pixels' centres."""
    return pinhole_depth(scene.surfaces, scene.sky, camera())


def eight_bit(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the exact inverse depth in 256 levels."""
    inverse = 1 / exact(scene, image)
    low, high = inverse.min(), inverse.max()
    return _depth(low + np.round(255 * (inverse - low) / (high - low)) / 255 * (high - low))


def stereo(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth of block matching between this picture and one from the right.

    Windows fatten foregrounds, stripes match at the wrong period, smooth areas are noisy, and pixels that
    the second camera does not see fail the check from right to left and take the farther neighbour of their
    row.
    """
    baseline = _STEREO_BASELINE * camera().slope
    right = render(scene.surfaces, scene.sky, camera(shift=baseline), 64, 5)
    left = np.clip(image, 0, 1) ** (1 / 2.2)
    right = np.clip(right, 0, 1) ** (1 / 2.2)
    costs = np.empty((2, _STEREO_DISPARITIES, HEIGHT, WIDTH))
    for d in range(_STEREO_DISPARITIES):
        moved = np.roll(right, d, 1)
        moved[:, :d] = right[:, :1]
        difference = np.abs(left - moved).sum(-1)
        costs[0, d] = _box(difference, _STEREO_WINDOW)
        costs[1, d] = np.roll(costs[0, d], -d, 1)
    disparity, other = costs.argmin(1)
    columns = np.arange(WIDTH)
    seen = np.abs(np.take_along_axis(other, np.clip(columns - disparity, 0, WIDTH - 1), 1) - disparity) <= 1
    return _depth(_median(_filled(_subpixel(costs[0], disparity), seen), 5) / _STEREO_BASELINE)


def _subpixel(costs: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Return the minimum of the parabola through the costs around the best disparity."""
    low, middle, high = (
        np.take_along_axis(costs, np.clip(best + step, 0, len(costs) - 1)[None], 0)[0] for step in (-1, 0, 1)
    )
    curvature = np.maximum(low - 2 * middle + high, 1e-6)
    return np.asarray(best + np.clip((low - high) / (2 * curvature), -0.5, 0.5))


def _filled(values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Return values with holes filled by the smaller of the valid neighbours left and right."""
    result = values.copy()
    columns = np.arange(values.shape[1])
    for row, known in zip(result, valid, strict=True):
        if not known.any():
            continue
        left = np.maximum.accumulate(np.where(known, columns, -1))
        right = np.minimum.accumulate(np.where(known, columns, len(columns))[::-1])[::-1]
        from_left = np.where(left >= 0, row[np.maximum(left, 0)], np.inf)
        from_right = np.where(right < len(columns), row[np.minimum(right, len(columns) - 1)], np.inf)
        row[~known] = np.minimum(from_left, from_right)[~known]
    return result


def time_of_flight(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth of a time-of-flight camera of a quarter of the resolution.

    A pixel averages depth over all surfaces in it, weighted by their light over the squared distance: flying
    pixels at edges. Noise grows as light falls; dark pixels and the sky fail and take their neighbours'
    depth.
    """
    depth = exact(scene, image)
    light = np.clip(image.mean(-1), 0, 1) / depth**2
    weight = _blocks(light, _TOF_FACTOR)
    mean = _blocks(light * np.minimum(depth, 20), _TOF_FACTOR) / np.maximum(weight, 1e-12)
    amplitude = weight * mean**2
    normal = np.random.default_rng(6).normal(size=mean.shape)
    noise = _TOF_NOISE / np.sqrt(np.clip(amplitude, 0.02, 1)) * normal
    valid = (amplitude > _TOF_MIN_LIGHT) & (weight > 1e-6)
    inverse = _filled(1 / np.maximum(mean * (1 + noise), 0.1), valid)
    return _depth(_resized(inverse, depth.shape))


def upsampled(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return a map of an eighth of the resolution, upsampled by a joint bilateral filter.

    The picture guides the filter: textures of the picture appear in the depth, and edges of equal colours
    are soft.

    Source: Kopf, Cohen, Lischinski and Uyttendaele, "Joint bilateral upsampling", SIGGRAPH 2007.
    """
    inverse = 1 / exact(scene, image)
    coarse, guide = _blocks(inverse, _COARSE_FACTOR), np.clip(image, 0, 1) ** (1 / 2.2)
    colors = _blocks(guide, _COARSE_FACTOR)
    y, x = ((np.arange(n) + 0.5) / _COARSE_FACTOR - 0.5 for n in inverse.shape)
    total, weights = np.zeros(inverse.shape), np.full(inverse.shape, 1e-12)
    for dy in range(-1, 3):
        for dx in range(-1, 3):
            row, column = np.floor(y).astype(int) + dy, np.floor(x).astype(int) + dx
            space = np.exp(-((row - y)[:, None] ** 2 + (column - x)[None] ** 2) / (2 * _SPACE_SIGMA**2))
            at = np.ix_(np.clip(row, 0, coarse.shape[0] - 1), np.clip(column, 0, coarse.shape[1] - 1))
            weight = space * np.exp(-((guide - colors[at]) ** 2).sum(-1) / (2 * _COLOR_SIGMA**2))
            total += weight * coarse[at]
            weights += weight
    return _depth(total / weights)


def monocular(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return a map with the faults of monocular networks: soft edges, thin things lost, a bent space.

    The map is made at half the resolution, thin structures lose a median of five pixels, and inverse depth
    is off by up to 4 % of its range, slowly over the picture.
    """
    inverse = 1 / exact(scene, image)
    half = _median(_blocks(inverse, 2), 5)
    soft = _resized(_box(_box(half, 3), 3), inverse.shape)
    y, x = np.mgrid[-1 : 1 : HEIGHT * 1j, -1 : 1 : WIDTH * 1j]
    bend = 0.04 * np.ptp(inverse) * np.sin(2.1 * x + 1.3 * y)
    return _depth(np.maximum(soft + bend * (soft > 0.02), 0))


def _depth(inverse: np.ndarray) -> np.ndarray:
    return np.asarray(1 / np.maximum(inverse, 1 / SKY_DEPTH))


KINDS: dict[str, Callable[[Scene, np.ndarray], np.ndarray]] = {
    "exact": exact,
    "eight_bit": eight_bit,
    "stereo": stereo,
    "time_of_flight": time_of_flight,
    "upsampled": upsampled,
    "monocular": monocular,
}


def depth_map(kind: str, scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth map of a kind, metres, (H, W), above 0 and at most ``SKY_DEPTH``.

    Args:
        kind: Key of ``KINDS``.
        scene: Scene.
        image: All-in-focus picture of it, scene-linear, (H, W, 3).
    """
    depth = KINDS[kind](scene, image)
    return np.minimum(depth, SKY_DEPTH)
