"""Image-based ray tracing: rays of the lens intersect the layers of a picture as height fields.

Every pixel sends rays through points of the pupil. In the picture, a ray of the pupil point a is at ``p - d
a`` at the depth of defocus d, so that it is straight with ``-d`` as depth, as in a depth buffer. Before
tracing, N-buffers clip all rays of a pixel to the depths in their range.

Faults: a single picture is one layer, so rays find nothing behind its edges; pixels are hard squares, so
    edges have steps; noise from few rays. Rays without a hit do not count.

Source: thesis 001, 3.2.3, 4.1.4 and 4.2; Lee, Eisemann and Seidel, "Real-time lens blur effects and focus
control", SIGGRAPH 2010.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.apertures import check_baseline
from bokehnet.baselines.gather.basic_gather import random_number
from bokehnet.baselines.rays.height_field import walk_corners, walk_edges, walk_runs
from bokehnet.baselines.rays.n_buffers import n_buffers, radius_bounds
from bokehnet.checks import check_choice, check_same_size, check_whole
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit
from bokehnet.optics.aperture import Aperture, pupil_points
from bokehnet.optics.sampling import sobol

__all__ = ["WALKS", "image_rays", "trace_height_fields"]

WALKS = ("edges", "corners", "runs")

# Minimum coverage of an opaque layer: layers of the thesis are either opaque or absent.
_MIN_COVERAGE = 0.5

# Extension of a ray beyond a pixel, as a fraction of the depth range after the thesis; and its minimum,
# pixels.
_RELATIVE_SLACK, _MIN_SLACK_PX = 0.01, 1e-3

# Number of sets of pupil points, and of iterations of the depth bounds.
_NUM_POINT_SETS, _BOUND_ITERATIONS = 256, 3


@njit(cache=True, parallel=True)
def _trace(colors, z, count, low, high, points, slack, walk, bounded, bokeh, lost):
    height, width, _ = z.shape
    for y in prange(height):
        for x in range(width):
            near, far = low[-1, 0, 0], high[-1, 0, 0]
            if bounded:
                for _ in range(_BOUND_ITERATIONS):
                    reach = int(math.ceil(max(abs(near), abs(far)) + slack))
                    near, far = radius_bounds(low, high, y, x, reach)
            near, far = near - slack, far + slack
            point_set = points[int(random_number(x, y, 0) * points.shape[0])]
            total, red, green, blue = 0.0, 0.0, 0.0, 0.0
            missed = 0
            for s in range(point_set.shape[0]):
                u, v = point_set[s, 0], point_set[s, 1]
                start = (x + 0.5 + near * u, y + 0.5 + near * v, near)
                end = (x + 0.5 + far * u, y + 0.5 + far * v, far)
                if walk == 1:
                    row, column, layer = walk_corners(z, count, start, end, slack)
                elif walk == 2:
                    row, column, layer = walk_runs(z, count, start, end, slack)
                else:
                    row, column, layer = walk_edges(z, count, start, end, slack)
                if layer < 0:
                    missed += 1
                    continue
                row, column = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
                weight = point_set[s, 2] if z[row, column, layer] < 0.0 else point_set[s, 3]
                total += weight
                red += weight * colors[row, column, layer, 0]
                green += weight * colors[row, column, layer, 1]
                blue += weight * colors[row, column, layer, 2]
            lost[y, x] = missed / point_set.shape[0]
            if total > 0.0:
                bokeh[y, x, 0], bokeh[y, x, 1], bokeh[y, x, 2] = red / total, green / total, blue / total
            else:
                for c in range(3):
                    bokeh[y, x, c] = colors[y, x, 0, c]


def _packed(layers: Layers) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return colours, depths (H, W, L) and number (H, W) of the opaque layers, compacted."""
    opaque = layers.coverage >= _MIN_COVERAGE
    order = np.argsort(~opaque, axis=2, kind="stable")
    z = np.take_along_axis(-layers.defocus.astype(np.float64), order, 2)
    colors = np.take_along_axis(layers.colors, order[..., None], 2)
    return np.ascontiguousarray(colors), np.ascontiguousarray(z), opaque.sum(2)


def trace_height_fields(
    layers: Layers,
    aperture: Aperture | None = None,
    *,
    samples: int = 64,
    walk: str = "edges",
    bounded: bool = True,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Render layers as height fields.

    Args:
        layers: Layers; those of less than half a pixel's coverage are ignored, all others are opaque.
        aperture: Aperture; default: disc.
        samples: Rays per pixel, at least 1.
        walk: ``edges``, ``corners`` or ``runs``, see :mod:`bokehnet.baselines.rays.height_field`.
        bounded: Clip rays to the depths in their range; otherwise to those of the whole picture.
        seed: Seed of the rays.

    Returns:
        Picture (H, W, 3), float32, and the fraction of each pixel's rays without a hit, (H, W).

    Raises:
        ParameterError: The walk is unknown, or there are no samples.
    """
    check_choice("walk", walk, WALKS)
    check_whole("samples", samples, 1)
    aperture = aperture or Aperture()
    colors, z, count = _packed(layers)
    opaque = np.arange(z.shape[2]) < count[..., None]
    if not opaque.any():
        return layers.colors[:, :, 0].copy(), np.ones(count.shape)
    low, high = n_buffers(np.where(opaque, z, np.inf).min(2), np.where(opaque, z, -np.inf).max(2))
    rng = np.random.default_rng(seed)
    points = np.empty((_NUM_POINT_SETS, samples, 4))
    for point_set in points:
        square = sobol(samples, rng)
        point_set[:, :2], point_set[:, 2] = pupil_points(aperture, square, 1)
        point_set[:, 3] = pupil_points(aperture, square, -1)[1]
    slack = max(_RELATIVE_SLACK * float(high[-1, 0, 0] - low[-1, 0, 0]), _MIN_SLACK_PX)
    bokeh, lost = np.empty((*count.shape, 3), np.float32), np.empty(count.shape)
    with parallel_region:
        _trace(colors, z, count, low, high, points, slack, WALKS.index(walk), bounded, bokeh, lost)
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
    """Render by rays through the pixels of a picture, or through layers.

    Args:
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        aperture: Any aperture without a cat's-eye; default: disc.
        layers: Layers that replace the single layer of picture and defocus.
        samples: Rays per pixel, at least 1.
        walk: Tracing algorithm, ``edges``, ``corners`` or ``runs``.

    Returns:
        Picture (H, W, 3), float32.

    Raises:
        ShapeError: The layers have another size.

    Source:
        Thesis 001, 4.2.1 (``corners``), 4.2.2 (``edges``) and 3.2.3 (``runs``).
    """
    image, defocus, aperture = check_baseline("image_rays", "any", image, defocus, aperture)
    if layers is None:
        full_coverage = np.ones((*defocus.shape, 1), np.float32)
        layers = Layers(colors=image[:, :, None], defocus=defocus[..., None], coverage=full_coverage)
    check_same_size("image", image, "layers", layers.defocus)
    return trace_height_fields(layers, aperture, samples=samples, walk=walk)[0]
