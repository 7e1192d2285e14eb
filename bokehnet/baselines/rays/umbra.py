"""Which surfaces of layers no ray of the lens reaches: umbra culling.

In the picture a ray of the pupil point a goes from a surface of defocus d at q to ``q + (d - e) a`` at the
defocus e. So all rays from the middle of a pixel pass the square of an opaque one before it if that is nearer
by no more than half a pixel of defocus: depth peeling may take as the next surface one that lies behind by
more than that offset. The extended umbra takes the surface before as one without gaps between neighbouring
pixels: what it covers as far as any ray goes from there is out of reach. That is wrong where a ray slips
through the gap between a foreground's edge and what stands behind it.

Source: thesis 001, 3.2.2, after Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control",
SIGGRAPH 2010. The thesis names the idea and leaves it out; the conditions here are ours.
"""

import math

import numpy as np
from numba import prange

from bokehnet.baselines.rays.n_buffers import n_buffers, radius_bounds
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.parallel import parallel_region
from bokehnet.kernels import njit

__all__ = ["cull_umbra"]

# Coverage from which a surface casts a shadow; half the side of a pixel.
_OPAQUE, _HALF = 0.5, 0.5

# How often the way of the rays is bounded again, by the surfaces within the last bound.
_ROUNDS = 3


def cull_umbra(layers: Layers, *, extended: bool = False) -> Layers:
    """Return the layers without those surfaces that lie in the shadow of others; their coverage is 0.

    Args:
        layers: Front to back. Of a disc of a pupil, or of any opening within it.
        extended: Join the pixels of the surface before, so that it casts one shadow.
    """
    kept = layers.coverage > 0
    before = np.full(kept.shape[:2], -np.inf)
    for layer in range(kept.shape[2]):
        defocus = layers.defocus[:, :, layer].astype(np.float64)
        dark = before - defocus <= _HALF
        dark &= before > -np.inf
        if extended and layer:
            low, high = n_buffers(before)
            shadow = np.zeros(before.shape, np.bool_)
            with parallel_region:
                _shadow(low, high, defocus, shadow)
            dark |= shadow
        kept[:, :, layer] &= ~dark
        opaque = kept[:, :, layer] & (layers.coverage[:, :, layer] >= _OPAQUE)
        before = np.where(opaque, defocus, before)
    return Layers(colors=layers.colors, defocus=layers.defocus, coverage=np.where(kept, layers.coverage, 0))


@njit(cache=True, parallel=True)
def _shadow(low, high, defocus, shadow):  # type: ignore[no-untyped-def]
    """Mark what is covered by nearer surfaces as far as its rays go in front of the farthest of them."""
    height, width = defocus.shape
    for y in prange(height):
        for x in range(width):
            own, most = defocus[y, x], high[-1, 0, 0]
            if not low[0, y, x] > own:
                continue
            least = -np.inf
            for _ in range(_ROUNDS):
                least, most = radius_bounds(low, high, y, x, int(math.ceil(most - own)))
            shadow[y, x] = least > own
