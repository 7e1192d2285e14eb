"""Umbra culling: removal of layer surfaces that no ray of the lens reaches.

In the picture, a ray of the pupil point a passes from a surface of defocus d at q to ``q + (d - e) a`` at the
defocus e. All rays from the centre of a pixel therefore pass the square of an opaque surface in front of it
if that is nearer by at most half a pixel of defocus: depth peeling can skip to the next surface behind that
offset. The extended umbra treats the surface in front as continuous across neighbouring pixels: a surface is
out of reach if it is covered as far as any of its rays extends. This is wrong where a ray slips through the
gap between a foreground's edge and the surface behind it.

Source: thesis 001, 3.2.2, after Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control",
SIGGRAPH 2010. The thesis mentions the idea but omits it; the conditions are derived here.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.rays.n_buffers import n_buffers, radius_bounds
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["cull_umbra"]

# Minimum coverage of an occluder; half the side of a pixel.
_MIN_COVERAGE, _HALF_PIXEL = 0.5, 0.5

# Iterations of the bounds on the reach of the rays.
_BOUND_ITERATIONS = 3


def cull_umbra(layers: Layers, *, extended: bool = False) -> Layers:
    """Return the layers with coverage 0 for surfaces in the umbra of others.

    Args:
        layers: Layers, front to back, for a disc-shaped pupil or any aperture within it.
        extended: Join the pixels of the surface in front to one occluder.
    """
    visible = layers.coverage > 0
    nearest_opaque = np.full(visible.shape[:2], -np.inf)
    for layer in range(visible.shape[2]):
        defocus = layers.defocus[:, :, layer].astype(np.float64)
        umbra = nearest_opaque - defocus <= _HALF_PIXEL
        umbra &= nearest_opaque > -np.inf
        if extended and layer:
            low, high = n_buffers(nearest_opaque)
            shadow = np.zeros(nearest_opaque.shape, np.bool_)
            with parallel_region:
                _shadow(low, high, defocus, shadow)
            umbra |= shadow
        visible[:, :, layer] &= ~umbra
        opaque = visible[:, :, layer] & (layers.coverage[:, :, layer] >= _MIN_COVERAGE)
        nearest_opaque = np.where(opaque, defocus, nearest_opaque)
    return Layers(
        colors=layers.colors, defocus=layers.defocus, coverage=np.where(visible, layers.coverage, 0)
    )


@njit(cache=True, parallel=True)
def _shadow(low, high, defocus, shadow):
    """Mark pixels that nearer surfaces cover within the reach of all their rays."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            center_defocus, farthest = defocus[y, x], high[-1, 0, 0]
            if not low[0, y, x] > center_defocus:
                continue
            nearest = -np.inf
            for _ in range(_BOUND_ITERATIONS):
                nearest, farthest = radius_bounds(low, high, y, x, int(math.ceil(farthest - center_defocus)))
            shadow[y, x] = nearest > center_defocus
