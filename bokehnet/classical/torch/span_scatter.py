"""Scatter of every pixel over its shape with torch operations on any device, at one size and exactly.

As in :mod:`bokehnet.classical.scatter.disc_scatter`, only the two ends of each span are written, as
differences along the row, and one running sum per row fills the interiors. The adjoint reads running sums of
the gradient at the same positions. The cost is the number of spans, O(r) for a disc, in a few operations on
about a million spans each.

Differences and sums are integers, multiples of 2^-57 of the largest value of a channel. The amount added at
the left end of a span is subtracted exactly at its right end, so that a bright disc leaves no residue in its
row. Integer sums do not depend on the order of the additions, so that results are bit-identical on devices
that add in any order. They also need no float64 arithmetic per span, which is slow on most graphics cards. In
return the range of each channel is limited to 10^17.

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

# Integer units per largest value. Sums stay below 2^63 units: if the radius of each pixel were the one that
# illuminates a given pixel most, this pixel would receive 1 + sum 1 / (pi d^2) over all distances d, 21 times
# the largest value in a picture with sides of 10^4 pixels.
_UNITS = 2.0**57

# The same for gradients. The fractions of a shape sum to 1; the absolute values of their derivatives by the
# radius sum to less than 16 per pixel.
_VALUE_UNITS, _SLOPE_UNITS = 2.0**60, 2.0**56


def _to_integers(numbers: Tensor) -> Tensor:
    """Return the nearest integers; overwrites its argument."""
    return numbers.round_().long()


def _is_sharp(defocus: Tensor) -> Tensor:
    """Return the pixels that are not blurred, (H, W, 1), bool."""
    return defocus.abs()[..., None] <= SMALLEST_RADIUS


def _largest(numbers: Tensor) -> Tensor:
    """Return the largest magnitude of each channel, (C,); 1 for a channel of zeros."""
    largest = numbers.abs().amax(dim=(0, 1))
    return largest.where(largest != 0, 1.0)


def _rows(table: Tensor, index: Tensor) -> Tensor:
    """Return rows of ``table`` (n, C) by ``index`` (m,), gathered channel by channel, (m, C).

    On CUDA devices torch gathers single numbers far faster than short rows.
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
            source_light = _rows(_rows(unit, sources.pixels[batch.sources]), batch.owner)
            light = _to_integers(source_light.mul_((batch.part * _UNITS)[:, None]))
            rows.index_add_(0, batch.left, light)
            rows.index_add_(0, batch.right, light, alpha=-1)
    rows = rows.view(height + 2, width + 1, channels)[1:-1].movedim(2, 0).contiguous().cumsum_(-1)
    sums = rows[..., :width].movedim(0, 2).to(values.dtype).div_(_UNITS).mul_(largest).contiguous()
    return sums.add_(values.where(_is_sharp(defocus), 0.0))


def _gather(
    values: Tensor, defocus: Tensor, aperture: Aperture | None, view: View | None, grad_sums: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the gradients of :func:`_scatter` for values and defocus (adjoint)."""
    height, width, channels = values.shape
    largest, steepest = _largest(values), _largest(grad_sums)
    light = largest.double() * steepest.double()
    bound = light.sum()
    unit = (values / largest * (light / bound).to(values.dtype)).view(-1, channels)
    grad_values = grad_sums.where(_is_sharp(defocus), 0.0).view(-1, channels)
    grad_defocus = torch.zeros_like(defocus).view(-1)
    # Exclusive running sums along rows, with rows of zeros above and below.
    units = 2.0 ** (62 - width.bit_length())
    sums = torch.zeros((height + 2, width + 1, channels), dtype=torch.int64, device=values.device)
    scaled = _to_integers((grad_sums / steepest).movedim(2, 0).contiguous().mul_(units))
    sums[1:-1, 1:] = scaled.cumsum_(-1).movedim(0, 2)
    sums = sums.view(-1, channels)
    for sources in find_sources(defocus, aperture, view):
        gathered = torch.zeros((len(sources.pixels), channels), dtype=torch.int64, device=values.device)
        slopes = torch.zeros(len(sources.pixels), dtype=torch.int64, device=values.device)
        for batch in list_batches(sources, height, width):
            inside = _rows(sums, batch.right).sub_(_rows(sums, batch.left))
            inside = inside.to(values.dtype).div_(units)
            source_light = _rows(_rows(unit, sources.pixels[batch.sources]), batch.owner)
            change = source_light.mul_(inside).sum(-1).mul_(batch.slope).mul_(_SLOPE_UNITS)
            slopes[batch.sources].index_add_(0, batch.owner, _to_integers(change))
            light = _to_integers(inside.mul_((batch.part * _VALUE_UNITS)[:, None]))
            gathered[batch.sources].index_add_(0, batch.owner, light)
        grad_values[sources.pixels] = gathered.to(values.dtype).div_(_VALUE_UNITS).mul_(steepest)
        grad_defocus[sources.pixels] = slopes.to(values.dtype).div_(_SLOPE_UNITS).mul_(bound.to(values.dtype))
    is_in_range = defocus.abs() <= LARGEST_RADIUS
    grad_defocus = (grad_defocus.view(height, width) * defocus.sign()).where(is_in_range, 0.0)
    return grad_values.view(height, width, channels), grad_defocus


class _ScatterLevel(torch.autograd.Function):
    """Autograd function of :func:`_scatter` and :func:`_gather`."""

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
    """Return the sums of all pixels scattered over their shapes; linear in ``values``.

    Args:
        values: Values of the pixels, (H, W, C), float32 or float64, on any device with int64 and float64; a
            channel of ones returns the weights for normalisation. Pixels of zeros are skipped.
        defocus: Signed blur radius in pixels, (H, W), of the same dtype and device. Pixels with at
            most 1/2 are not blurred. Shapes other than discs are limited to ``LARGEST_TABLE``.
        aperture: Shape of the aperture; None for a disc.
        view: Position of this grid in the full-size picture; None without a cat's-eye.

    Returns:
        Sums (H, W, C), once differentiable in both tensors. The gradient for the defocus is 0 where its
        magnitude is at most 1/2 or above ``LARGEST_RADIUS``. NaN or infinity in a channel of the values makes
        the whole channel NaN.
    """
    return _ScatterLevel.apply(values.contiguous(), defocus.contiguous(), aperture, view)
