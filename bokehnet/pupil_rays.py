"""First surfaces on pupil rays through layers, in array operations alone.

The formulas are written once, on operators, for torch tensors (:mod:`bokehnet.torch`) and for ONNX graphs
(:mod:`bokehnet.onnx_file`). The numba kernels of :mod:`bokehnet.classical.layered.march` walk every pixel
under a ray instead; they are exact, and the authority for this module.

The ray of the pixel p through the aperture coordinate a is, at defocus s, over the position ``p - s a``. It
meets a layer of defocus D where ``s = D(p - s a)``. The iteration ``s <- D(p - s a)`` finds the surface in
which it starts, but jumps between surfaces at depth edges. The defocus is therefore divided into a few slabs,
front to back, such that surfaces at different depths are in different slabs, and the iteration runs in each
slab, on the layers that are in it. What it finds is composited front to back by coverage: a ray that passes
behind a foreground sees its layer in front of the slab, and meets the occluded background in the slab.

Slabs belong to tiles of pixels: histograms of the defocus, dilated by the reach of the rays, show the bins in
which the rays of a tile can meet a surface; empty bins separate slabs.

Source: Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010, for rays
through layers; Policarpo and Oliveira, "Relief mapping of non-height-field surface details", I3D 2006, for a
few steps of search in layered height fields. Slabs are ours.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from bokehnet.checks import Array, array_namespace

__all__ = [
    "BINS",
    "TILE",
    "Slab",
    "SlabScan",
    "find_surface",
    "first_scan",
    "is_inside",
    "max_bins_of",
    "scan_bin",
]

# Side of a tile, pixels, and number of equal bins between the smallest and the largest defocus.
TILE, BINS = 16, 64

# Empty bins between two surfaces that separate slabs.
_MIN_GAP_BINS = 3

# Number of lookups that lead to a surface; the last one is at the surface.
_LOOKUPS = 2


class Slab(NamedTuple):
    """Range of the defocus, by ray.

    Attributes:
        front: Start of the search, the centre of the slab's first bin, pixels.
        back: Start of the second search, the centre of its last bin, pixels.
        high: Largest defocus in the slab, pixels.
        low: Smallest defocus in the slab, pixels; larger than ``high`` for an empty slab.
    """

    front: Array
    back: Array
    high: Array
    low: Array


def is_inside(slab: Slab, defocus: Array) -> Array:
    """Return whether ``defocus`` is inside the slab."""
    return (defocus >= slab.low) & (defocus <= slab.high)


def _surface(slab: Slab, layers: Sequence[Array], fallback: Array) -> Array:
    """Return the defocus of the first layer in the slab, or ``fallback`` if there is none."""
    xp = array_namespace(fallback)
    for defocus in reversed(layers):
        fallback = xp.where(is_inside(slab, defocus), defocus, fallback)
    return fallback


def find_surface(
    defocus_at: Callable[[Array, Array], Sequence[Array]],
    position: tuple[Array, Array],
    pupil: tuple[Array, Array],
    slab: Slab,
) -> Array:
    """Return the defocus at which rays meet a surface in a slab, if they meet one.

    Args:
        defocus_at: Function that returns the defocus of each layer, front to back, at the pixels nearest to
            columns and rows.
        position: Column and row of the rays' pixels.
        pupil: Aperture coordinates (u, v) of the rays.
        slab: Slab in which to search.
    """
    (x, y), (u, v) = position, pupil
    defocus = slab.front
    for lookup in range(_LOOKUPS):
        layers = defocus_at(x - defocus * u, y - defocus * v)
        defocus = _surface(slab, layers, slab.back if lookup == 0 else defocus)
    return defocus


class SlabScan(NamedTuple):
    """State of the division of the bins of each tile into slabs, from front to back.

    Attributes:
        previous: Last occupied bin.
        start: First bin of the current slab.
        current: Number of the current slab, from 0; -1 before the first.
        bounds: First bin of each slab, then last bin of each; -1 for an empty slab.
    """

    previous: Array
    start: Array
    current: Array
    bounds: tuple[Array, ...]


def first_scan(integer: Array, slabs: int) -> SlabScan:
    """Return the state before the first bin; ``integer`` holds zeros in the shape of the tiles."""
    return SlabScan(integer - BINS, integer - BINS, integer - 1, (integer - 1,) * (2 * slabs))


def scan_bin(scan: SlabScan, bin: Array, mask: Array, max_bins: Array) -> SlabScan:
    """Return the state after one more bin.

    A slab begins after ``_MIN_GAP_BINS`` empty bins, or where the previous one has ``max_bins`` bins; the
    last slab contains the rest.

    Args:
        scan: State after the bin in front.
        bin: Number of the bin.
        mask: Tiles whose rays can meet a surface in it.
        max_bins: Bins per slab, by tile.
    """
    xp = array_namespace(max_bins)
    slabs = len(scan.bounds) // 2
    here = max_bins * 0 + bin
    begins = mask & ((here - scan.previous > _MIN_GAP_BINS) | (here - scan.start >= max_bins))
    begins = begins & (scan.current < slabs - 1)
    current = xp.where(begins, scan.current + 1, scan.current)
    bounds = []
    for number, bound in enumerate(scan.bounds):
        slab = number % slabs
        is_own = (current >= slab) & (current <= slab)
        bounds.append(xp.where((begins if number < slabs else mask) & is_own, here, bound))
    return SlabScan(
        xp.where(mask, here, scan.previous), xp.where(begins, here, scan.start), current, tuple(bounds)
    )


def max_bins_of(first: Array, last: Array, slabs: int) -> Array:
    """Return the bins per slab that divide the range from the first to the last occupied bin evenly."""
    return (last - first + slabs) // slabs
