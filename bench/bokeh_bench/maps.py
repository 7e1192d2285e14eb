"""Depth maps as real estimators make them, from the scene itself.

Each function returns the depth in metres, (H, W). The faults come from how an estimator works, not from
noise that is added to an exact map: the stereo matchers compare two rendered pictures, the time-of-flight
camera averages light over its large pixels, the laser scanner sees few points from another place, the
upsampling sees a coarse map and the sharp picture.
"""

from collections.abc import Callable

import numpy as np

from bokeh_bench.filters import blocks, box, dilated, filled, median, resized
from bokeh_bench.scenes import HEIGHT, WIDTH, Scene, camera
from bokeh_bench.stereo import block_matching, semi_global
from bokeh_bench.tracing import SKY_DEPTH, pinhole_depth, trace

__all__ = ["KINDS", "depth_map"]

# Factor of the resolution of the time-of-flight camera, its relative noise and its least usable light.
_TOF_FACTOR, _TOF_NOISE, _TOF_MIN_LIGHT = 4, 0.01, 0.02

# Factor of the coarse map that is upsampled, and sigmas of the joint bilateral filter, coarse pixels and
# colour.
_COARSE_FACTOR, _SPACE_SIGMA, _COLOR_SIGMA = 8, 0.7, 0.1

# Laser scanner: degrees between two points across and down, half of its view, metres above the camera, metres
# of noise along a ray, least light of a surface that answers.
_LASER_ACROSS, _LASER_DOWN, _LASER_HALF_VIEW = 0.4, 0.5, 26.0
_LASER_HEIGHT, _LASER_NOISE, _LASER_MIN_LIGHT = 0.05, 0.01, 0.03


def exact(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth at the pixels' centres."""
    return pinhole_depth(scene.surfaces, scene.sky, camera())


def eight_bit(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the exact inverse depth in 256 levels."""
    inverse = 1 / exact(scene, image)
    low, high = inverse.min(), inverse.max()
    return _depth(low + np.round(255 * (inverse - low) / (high - low)) / 255 * (high - low))


def stereo(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth of block matching between this picture and one from the right."""
    return _depth(block_matching(scene, image))


def semi_global_stereo(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth of semi-global matching between the same two pictures."""
    return _depth(semi_global(scene, image))


def laser_points(scene: Scene) -> np.ndarray:
    """Return the picture of the inverse depths that a laser scanner above the camera measures, (H, W).

    The scanner sees behind foregrounds, so that points of both fall side by side on them; of two points of
    one pixel the nearer stays. Dark surfaces and the sky send nothing back. 0 is a pixel without a point.
    """
    columns, rows = (
        np.arange(-_LASER_HALF_VIEW, _LASER_HALF_VIEW, step) for step in (_LASER_ACROSS, _LASER_DOWN)
    )
    slope = np.stack(np.meshgrid(np.tan(np.radians(columns)), np.tan(np.radians(rows))), -1).reshape(-1, 2)
    origin = np.broadcast_to([0.0, -_LASER_HEIGHT], slope.shape)
    color, z, index = trace(scene.surfaces, scene.sky, origin, slope)
    z = np.where(index >= 0, z, 1.0)
    point = np.c_[origin + slope * z[:, None], z]
    noise = 1 + np.random.default_rng(8).normal(size=len(z)) * _LASER_NOISE / np.linalg.norm(point, axis=1)
    size = np.array([WIDTH, HEIGHT])
    pixel = np.floor(point[:, :2] / point[:, 2:] / camera().slope + size / 2).astype(int)
    valid = (index >= 0) & (color.mean(-1) > _LASER_MIN_LIGHT) & ((pixel >= 0) & (pixel < size)).all(1)
    result = np.zeros((HEIGHT, WIDTH))
    x, y = pixel[valid].T
    np.maximum.at(result, (y, x), 1 / (z * noise)[valid])
    return result


def sparse(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth of a laser scanner, some 7 % of the pixels, made dense by morphology alone.

    Nearer points win: foregrounds grow and outlines are those of the filter, gaps between thin things close,
    and the sky takes the depth of what is below or beside it.

    Source: Ku, Harakeh and Waslander, "In defense of classical image processing: Fast depth completion on the
    CPU", CRV 2018.
    """
    points = laser_points(scene)
    rows = np.pad(points, 2)
    diamond = np.max(
        [
            rows[2 + dy : 2 + dy + HEIGHT, 2 + dx : 2 + dx + WIDTH]
            for dy in range(-2, 3)
            for dx in range(-2, 3)
            if abs(dy) + abs(dx) <= 2
        ],
        axis=0,
    )
    dense = -dilated(-dilated(diamond, 5), 5)
    dense = np.where(dense > 0, dense, dilated(dense, 7))
    # Empty pixels above the uppermost point of a column take its depth.
    top = (dense > 0).argmax(0)
    above = np.arange(HEIGHT)[:, None] < top
    dense = np.where(above, np.take_along_axis(dense, top[None], 0), dense)
    while (empty := dense <= 0).any():
        dense = np.where(empty, dilated(dense, 31), dense)
    return _depth(box(median(dense, 5), 3))


def time_of_flight(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the depth of a time-of-flight camera of a quarter of the resolution.

    A pixel averages depth over all surfaces in it, weighted by their light over the squared distance: flying
    pixels at edges. Noise grows as light falls; dark pixels and the sky fail and take their neighbours'
    depth.
    """
    depth = exact(scene, image)
    light = np.clip(image.mean(-1), 0, 1) / depth**2
    weight = blocks(light, _TOF_FACTOR)
    mean = blocks(light * np.minimum(depth, 20), _TOF_FACTOR) / np.maximum(weight, 1e-12)
    amplitude = weight * mean**2
    normal = np.random.default_rng(6).normal(size=mean.shape)
    noise = _TOF_NOISE / np.sqrt(np.clip(amplitude, 0.02, 1)) * normal
    valid = (amplitude > _TOF_MIN_LIGHT) & (weight > 1e-6)
    inverse = filled(1 / np.maximum(mean * (1 + noise), 0.1), valid)
    return _depth(resized(inverse, depth.shape))


def upsampled(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return a map of an eighth of the resolution, upsampled by a joint bilateral filter.

    The picture guides the filter: textures of the picture appear in the depth, and edges of equal colours
    are soft.

    Source: Kopf, Cohen, Lischinski and Uyttendaele, "Joint bilateral upsampling", SIGGRAPH 2007.
    """
    inverse = 1 / exact(scene, image)
    coarse, guide = blocks(inverse, _COARSE_FACTOR), np.clip(image, 0, 1) ** (1 / 2.2)
    colors = blocks(guide, _COARSE_FACTOR)
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
    half = median(blocks(inverse, 2), 5)
    soft = resized(box(box(half, 3), 3), inverse.shape)
    y, x = np.mgrid[-1 : 1 : HEIGHT * 1j, -1 : 1 : WIDTH * 1j]
    bend = 0.04 * np.ptp(inverse) * np.sin(2.1 * x + 1.3 * y)
    return _depth(np.maximum(soft + bend * (soft > 0.02), 0))


def _depth(inverse: np.ndarray) -> np.ndarray:
    return np.asarray(1 / np.maximum(inverse, 1 / SKY_DEPTH))


KINDS: dict[str, Callable[[Scene, np.ndarray], np.ndarray]] = {
    "exact": exact,
    "eight_bit": eight_bit,
    "stereo": stereo,
    "semi_global": semi_global_stereo,
    "time_of_flight": time_of_flight,
    "sparse": sparse,
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
