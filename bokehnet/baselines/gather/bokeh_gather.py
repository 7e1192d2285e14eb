"""Bokeh gather: samples in the shape of the aperture, narrowed to a cat's-eye towards the corners.

Faults: halos, as the blur of a background shrinks towards a foreground; a blurred foreground stays visible
    inside its own blur; a visible pattern with few samples.
"""

import math

import numpy as np
from numba import prange

from bokehnet.arrays.viewport import Viewport
from bokehnet.baselines.apertures import ANGLES, check_baseline, outline
from bokehnet.baselines.gather.nearest_pixel import nearest_pixel
from bokehnet.baselines.gather.resolution import with_resolution
from bokehnet.baselines.gather.spiral import GOLDEN_ANGLE
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.checks import check_whole
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["gather_bokeh", "squeeze_cats_eye"]

# Side of the tiles that share one sample radius, pixels.
_TILE_PX = 32


@njit(cache=True)
def squeeze_cats_eye(across, down, from_column, from_row, narrower):
    """Scale (across, down) by ``1 - narrower`` along the line to the picture centre.

    The listing rotates by an angle, scales x, and rotates back; with n the direction from the centre the
    product is ``p - narrower (p.n) n``, which avoids the sign of the angle.
    """
    length = math.sqrt(from_column * from_column + from_row * from_row)
    if length == 0.0:
        return across, down
    along = narrower * (across * from_column + down * from_row) / (length * length)
    return across - along * from_column, down - along * from_row


@njit(cache=True, parallel=True)
def _gather(image, defocus, offsets, reach, size, frame, cats_eye, bokeh):
    height, width, _ = image.shape
    column_0, row_0, scale = frame
    for y in prange(height):
        for x in range(width):
            largest = reach[y // size, x // size]
            area = math.pi * largest * largest / offsets.shape[0]
            centre = defocus[y, x]
            total = min(area / (math.pi * max(abs(centre), 0.5) ** 2), 1.0)
            red, green, blue = total * image[y, x, 0], total * image[y, x, 1], total * image[y, x, 2]
            from_column, from_row = x - column_0, y - row_0
            field = scale * math.sqrt(from_column * from_column + from_row * from_row)
            narrower = 0.5 * cats_eye * field
            for index in range(offsets.shape[0]):
                across, down = squeeze_cats_eye(
                    offsets[index, 0], offsets[index, 1], from_column, from_row, narrower
                )
                row, column = nearest_pixel(y + largest * down, x + largest * across, height, width)
                blur = abs(defocus[row, column])
                if defocus[row, column] < centre:
                    blur = min(blur, abs(centre))
                weight = min(max(blur - largest * offsets[index, 2] + 0.5, 0.0), 1.0)
                weight *= min(area / (math.pi * max(blur, 0.5) ** 2), 1.0)
                red += weight * image[row, column, 0]
                green += weight * image[row, column, 1]
                blue += weight * image[row, column, 2]
                total += weight
            bokeh[y, x, 0] = red / total
            bokeh[y, x, 1] = green / total
            bokeh[y, x, 2] = blue / total


@with_resolution
def gather_bokeh(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    samples: int = 512,
    viewport: Viewport | None = None,
) -> np.ndarray:
    """Render by the bokeh gather.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Aperture whose outline shapes the samples; its cat's-eye s narrows them to 1 - s / 2 in the
            corners, the width of the intersection of two discs at distance s. Default: disc.
        samples: Number of samples over the maximum blur of a tile of 32 pixels and its neighbours, at least
            1.
        viewport: Position of the pixels in the full picture; default: the whole picture.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Thesis 004, 2.3.1 (eq. 2.2) and 2.3.2 (the matrix). It gives no listing of the gather and says only
        that it differs from the spiral's; here each sample is weighted by the coverage of the pixel by the
        sample's blur, clamped to the pixel's blur for samples behind it, and by one over that blur's area.
        The result has the faults that the thesis shows.
    """
    check_whole("samples", samples, 1)
    image, defocus, aperture = check_baseline("gather_bokeh", "cats-eye", image, defocus, aperture)
    index = np.arange(1, samples + 1)
    angle, rho = index * GOLDEN_ANGLE, np.sqrt(index / samples)
    shape = outline(aperture)[(angle / (2 * math.pi) % 1 * ANGLES).astype(int) % ANGLES]
    offsets = np.stack([rho * shape * np.cos(angle), rho * shape * np.sin(angle), rho], -1)
    frame = (viewport or Viewport.whole(*defocus.shape)).frame
    bokeh = np.empty_like(image)
    with parallel_region:
        _gather(
            image,
            defocus,
            offsets.astype(np.float32),
            np.maximum(dilated_tiles(defocus, _TILE_PX)[1], 0.5),
            _TILE_PX,
            (float(frame.column), float(frame.row), float(frame.scale)),
            float(aperture.cats_eye),
            bokeh,
        )
    return bokeh
