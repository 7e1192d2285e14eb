"""Multi-pass gather: what is in front of focus and what is behind it are blurred apart, at half the size.

Faults: half resolution where blur begins; within the near and within the far plane nothing stands before
anything else; what a foreground hides is made of its surroundings.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.gather.half_size import doubled, halved
from bokehnet.baselines.gather.nearest_pixel import nearest_pixel
from bokehnet.baselines.gather.spiral import spiral
from bokehnet.baselines.openings import ANGLES, check_baseline, outline
from bokehnet.checks import check_above
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["gather_passes"]

# Coverage by the far plane from which on it is seen in place of what is near.
_ENOUGH = 0.1


@njit(cache=True, parallel=True)
def _gather(plane, blur, points, shape, area, turned, bokeh):  # type: ignore[no-untyped-def]
    """Fill ``bokeh`` with light and coverage of premultiplied pixels, each spread over its own disc.

    A sample stands for ``area`` pixels, and each of these brings one over its own disc's area.
    """
    height, width, channels = plane.shape
    for y in prange(height):
        for x in range(width):
            sums = np.zeros(channels)
            for index in range(-1, points.shape[0]):
                angle, radius, stands = 0.0, 0.0, 0.25 * math.pi
                if index >= 0:
                    angle, radius, stands = points[index, 0], points[index, 1], area
                turn = angle / (2.0 * math.pi) + turned
                reach = radius * shape[int((turn - math.floor(turn)) * ANGLES) % ANGLES]
                row, column = nearest_pixel(
                    y + reach * math.sin(angle), x + reach * math.cos(angle), height, width
                )
                weight = min(max(blur[row, column] - radius + 0.5, 0.0), 1.0) * stands
                weight /= math.pi * max(blur[row, column], 0.5) ** 2
                for c in range(channels):
                    sums[c] += weight * plane[row, column, c]
            for c in range(channels):
                bokeh[y, x, c] = sums[c]


def _blurred(
    image: np.ndarray, blur: np.ndarray, share: np.ndarray, aperture: Aperture, scale: float, turned: float
) -> tuple[np.ndarray, np.ndarray]:
    """Colours (H, W, 3) and coverage (H, W) of one plane, blurred at half the size."""
    plane = halved(np.dstack([image * share[..., None], share]).astype(np.float32))
    radius = halved(blur * share) / np.maximum(plane[..., 3], 1e-6) / 2
    points = spiral(float(radius.max()) + 0.5, scale)
    sums = np.empty_like(plane)
    with parallel_region:
        _gather(
            plane, radius.astype(np.float32), points, outline(aperture), 2 * math.pi * scale, turned, sums
        )
    sums = doubled(sums, *blur.shape)
    return sums[..., :3] / np.maximum(sums[..., 3:], 1e-6), np.minimum(sums[..., 3], 1)


def gather_passes(
    image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None = None, *, scale: float = 0.25
) -> np.ndarray:
    """Render by the multi-pass gather.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Its outline shapes the samples; default a disc.
        scale: Of the spiral, in pixels of half the size.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Thesis 004, 2.2.3, "Multi pass": near and far plane, scaled down, blurred apart. How they are put
        together again it does not say: here the far plane covers what is sharp as far as its pixels are
        blurred, and what is near where any of its light arrives there; the near plane covers both by the
        light that arrives of it.
    """
    check_above("scale", scale, 0)
    image, defocus, aperture = check_baseline("gather_passes", "outline", image, defocus, aperture)
    bokeh = image
    behind, before = np.clip(-defocus - 0.5, 0, 1), np.clip(defocus - 0.5, 0, 1)
    if behind.any():
        far, alpha = _blurred(image, np.maximum(-defocus, 0), behind, aperture, scale, 0.0)
        share = np.maximum(behind, before * np.minimum(alpha / _ENOUGH, 1))
        bokeh = bokeh + share[..., None] * (far - bokeh)
    if before.any():
        near, alpha = _blurred(image, np.maximum(defocus, 0), before, aperture, scale, 0.5)
        bokeh = bokeh + alpha[..., None] * (near - bokeh)
    return np.asarray(bokeh, np.float32) if bokeh is not image else image.copy()
