"""Multi-pass gather: near and far plane are blurred separately, at half size.

Faults: half resolution where blur begins; no order within the near or the far plane; occluded background is
    filled in from its surroundings.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import ANGLES, check_baseline, outline
from bokehnet.baselines.gather.half_size import doubled, halved
from bokehnet.baselines.gather.nearest_pixel import nearest_pixel
from bokehnet.baselines.gather.spiral import spiral
from bokehnet.checks import check_above
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["gather_passes"]

# Coverage by the far plane at which it fully replaces near pixels.
_FULL_COVERAGE = 0.1


@njit(cache=True, parallel=True)
def _gather(plane, blur, points, shape, area, rotation, bokeh):
    """Fill ``bokeh`` with premultiplied light and coverage of pixels, each spread over its own disc.

    A sample represents ``area`` pixels, each with a weight of one over its disc's area.
    """
    height, width, channels = plane.shape
    for y in prange(height):
        for x in range(width):
            sums = np.zeros(channels)
            for index in range(-1, points.shape[0]):
                angle, radius, represented = 0.0, 0.0, 0.25 * math.pi
                if index >= 0:
                    angle, radius, represented = points[index, 0], points[index, 1], area
                fraction = angle / (2.0 * math.pi) + rotation
                reach = radius * shape[int((fraction - math.floor(fraction)) * ANGLES) % ANGLES]
                row, column = nearest_pixel(
                    y + reach * math.sin(angle), x + reach * math.cos(angle), height, width
                )
                weight = min(max(blur[row, column] - radius + 0.5, 0.0), 1.0) * represented
                weight /= math.pi * max(blur[row, column], 0.5) ** 2
                for c in range(channels):
                    sums[c] += weight * plane[row, column, c]
            for c in range(channels):
                bokeh[y, x, c] = sums[c]


def _blurred(
    image: np.ndarray,
    blur: np.ndarray,
    coverage: np.ndarray,
    aperture: Aperture,
    scale: float,
    rotation: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return colours (H, W, 3) and coverage (H, W) of one plane, blurred at half size."""
    plane = halved(np.dstack([image * coverage[..., None], coverage]).astype(np.float32))
    radius = halved(blur * coverage) / np.maximum(plane[..., 3], 1e-6) / 2
    points = spiral(float(radius.max()) + 0.5, scale)
    sums = np.empty_like(plane)
    with parallel_region:
        _gather(
            plane, radius.astype(np.float32), points, outline(aperture), 2 * math.pi * scale, rotation, sums
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
        aperture: Aperture whose outline shapes the samples; default: disc.
        scale: Scale of the spiral, half-size pixels.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Thesis 004, 2.2.3, "Multi pass": near and far plane, downscaled, blurred separately. It does not
            describe their composition: here the far plane replaces sharp pixels according to their blur, and
            near pixels where its light arrives; the near plane covers both with its own coverage.
    """
    check_above("scale", scale, 0)
    image, defocus, aperture = check_baseline("gather_passes", "outline", image, defocus, aperture)
    bokeh = image
    behind, front = np.clip(-defocus - 0.5, 0, 1), np.clip(defocus - 0.5, 0, 1)
    if behind.any():
        far, alpha = _blurred(image, np.maximum(-defocus, 0), behind, aperture, scale, 0.0)
        mix = np.maximum(behind, front * np.minimum(alpha / _FULL_COVERAGE, 1))
        bokeh = bokeh + mix[..., None] * (far - bokeh)
    if front.any():
        near, alpha = _blurred(image, np.maximum(defocus, 0), front, aperture, scale, 0.5)
        bokeh = bokeh + alpha[..., None] * (near - bokeh)
    return np.asarray(bokeh, np.float32) if bokeh is not image else image.copy()
