"""Scatter every pixel over its shape with torch operations, on any device: one size, no shortcuts.

As in :mod:`bokehnet.classical.scatter.disc_scatter` only the two ends of each span of a shape are written, as
differences along the row, and one running sum per row fills the insides; the adjoint reads, at the same
places, running sums of the gradient. The work is the number of spans, O(r) for a disc, done by a few
operations on a million or so of them at a time.

Differences and sums are whole numbers, multiples of 2^-57 of a channel's largest value. What is added at a
span's left end is taken off again at its right one to the last bit: beyond a bright disc nothing at all is
left of it, however long the row. Whole numbers also make the order of the additions indifferent, so that a
device that adds them in any order still gives the same bits every time; and no float64 arithmetic is needed
per span, of which most graphics cards have little. For that each channel is limited to a range of 10^17.

Needs torch.

Source: Kosloff, Tao and Barsky, "Depth of field postprocessing for layered scenes using constant-time
rectangle spreading", Graphics Interface 2009, for spreading by differences.
"""

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from bokehnet.classical.scatter.cats_eye import View
from bokehnet.classical.scatter.disc_scatter import LARGEST_RADIUS
from bokehnet.classical.scatter.disc_table import SMALLEST_RADIUS
from bokehnet.classical.torch.not_compiled import not_compiled
from bokehnet.classical.torch.scanline_spans import find_sources, list_batches
from bokehnet.optics.aperture import Aperture

__all__ = ["scatter_level"]

# Whole numbers per largest value. Sums stay below 2^63 of them: were the radius of each pixel the one that
# lights a given pixel most, it would get 1 + sum 1 / (pi d^2) over all distances d, 21 times the largest
# value in a picture of 10^4 pixels a side.
_FINE = 2.0**57

# The same for gradients. The parts of a shape sum to one; their derivatives by the radius, all taken as
# positive, to less than 16 per pixel.
_FINE_VALUE, _FINE_SLOPE = 2.0**60, 2.0**56


def _whole(numbers: Tensor) -> Tensor:
    """The nearest whole numbers; overwrites its argument."""
    return numbers.round_().long()


def _sharp(defocus: Tensor) -> Tensor:
    """Where a pixel keeps what it has, (H, W, 1)."""
    return defocus.abs()[..., None] <= SMALLEST_RADIUS


def _largest(numbers: Tensor) -> Tensor:
    """Largest magnitude of each channel, (C,); 1 for a channel of zeros."""
    largest = numbers.abs().amax(dim=(0, 1))
    return largest.where(largest != 0, 1.0)


def _rows(table: Tensor, index: Tensor) -> Tensor:
    """Return rows of ``table`` (n, C) by ``index`` (m,), gathered channel by channel, (m, C).

    On CUDA devices torch gathers single numbers far faster than rows of a few.
    """
    return torch.stack([column.index_select(0, index) for column in table.unbind(1)], 1)


def _scatter(values: Tensor, defocus: Tensor, aperture: Aperture | None, view: View | None) -> Tensor:
    height, width, channels = values.shape
    largest = _largest(values)
    unit = (values / largest).view(-1, channels)
    lit = (values != 0).any(-1)
    rows = torch.zeros(((height + 2) * (width + 1), channels), dtype=torch.int64, device=values.device)
    for sources in find_sources(defocus.where(lit, 0.0), aperture, view):
        for batch in list_batches(sources, height, width):
            own = _rows(_rows(unit, sources.pixels[batch.sources]), batch.owner)
            light = _whole(own.mul_((batch.part * _FINE)[:, None]))
            rows.index_add_(0, batch.left, light)
            rows.index_add_(0, batch.right, light, alpha=-1)
    rows = rows.view(height + 2, width + 1, channels)[1:-1].movedim(2, 0).contiguous().cumsum_(-1)
    sums = rows[..., :width].movedim(0, 2).to(values.dtype).div_(_FINE).mul_(largest).contiguous()
    return sums.add_(values.where(_sharp(defocus), 0.0))


