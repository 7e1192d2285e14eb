"""Bokeh gather: samples spread over the shape of the opening, squeezed towards the corners as a cat's-eye.

Faults: halos, as the blur of a background shrinks towards a foreground; a blurred foreground stays visible
inside its own blur; the pattern of the samples shows where they are few.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.gather.nearest_pixel import nearest_pixel
from bokehnet.baselines.gather.spiral import GOLDEN_ANGLE
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.baselines.openings import ANGLES, check_baseline, outline
from bokehnet.checks import check_whole
from bokehnet.classical.base import Place
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture

__all__ = ["gather_bokeh", "squeezed"]

# Side of the tiles that share one spread of samples, pixels.
_TILE = 32


@njit(cache=True)
def squeezed(across, down, from_column, from_row, narrower):  # type: ignore[no-untyped-def]
    """Scale (across, down) by ``1 - narrower`` along the line to the picture's middle.

    The listing turns by an angle, scales x, and turns back; with n the direction from the middle that product
    is ``p - narrower (p.n) n``, which has no angle whose sign has to be mended.
    """
    length = math.sqrt(from_column * from_column + from_row * from_row)
    if length == 0.0:
        return across, down
    along = narrower * (across * from_column + down * from_row) / (length * length)
    return across - along * from_column, down - along * from_row


@njit(cache=True, parallel=True)
def _gather(image, defocus, offsets, reach, size, frame, cats_eye, bokeh):  # type: ignore[no-untyped-def]
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
                across, down = squeezed(offsets[index, 0], offsets[index, 1], from_column, from_row, narrower)
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


def gather_bokeh(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    samples: int = 512,
    place: Place | None = None,
) -> np.ndarray:
    """Render by the bokeh gather.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Its outline shapes the samples; its cat's-eye s squeezes them to 1 - s / 2 in the corners,
            the width that two discs s apart have in common. Default a disc.
        samples: Over the largest blur of a tile of 32 pixels and its neighbours, from 1 up.
        place: Where the pixels lie in the shown picture; default: all of it.

    Returns:
        Picture (H, W, 3), float32.

    Source:
        Thesis 004, 2.3.1 (eq. 2.2) and 2.3.2 (the matrix). It prints no listing of the gather and says only
        that it differs from the spiral's; here it is a mean in which each sample weighs by whether its own
        blur, clamped to the pixel's where it lies behind it, covers the pixel, and by one over that blur's
        area. It has the faults that the thesis shows.
    """
    check_whole("samples", samples, 1)
    image, defocus, aperture = check_baseline("gather_bokeh", "cats-eye", image, defocus, aperture)
    index = np.arange(1, samples + 1)
    angle, rho = index * GOLDEN_ANGLE, np.sqrt(index / samples)
    shape = outline(aperture)[(angle / (2 * math.pi) % 1 * ANGLES).astype(int) % ANGLES]
    offsets = np.stack([rho * shape * np.cos(angle), rho * shape * np.sin(angle), rho], -1)
    frame = (place or Place.whole(*defocus.shape)).frame
    bokeh = np.empty_like(image)
    with parallel_region:
        _gather(
            image,
            defocus,
            offsets.astype(np.float32),
            np.maximum(dilated_tiles(defocus, _TILE)[1], 0.5),
            _TILE,
            (float(frame.column), float(frame.row), float(frame.scale)),
            float(aperture.cats_eye),
            bokeh,
        )
    return bokeh
