"""Gather and scatter by layers, as in Unreal Engine: far and near at half the size, bright lights as sprites.

Faults: half resolution; what a foreground hides is the mirror of what lies opposite; which lights become
sprites is a threshold, so they come and go; no order within a layer.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.gather.half_size import doubled, halved
from bokehnet.baselines.gather.scatter_as_you_gather import ring_taps, sample_alpha
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.baselines.openings import ANGLES, check_baseline, outline, psf_image
from bokehnet.checks import check_above, check_whole
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["abadie", "part_lights"]

# Side of a tile at half size, pixels.
_TILE = 16


def part_lights(light: np.ndarray, coc: np.ndarray, above: float) -> tuple[np.ndarray, np.ndarray]:
    """Take bright lights out of a picture: what stands above ``above`` times the mean of 3x3 pixels.

    Args:
        light: Scene-linear, (H, W, 3).
        coc: Signed blur radius, (H, W); lights smaller than a pixel stay.
        above: From 1 up.

    Returns:
        The picture without them, and them alone; they add up to the picture.
    """
    height, width = coc.shape
    padded = np.pad(light, ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = sum(padded[i : i + height, j : j + width] for i in range(3) for j in range(3))
    around = (around - light) / 8
    luma = np.array([0.2126, 0.7152, 0.0722], np.float32)
    bright = ((light @ luma) > above * (around @ luma)) & (np.abs(coc) > 1)
    lights = np.where(bright[..., None], np.maximum(light - around, 0), 0)
    return light - lights, lights


@njit(cache=True, parallel=True)
def _gather(light, coc, largest, size, rings, taps, shape, near, result):  # type: ignore[no-untyped-def]
    """Fill ``result`` with one layer's colours times coverage, and coverage.

    Taps of the far layer that fall on nearer pixels are taken from the opposite side of the kernel. Where a
    nearer pixel itself stands before it, all taps that lie behind count alike: what it hides is made of them.
    """
    rows, columns, _ = light.shape
    side = 1.0 if near else -1.0
    for y in prange(rows):
        for x in range(columns):
            reach = largest[y // size, x // size]
            hidden = not near and coc[y, x] > 0.0
            if hidden:
                reach = max(reach, coc[y, x])
            sums = np.zeros(4)
            area = math.pi * reach * reach / taps.shape[0]
            for index in range(taps.shape[0]):
                angle, distance = taps[index, 0], taps[index, 1] * reach * rings / (rings + 0.5)
                turn = angle / (2.0 * math.pi) + (0.5 if near else 0.0)
                away = distance * shape[int((turn - math.floor(turn)) * ANGLES) % ANGLES]
                down, across = away * math.sin(angle), away * math.cos(angle)
                row = min(max(int(math.floor(y + down + 0.5)), 0), rows - 1)
                column = min(max(int(math.floor(x + across + 0.5)), 0), columns - 1)
                if not near and coc[row, column] > 0.0:
                    row = min(max(int(math.floor(y - down + 0.5)), 0), rows - 1)
                    column = min(max(int(math.floor(x - across + 0.5)), 0), columns - 1)
                radius = side * coc[row, column]
                if radius < 0.0 or (radius == 0.0 and not hidden):
                    continue
                weight = min(max(radius - distance + 0.5, 0.0), 1.0) * sample_alpha(radius)
                weight *= min(radius / 0.5, 1.0)
                if hidden:
                    weight = 1.0
                for c in range(3):
                    sums[c] += weight * light[row, column, c]
                sums[3] += weight
            for c in range(4):
                result[y, x, c] = sums[c] * area


def _layer(
    light: np.ndarray, coc: np.ndarray, shape: np.ndarray, rings: int, near: bool
) -> np.ndarray | None:
    """Light times coverage and coverage of one layer, (h, w, 4); None where nothing lies in it."""
    inside = np.maximum(coc, 0) if near else np.minimum(coc, 0)
    if not coc.any() or (near and not inside.any()):
        return None
    _, largest = dilated_tiles(inside, _TILE)
    result = np.empty((*coc.shape, 4), np.float32)
    with parallel_region:
        _gather(light, coc, np.maximum(largest, 0.5), _TILE, rings, ring_taps(rings), shape, near, result)
    return result


def _splat(lights: np.ndarray, coc: np.ndarray, aperture: Aperture, near: bool) -> np.ndarray:
    """Each light as the image of the opening; (h, w, 3)."""
    side = 1 if near else -1
    found = np.zeros_like(lights)
    height, width = coc.shape
    for y, x in np.argwhere(lights.any(axis=2) & (side * coc > 0)):
        image = psf_image(aperture, round(4 * abs(float(coc[y, x]))) / 4, side)
        half = len(image) // 2
        top, left = max(y - half, 0), max(x - half, 0)
        bottom, right = min(y + half + 1, height), min(x + half + 1, width)
        part = image[top - y + half : bottom - y + half, left - x + half : right - x + half]
        found[top:bottom, left:right] += part[..., None] * lights[y, x]
    return found


def abadie(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    rings: int = 6,
    bright: float = 3.0,
) -> np.ndarray:
    """Render by layers, gathered and, where bright, scattered.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Its outline shapes rings and sprites; default a disc.
        rings: Of taps, from 1 up: 1 + 4 rings (rings + 1) of them.
        bright: How many times its surroundings a light is that becomes a sprite, from 1 up.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Abadie, "A life of a bokeh", SIGGRAPH courses 2018, as thesis 000, 3.7, tells it: two layers at half
        size, gather and scatter, mirrored taps for what is hidden. Its ring buckets and its upsampling with
        recombined sharp taps are not told there and not here.
    """
    check_whole("rings", rings, 1)
    check_above("bright", bright, 1)
    image, defocus, aperture = check_baseline("abadie", "outline", image, defocus, aperture)
    light, coc = halved(image), halved(defocus) / np.float32(2)
    light, lights = part_lights(light, coc, bright)
    shape = outline(aperture)
    size = defocus.shape
    bokeh = image.astype(np.float32)
    far = _layer(light, coc, shape, rings, near=False)
    if far is not None:
        found = (far[..., 3:] > 0).astype(np.float32)
        colours = far[..., :3] / np.maximum(far[..., 3:], 1e-6) + _splat(lights, coc, aperture, near=False)
        both = doubled(np.dstack([colours * found, found]), *size)
        share = np.clip(np.abs(defocus) - 0.5, 0, 1)[..., None] * (both[..., 3:] > 1e-3)
        bokeh += share * (both[..., :3] / np.maximum(both[..., 3:], 1e-3) - bokeh)
    near = _layer(light, coc, shape, rings, near=True)
    if near is not None:
        alpha = np.minimum(near[..., 3:], 1)
        colours = near[..., :3] / np.maximum(near[..., 3:], 1e-6)
        both = doubled(np.dstack([colours * alpha + _splat(lights, coc, aperture, near=True), alpha]), *size)
        bokeh += both[..., :3] - both[..., 3:] * bokeh
    return bokeh
