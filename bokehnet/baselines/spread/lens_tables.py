"""Every pixel spreads the point spread function of a lens at its place and its blur, clipped by the barrel.

The tables are images of points at a few places of the picture and at a ladder of defocus, as the rays of the
lens draw them (:mod:`bokehnet.classical.highlights.aberrated_psf`); a pixel mixes those of the four places
around it and of the two rungs beside it.

Faults: foreground and background mix without order; slow, as no sum is shared; between the places of two
tables a disc is the mixture of both.

Source: thesis 001, 3.3.2, "PSFs of lenses": spreading with tables of a lens of prescription.
"""

import numpy as np

from bokehnet.baselines.openings import check_baseline
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.classical.base import Place
from bokehnet.classical.highlights.aberrated_psf import AberratedPsf
from bokehnet.classical.parallel import parallel_region
from bokehnet.errors import ParameterError
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture

__all__ = ["lens_spreading"]

# Places of tables along the longer side; steps of the ladder in pixels and in parts of the radius.
_PLACES, _STEP, _RATIO = 13, 0.5, 0.06

# Largest blur radius, pixels: beyond it the tables take gigabytes.
_LARGEST = 64.0


def lens_spreading(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    lens_response: LensResponse | None = None,
) -> np.ndarray:
    """Spread all pixels, not lights alone, as a lens does.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any without a cat's-eye; default a disc.
        lens_response: Aberrations, barrel and colours; default: a perfect lens.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ParameterError: Blur of more than 64 pixels.

    Source:
        Thesis 001, 3.3.2.
    """
    image, defocus, aperture = check_baseline("lens_spreading", "any", image, defocus, aperture)
    largest = float(np.abs(defocus).max())
    if largest > _LARGEST:
        expected = f"blur radii of at most {_LARGEST:g} pixels, for which tables are made"
        raise ParameterError("defocus", expected, largest, "use the engine `rays`")
    height, width = defocus.shape
    spacing = max(8.0, (max(height, width) - 1) / (_PLACES - 1))
    columns, rows = (np.unique(np.arange(0, size - 1 + spacing, spacing).round()) for size in (width, height))
    lens_response = lens_response or LensResponse()
    if lens_response.is_ideal:  # the same everywhere
        columns, rows = columns[:1], rows[:1]
    ladder = _ladder(float(defocus.min()), float(defocus.max()))
    rung, row, column = (axis.ravel() for axis in np.meshgrid(ladder, rows, columns, indexing="ij"))
    lights = np.ones((len(rung), 8))
    lights[:, 0], lights[:, 1], lights[:, 2] = column, row, rung
    tables, starts, halves = _tables(aperture, lens_response, lights, (height, width))
    sums, weights = np.zeros((height, width, 3)), np.zeros((height, width, 3))
    _spread(image, defocus, columns, rows, ladder, tables, starts, halves, sums, weights)
    return normalised(sums, weights, image)


def _ladder(low: float, high: float) -> np.ndarray:
    """Rungs of defocus that enclose all from ``low`` to ``high``, 0 among them; at least two."""
    radii = [0.0]
    while radii[-1] <= max(-low, high):
        radii.append(radii[-1] + max(_STEP, _RATIO * radii[-1]))
    both = np.array([-r for r in radii[:0:-1]] + radii)
    first, last = np.searchsorted(both, low, side="right") - 1, np.searchsorted(both, high)
    return both[first : max(last, first + 1) + 1]


def _tables(
    aperture: Aperture, lens_response: LensResponse, lights: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Square images of points, (pixels, 3), each channel of sum 1; where each begins, and half its side."""
    psf = AberratedPsf(aperture, lens_response, lights, Place.whole(*shape).frame)
    halves = np.ceil(psf.margins.max(axis=1)).astype(np.int64) + 1
    middle = lights[:, :2].astype(np.int64)
    column, row = middle[:, 0], middle[:, 1]
    boxes = np.stack([row - halves, row + halves + 1, column - halves, column + halves + 1], 1)
    sides = 2 * halves + 1
    starts = np.concatenate([[0], np.cumsum(sides**2)])
    images = np.zeros((starts[-1], psf.planes), np.float32)
    with parallel_region:
        psf.fill(np.arange(len(lights)), boxes, starts[:-1], images)
    tables = np.ascontiguousarray(images[:, :3], np.float64)
    tables /= np.repeat(np.maximum(np.add.reduceat(tables, starts[:-1]), 1e-12), sides**2, axis=0)
    return tables, starts[:-1], halves


@njit(cache=True)
def _spread(image, defocus, columns, rows, ladder, tables, starts, halves, sums, weights):  # type: ignore[no-untyped-def]
    """Add each pixel times the mix of its eight tables to ``sums``, and the mix to ``weights``, in place."""
    height, width, _ = image.shape
    for y in range(height):
        j = min(max(int(np.searchsorted(rows, y, side="right")) - 1, 0), max(len(rows) - 2, 0))
        down = (y - rows[j]) / (rows[j + 1] - rows[j]) if len(rows) > 1 else 0.0
        for x in range(width):
            i = min(max(int(np.searchsorted(columns, x, side="right")) - 1, 0), max(len(columns) - 2, 0))
            right = (x - columns[i]) / (columns[i + 1] - columns[i]) if len(columns) > 1 else 0.0
            k = min(max(int(np.searchsorted(ladder, defocus[y, x], side="right")) - 1, 0), len(ladder) - 2)
            up = (defocus[y, x] - ladder[k]) / (ladder[k + 1] - ladder[k])
            for corner in range(8):
                a, b, c = corner & 1, corner >> 1 & 1, corner >> 2
                share = (right if a else 1.0 - right) * (down if b else 1.0 - down) * (up if c else 1.0 - up)
                if share <= 0.0:
                    continue
                table = ((k + c) * len(rows) + j + b) * len(columns) + i + a
                half = halves[table]
                for v in range(max(0, y - half), min(height, y + half + 1)):
                    line = starts[table] + (v - y + half) * (2 * half + 1) + half - x
                    for u in range(max(0, x - half), min(width, x + half + 1)):
                        for channel in range(3):
                            weight = share * tables[line + u, channel]
                            weights[v, u, channel] += weight
                            sums[v, u, channel] += weight * image[y, x, channel]
