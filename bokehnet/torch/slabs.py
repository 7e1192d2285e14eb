"""Slabs of the defocus in which the rays of each tile can meet a surface, see :mod:`bokehnet.pupil_rays`."""

import torch
from torch import Tensor
from torch.nn import functional

from bokehnet.pupil_rays import BINS, TILE, first_scan, max_bins_of, scan_bin

__all__ = ["find_slabs"]

# Multiple of which the bounds of the bins are, pixels of defocus: small changes of the defocus leave slabs as
# they are, so that the gradients of a picture are exact.
_BOUND_PX = 1 / 16


def _occupied(index: Tensor, present: Tensor) -> Tensor:
    """Return the mask of the bins in each tile, (B, BINS, rows, columns), as 0 and 1.

    Args:
        index: Bin of each layer, (B, L, H, W).
        present: True where the layer covers its pixel, (B, L, H, W).
    """
    index = torch.where(present, index, -1)
    pad = (0, -index.shape[-1] % TILE, 0, -index.shape[-2] % TILE)
    index = functional.pad(index, pad, value=-1)
    batch, layers, height, width = index.shape
    tiles = index.view(batch, layers, height // TILE, TILE, width // TILE, TILE)
    return torch.stack([(tiles == bin).any(5).any(3).any(1) for bin in range(BINS)], 1)


def _dilate(occupied: Tensor, reach: Tensor) -> Tensor:
    """Return the bins of all tiles within ``reach`` (B, BINS) tiles, along rows and columns."""
    for axis in (2, 3):
        size = occupied.shape[axis]
        sums = functional.pad(occupied.long().cumsum(axis), (0, 0, 1, 0) if axis == 2 else (1, 0))
        index = torch.arange(size, device=occupied.device)
        shape = (1, 1, size, 1) if axis == 2 else (1, 1, 1, size)
        steps = reach[:, :, None, None]
        last = (index.view(shape) + steps + 1).clamp(max=size).expand(occupied.shape)
        first = (index.view(shape) - steps).clamp(min=0).expand(occupied.shape)
        occupied = sums.gather(axis, last) > sums.gather(axis, first)
    return occupied


@torch.no_grad()
def find_slabs(defocus: Tensor, coverage: Tensor, slabs: int) -> Tensor:
    """Return the slabs of each tile, (B, slabs, 4, rows, columns), in the order of ``Slab``.

    Args:
        defocus: Signed blur radius of the layers, pixels, (B, L, H, W).
        coverage: Coverage of the layers, (B, L, H, W).
        slabs: Number of slabs.
    """
    batch = len(defocus)
    flat = defocus.reshape(batch, -1) / _BOUND_PX
    high, low = _BOUND_PX * (flat.amax(1).floor() + 1), _BOUND_PX * (flat.amin(1).ceil() - 1)
    bin_px = (high - low) / BINS

    def per_picture(x: Tensor) -> Tensor:
        return x.view(batch, 1, 1, 1)

    index = ((per_picture(high) - defocus) / per_picture(bin_px)).floor().clamp(0, BINS - 1).long()
    edges = high[:, None] - bin_px[:, None] * torch.arange(BINS + 1, device=defocus.device)
    reach = (torch.maximum(edges[:, :-1].abs(), edges[:, 1:].abs()) / TILE).ceil().long()
    occupied = _dilate(_occupied(index, coverage > 0), reach)
    bins = torch.arange(BINS, device=defocus.device).view(1, BINS, 1, 1)
    first_bin = torch.where(occupied, bins, BINS).amin(1)
    max_bins = max_bins_of(first_bin, torch.where(occupied, bins, -1).amax(1), slabs)
    scan = first_scan(torch.zeros_like(max_bins), slabs)
    for bin, mask in enumerate(occupied.unbind(1)):
        scan = scan_bin(scan, bin, mask, max_bins)
    result = []
    for first, last in zip(scan.bounds[:slabs], scan.bounds[slabs:], strict=True):
        exists = first >= 0
        top, thickness = high.view(batch, 1, 1), bin_px.view(batch, 1, 1)
        front, back = (top - thickness * (bin + 0.5) for bin in (first, last))
        margin = 1e-3 * thickness
        upper = torch.where(exists, top - thickness * first + margin, -torch.inf)
        lower = torch.where(exists, top - thickness * (last + 1) - margin, torch.inf)
        result.append(torch.stack([front, back, upper, lower], 1))
    return torch.stack(result, 1)
