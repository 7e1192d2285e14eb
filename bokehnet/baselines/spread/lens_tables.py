"""Spreading with the point spread functions of a lens at each field position and blur, clipped by the barrel.

The tables are ray-traced images of points at a grid of positions in the picture and at a ladder of defocus
(:mod:`bokehnet.classical.highlights.aberrated_psf`); a pixel interpolates those of the four nearest positions
and the two nearest defocus steps.

Faults: foreground and background mix without order; slow, as pixels share no sums; between the positions of
    two tables a disc is the mixture of both.

Source: thesis 001, 3.3.2, "PSFs of lenses": spreading with tables of a prescription lens.
"""

import numpy as np

from bokehnet.arrays.viewport import Viewport
from bokehnet.baselines.apertures import check_baseline
from bokehnet.baselines.spread.psf_spreading import normalised
from bokehnet.classical.highlights.aberrated_psf import AberratedPsf
from bokehnet.classical.parallel import parallel_region
from bokehnet.errors import ParameterError
from bokehnet.kernels import njit
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture

__all__ = ["defocus_ladder", "lens_spreading", "spread_positions", "traced_tables"]

# Number of positions along the longer side; minimum step of the ladder in pixels, and as a fraction of the
# radius.
_NUM_POSITIONS, _MIN_STEP_PX, _RELATIVE_STEP = 13, 0.5, 0.06

# Maximum blur radius, pixels: larger tables need gigabytes.
_MAX_RADIUS_PX = 64.0


def lens_spreading(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    lens_response: LensResponse | None = None,
) -> np.ndarray:
    """Spread all pixels, not only lights, with the point spread functions of a lens.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any aperture without a cat's-eye; default: disc.
        lens_response: Aberrations, barrel and colours; default: an ideal lens.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ParameterError: The blur exceeds 64 pixels.

    Source:
        Thesis 001, 3.3.2.
    """
    image, defocus, aperture = check_baseline("lens_spreading", "any", image, defocus, aperture)
    height, width = defocus.shape
    spacing = max(8.0, (max(height, width) - 1) / (_NUM_POSITIONS - 1))
    columns, rows = (np.unique(np.arange(0, size - 1 + spacing, spacing).round()) for size in (width, height))
    lens_response = lens_response or LensResponse()
    if lens_response.is_ideal:  # the same everywhere
        columns, rows = columns[:1], rows[:1]
    ladder = defocus_ladder(float(defocus.min()), float(defocus.max()))
    defocus_step, row, column = (axis.ravel() for axis in np.meshgrid(ladder, rows, columns, indexing="ij"))
    lights = np.ones((len(defocus_step), 8))
    lights[:, 0], lights[:, 1], lights[:, 2] = column, row, defocus_step
    tables, starts, halves = traced_tables(aperture, lens_response, lights, (height, width))
    sums, weights = np.zeros((height, width, 3)), np.zeros((height, width, 3))
    spread_positions(image, defocus, columns, rows, ladder, tables, starts, halves, sums, weights)
    return normalised(sums, weights, image)


def defocus_ladder(low: float, high: float) -> np.ndarray:
    """Return at least two steps of defocus that enclose ``low`` to ``high``, from a ladder through 0."""
    radii = [0.0]
    while radii[-1] <= max(-low, high):
        radii.append(radii[-1] + max(_MIN_STEP_PX, _RELATIVE_STEP * radii[-1]))
    steps = np.array([-r for r in radii[:0:-1]] + radii)
    first, last = np.searchsorted(steps, low, side="right") - 1, np.searchsorted(steps, high)
    return steps[first : max(last, first + 1) + 1]


def traced_tables(
    aperture: Aperture, lens_response: LensResponse, lights: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return square images of points, (pixels, 3), channels of sum 1; their starts, and half their sides.

    Args:
        aperture: Shape of the discs.
        lens_response: Response of the lens.
        lights: Points, (N, 8): column, row, defocus in pixels, and 1.
        shape: Height and width of the picture, pixels.

    Raises:
        ParameterError: The blur exceeds 64 pixels.
    """
    largest = float(np.abs(lights[:, 2]).max())
    if largest > _MAX_RADIUS_PX * (1 + _RELATIVE_STEP):
        expected = f"blur radii of at most {_MAX_RADIUS_PX:g} pixels, the maximum of its tables"
        raise ParameterError("defocus", expected, largest, "use the engine `rays`")
    psf = AberratedPsf(aperture, lens_response, lights, Viewport.whole(*shape).frame)
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
def spread_positions(image, defocus, columns, rows, ladder, tables, starts, halves, sums, weights):
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
                mix = (right if a else 1.0 - right) * (down if b else 1.0 - down) * (up if c else 1.0 - up)
                if mix <= 0.0:
                    continue
                table = ((k + c) * len(rows) + j + b) * len(columns) + i + a
                half = halves[table]
                for v in range(max(0, y - half), min(height, y + half + 1)):
                    line = starts[table] + (v - y + half) * (2 * half + 1) + half - x
                    for u in range(max(0, x - half), min(width, x + half + 1)):
                        for channel in range(3):
                            weight = mix * tables[line + u, channel]
                            weights[v, u, channel] += weight
                            sums[v, u, channel] += weight * image[y, x, channel]
