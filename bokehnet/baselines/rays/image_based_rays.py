"""Image-based ray tracing: rays of the lens meet the layers of a picture, as height fields.

Every pixel sends rays through points of the pupil. In the picture a ray of the pupil point a lies at
``p - d a`` at the depth of defocus d, so that with ``-d`` as the depth it is straight, as in a depth buffer.
Before they are followed all rays of a pixel are cut to the depths that lie under them, by N-buffers.

Faults: a picture alone is one layer, and what rays find behind its edges is nothing; pixels are hard squares,
so that edges have steps; noise of few rays. Rays that meet nothing do not count.

Source: thesis 001, 3.2.3, 4.1.4 and 4.2; Lee, Eisemann and Seidel, "Real-time lens blur effects and focus
control", SIGGRAPH 2010.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.gather.basic_gather import random_number
from bokehnet.baselines.openings import check_baseline
from bokehnet.baselines.rays.height_field import walk_corners, walk_edges
from bokehnet.baselines.rays.n_buffers import n_buffers, radius_bounds
from bokehnet.checks import check_choice, check_same_size, check_whole
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture, pupil_points
from bokehnet.optics.sampling import sobol

__all__ = ["WALKS", "image_rays", "trace_height_fields"]

WALKS = ("edges", "corners")

# Coverage from which a layer is there: the thesis's layers are there or not.
_THERE = 0.5

# How far a ray goes beyond a pixel, part of the range of depth, as the thesis found; and at least, pixels.
_SLACK, _LEAST_SLACK = 0.01, 1e-3

# Sets of pupil points that pixels choose from, and how often depths are looked for below the last ones.
_SETS, _ROUNDS = 256, 3


@njit(cache=True, parallel=True)
def _trace(  # type: ignore[no-untyped-def]
    colors, z, count, low, high, points, slack, corners, bounded, bokeh, lost
):
    height, width, _ = z.shape
    for y in prange(height):
        for x in range(width):
            near, far = low[-1, 0, 0], high[-1, 0, 0]
            if bounded:
                for _ in range(_ROUNDS):
                    reach = int(math.ceil(max(abs(near), abs(far)) + slack))
                    near, far = radius_bounds(low, high, y, x, reach)
            near, far = near - slack, far + slack
            own = points[int(random_number(x, y, 0) * points.shape[0])]
            total, red, green, blue = 0.0, 0.0, 0.0, 0.0
            missed = 0
            for s in range(own.shape[0]):
                u, v = own[s, 0], own[s, 1]
                start = (x + 0.5 + near * u, y + 0.5 + near * v, near)
                end = (x + 0.5 + far * u, y + 0.5 + far * v, far)
                if corners:
                    row, column, layer = walk_corners(z, count, start, end, slack)
                else:
                    row, column, layer = walk_edges(z, count, start, end, slack)
                if layer < 0:
                    missed += 1
                    continue
                row, column = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
                weight = own[s, 2] if z[row, column, layer] < 0.0 else own[s, 3]
                total += weight
                red += weight * colors[row, column, layer, 0]
                green += weight * colors[row, column, layer, 1]
                blue += weight * colors[row, column, layer, 2]
            lost[y, x] = missed / own.shape[0]
            if total > 0.0:
                bokeh[y, x, 0], bokeh[y, x, 1], bokeh[y, x, 2] = red / total, green / total, blue / total
            else:
                for c in range(3):
                    bokeh[y, x, c] = colors[y, x, 0, c]


def _packed(layers: Layers) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Colours, depths (H, W, L) and number (H, W) of the layers that are there, without holes."""
    there = layers.coverage >= _THERE
    order = np.argsort(~there, axis=2, kind="stable")
    z = np.take_along_axis(-layers.defocus.astype(np.float64), order, 2)
    colors = np.take_along_axis(layers.colors, order[..., None], 2)
    return np.ascontiguousarray(colors), np.ascontiguousarray(z), there.sum(2)


def trace_height_fields(
    layers: Layers,
    aperture: Aperture | None = None,
    *,
    samples: int = 64,
    walk: str = "edges",
    bounded: bool = True,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Render layers.

    Args:
        layers: Those of less than half a pixel's coverage are not there, all others are opaque.
        aperture: Default a disc.
        samples: Rays of a pixel, from 1 up.
        walk: ``edges`` or ``corners``, see :mod:`bokehnet.baselines.rays.height_field`.
        bounded: Cut rays to the depths below them; else to those of the whole picture.
        seed: Of the rays.

    Returns:
        Picture (H, W, 3), float32, and the share of each pixel's rays that met nothing, (H, W).

    Raises:
        ParameterError: Another walk, or no samples.
    """
    check_choice("walk", walk, WALKS)
    check_whole("samples", samples, 1)
    aperture = aperture or Aperture()
    colors, z, count = _packed(layers)
    there = np.arange(z.shape[2]) < count[..., None]
    if not there.any():
        return layers.colors[:, :, 0].copy(), np.ones(count.shape)
    low, high = n_buffers(np.where(there, z, np.inf).min(2), np.where(there, z, -np.inf).max(2))
    rng = np.random.default_rng(seed)
    points = np.empty((_SETS, samples, 4))
    for own in points:
        square = sobol(samples, rng)
        own[:, :2], own[:, 2] = pupil_points(aperture, square, 1)
        own[:, 3] = pupil_points(aperture, square, -1)[1]
    slack = max(_SLACK * float(high[-1, 0, 0] - low[-1, 0, 0]), _LEAST_SLACK)
    bokeh, lost = np.empty((*count.shape, 3), np.float32), np.empty(count.shape)
    with parallel_region:
        _trace(colors, z, count, low, high, points, slack, walk == "corners", bounded, bokeh, lost)
    return bokeh, lost


def image_rays(
    image: np.ndarray,
    defocus: np.ndarray,
    aperture: Aperture | None = None,
    *,
    layers: Layers | None = None,
    samples: int = 64,
    walk: str = "edges",
) -> np.ndarray:
    """Render by rays through a picture's pixels, or through layers.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any without a cat's-eye; default a disc.
        layers: In place of picture and defocus, which are one.
        samples: Rays of a pixel, from 1 up.
        walk: ``edges`` or ``corners``: which of the two algorithms follows rays.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ShapeError: Layers of another size.

    Source:
        Thesis 001, 4.2.1 (``corners``) and 4.2.2 (``edges``).
    """
    image, defocus, aperture = check_baseline("image_rays", "any", image, defocus, aperture)
    if layers is None:
        whole = np.ones((*defocus.shape, 1), np.float32)
        layers = Layers(colors=image[:, :, None], defocus=defocus[..., None], coverage=whole)
    check_same_size("image", image, "layers", layers.defocus)
    return trace_height_fields(layers, aperture, samples=samples, walk=walk)[0]
