"""Layered gather and scatter, as in Unreal Engine: near and far at half size, bright lights as sprites.

Faults: half resolution; occluded background is the mirror image of the opposite side; a threshold selects the
    sprites, so they flicker; no order within a layer.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import ANGLES, check_baseline, outline, psf_image
from bokehnet.baselines.gather.half_size import doubled, halved
from bokehnet.baselines.gather.scatter_as_you_gather import ring_taps, sample_alpha
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.checks import check_above, check_whole
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["abadie", "split_lights"]

# Side of a tile at half size, pixels.
_TILE_PX = 16


def split_lights(light: np.ndarray, coc: np.ndarray, above: float) -> tuple[np.ndarray, np.ndarray]:
    """Split bright lights from a picture: pixels above ``above`` times the mean of their neighbours.

    Args:
        light: Scene-linear picture, (H, W, 3).
        coc: Signed blur radius, pixels, (H, W); lights with a blur below a pixel stay.
        above: Threshold relative to the neighbours, at least 1.

    Returns:
        The picture without lights, and the lights; their sum is the input.
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
def _gather(light, coc, largest, size, rings, taps, shape, near, result):
    """Fill ``result`` with one layer's premultiplied colours and coverage.

    Taps of the far layer that fall on nearer pixels are mirrored to the opposite side of the kernel. At a
    pixel that a nearer one occludes, all taps behind focus have equal weight: they fill in the occluded
    background.
    """
    rows, columns, _ = light.shape
    side = 1.0 if near else -1.0
    for y in prange(rows):
        for x in range(columns):
            reach = largest[y // size, x // size]
            occluded = not near and coc[y, x] > 0.0
            if occluded:
                reach = max(reach, coc[y, x])
            sums = np.zeros(4)
            area = math.pi * reach * reach / taps.shape[0]
            for index in range(taps.shape[0]):
                angle, distance = taps[index, 0], taps[index, 1] * reach * rings / (rings + 0.5)
                fraction = angle / (2.0 * math.pi) + (0.5 if near else 0.0)
                radial = distance * shape[int((fraction - math.floor(fraction)) * ANGLES) % ANGLES]
                down, across = radial * math.sin(angle), radial * math.cos(angle)
                row = min(max(int(math.floor(y + down + 0.5)), 0), rows - 1)
                column = min(max(int(math.floor(x + across + 0.5)), 0), columns - 1)
                if not near and coc[row, column] > 0.0:
                    row = min(max(int(math.floor(y - down + 0.5)), 0), rows - 1)
                    column = min(max(int(math.floor(x - across + 0.5)), 0), columns - 1)
                radius = side * coc[row, column]
                if radius < 0.0 or (radius == 0.0 and not occluded):
                    continue
                weight = min(max(radius - distance + 0.5, 0.0), 1.0) * sample_alpha(radius)
                weight *= min(radius / 0.5, 1.0)
                if occluded:
                    weight = 1.0
                for c in range(3):
                    sums[c] += weight * light[row, column, c]
                sums[3] += weight
            for c in range(4):
                result[y, x, c] = sums[c] * area


def _layer(
    light: np.ndarray, coc: np.ndarray, shape: np.ndarray, rings: int, near: bool
) -> np.ndarray | None:
    """Return premultiplied light and coverage of one layer, (h, w, 4), or None if the layer is empty."""
    inside = np.maximum(coc, 0) if near else np.minimum(coc, 0)
    if not coc.any() or (near and not inside.any()):
        return None
    _, largest = dilated_tiles(inside, _TILE_PX)
    result = np.empty((*coc.shape, 4), np.float32)
    with parallel_region:
        _gather(light, coc, np.maximum(largest, 0.5), _TILE_PX, rings, ring_taps(rings), shape, near, result)
    return result


def _splat(lights: np.ndarray, coc: np.ndarray, aperture: Aperture, near: bool) -> np.ndarray:
    """Return each light spread as the image of the aperture, (h, w, 3)."""
    side = 1 if near else -1
    sprites = np.zeros_like(lights)
    height, width = coc.shape
    for y, x in np.argwhere(lights.any(axis=2) & (side * coc > 0)):
        image = psf_image(aperture, round(4 * abs(float(coc[y, x]))) / 4, side)
        half = len(image) // 2
        top, left = max(y - half, 0), max(x - half, 0)
        bottom, right = min(y + half + 1, height), min(x + half + 1, width)
        part = image[top - y + half : bottom - y + half, left - x + half : right - x + half]
        sprites[top:bottom, left:right] += part[..., None] * lights[y, x]
    return sprites


def abadie(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    rings: int = 6,
    bright: float = 3.0,
) -> np.ndarray:
    """Render by gathered layers, with bright lights as scattered sprites.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Aperture whose outline shapes rings and sprites; default: disc.
        rings: Number of rings, at least 1, with 1 + 4 rings (rings + 1) taps in total.
        bright: Threshold of sprites relative to their neighbours, at least 1.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Abadie, "A life of a bokeh", SIGGRAPH courses 2018, after thesis 000, 3.7: two layers at half size,
        gather and scatter, mirrored taps for the occluded background. The thesis does not describe its ring
        buckets and its upsampling with recombined sharp taps, which are omitted here.
    """
    check_whole("rings", rings, 1)
    check_above("bright", bright, 1)
    image, defocus, aperture = check_baseline("abadie", "outline", image, defocus, aperture)
    light, coc = halved(image), halved(defocus) / np.float32(2)
    light, lights = split_lights(light, coc, bright)
    shape = outline(aperture)
    size = defocus.shape
    bokeh = image.astype(np.float32)
    far = _layer(light, coc, shape, rings, near=False)
    if far is not None:
        covered = (far[..., 3:] > 0).astype(np.float32)
        colours = far[..., :3] / np.maximum(far[..., 3:], 1e-6) + _splat(lights, coc, aperture, near=False)
        upsampled = doubled(np.dstack([colours * covered, covered]), *size)
        mix = np.clip(np.abs(defocus) - 0.5, 0, 1)[..., None] * (upsampled[..., 3:] > 1e-3)
        bokeh += mix * (upsampled[..., :3] / np.maximum(upsampled[..., 3:], 1e-3) - bokeh)
    near = _layer(light, coc, shape, rings, near=True)
    if near is not None:
        alpha = np.minimum(near[..., 3:], 1)
        colours = near[..., :3] / np.maximum(near[..., 3:], 1e-6)
        upsampled = doubled(
            np.dstack([colours * alpha + _splat(lights, coc, aperture, near=True), alpha]), *size
        )
        bokeh += upsampled[..., :3] - upsampled[..., 3:] * bokeh
    return bokeh