def _gather(
    values: Tensor, defocus: Tensor, aperture: Aperture | None, view: View | None, grad_sums: Tensor
) -> tuple[Tensor, Tensor]:
    """Adjoint of :func:`_scatter`."""
    height, width, channels = values.shape
    largest, steepest = _largest(values), _largest(grad_sums)
    light = largest.double() * steepest.double()
    bound = light.sum()
    unit = (values / largest * (light / bound).to(values.dtype)).view(-1, channels)
    grad_values = grad_sums.where(_sharp(defocus), 0.0).view(-1, channels)
    grad_defocus = torch.zeros_like(defocus).view(-1)
    # Sums of all pixels before each one, with rows of zeros above and below.
    fine = 2.0 ** (62 - width.bit_length())
    sums = torch.zeros((height + 2, width + 1, channels), dtype=torch.int64, device=values.device)
    scaled = _whole((grad_sums / steepest).movedim(2, 0).contiguous().mul_(fine))
    sums[1:-1, 1:] = scaled.cumsum_(-1).movedim(0, 2)
    sums = sums.view(-1, channels)
    for sources in find_sources(defocus, aperture, view):
        gathered = torch.zeros((len(sources.pixels), channels), dtype=torch.int64, device=values.device)
        slopes = torch.zeros(len(sources.pixels), dtype=torch.int64, device=values.device)
        for batch in list_batches(sources, height, width):
            inside = _rows(sums, batch.right).sub_(_rows(sums, batch.left))
            inside = inside.to(values.dtype).div_(fine)
            own = _rows(_rows(unit, sources.pixels[batch.sources]), batch.owner)
            change = own.mul_(inside).sum(-1).mul_(batch.slope).mul_(_FINE_SLOPE)
            slopes[batch.sources].index_add_(0, batch.owner, _whole(change))
            light = _whole(inside.mul_((batch.part * _FINE_VALUE)[:, None]))
            gathered[batch.sources].index_add_(0, batch.owner, light)
        grad_values[sources.pixels] = gathered.to(values.dtype).div_(_FINE_VALUE).mul_(steepest)
        grad_defocus[sources.pixels] = slopes.to(values.dtype).div_(_FINE_SLOPE).mul_(bound.to(values.dtype))
    free = defocus.abs() <= LARGEST_RADIUS
    grad_defocus = (grad_defocus.view(height, width) * defocus.sign()).where(free, 0.0)
    return grad_values.view(height, width, channels), grad_defocus


class _ScatterLevel(torch.autograd.Function):
    """The two as one operation."""

    @staticmethod
    def forward(
        ctx: Any, values: Tensor, defocus: Tensor, aperture: Aperture | None, view: View | None
    ) -> Tensor:
        ctx.save_for_backward(values, defocus)
        ctx.lens = aperture, view
        return _scatter(values, defocus, aperture, view)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_sums: Tensor) -> tuple[Tensor, Tensor, None, None]:
        (values, defocus), (aperture, view) = ctx.saved_tensors, ctx.lens
        return *_gather(values, defocus, aperture, view, grad_sums.contiguous()), None, None


@not_compiled  # sizes depend on the data
def scatter_level(
    values: Tensor, defocus: Tensor, aperture: Aperture | None = None, view: View | None = None
) -> Tensor:
    """Scatter every pixel over its shape and add up; linear in ``values``.

    Args:
        values: What each pixel spreads, (H, W, C), float32 or float64, on any device with int64 and
            float64; a channel of ones gives the weights to divide by. A pixel of zeros costs nothing.
        defocus: Signed blur radius in pixels, (H, W), of the same dtype and device. Up to 1/2 a pixel
            keeps what it has. Shapes other than discs go up to ``LARGEST_TABLE``.
        aperture: The opening; None for a disc.
        view: Where this grid lies in the full-size picture, which the cat's-eye needs; without it there
            is none.

    Returns:
        Sums (H, W, C), once differentiable in both tensors. The gradient for the defocus is 0 where its
        magnitude is up to 1/2 or above ``LARGEST_RADIUS``. NaN or infinity in a channel of the values
        makes all of that channel NaN.
    """
    return _ScatterLevel.apply(values.contiguous(), defocus.contiguous(), aperture, view)
