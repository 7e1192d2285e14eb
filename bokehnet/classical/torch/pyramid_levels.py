"""Sums of the scatter on tensors of any device: large shapes are scattered in pictures of half the size.

The algorithm and its thresholds are those of :mod:`bokehnet.classical.scatter.pyramid_levels`, which
documents them; torch operations run it on the device of its tensors. Shapes beyond the radius table follow
:mod:`bokehnet.classical.scatter.aperture_scatter`.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.scatter.aperture_table import LARGEST_TABLE
from bokehnet.classical.scatter.cats_eye import View, every_second, make_view
from bokehnet.classical.scatter.operators import scatter_operator
from bokehnet.classical.scatter.pyramid_levels import CONTRAST, TOLERANCE, ScatterOperator
from bokehnet.classical.scatter.pyramid_merging import TILE
from bokehnet.classical.torch.not_compiled import not_compiled
from bokehnet.classical.torch.span_scatter import scatter_level
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture

__all__ = ["check_dtypes", "scatter_sums"]


class _Lens(NamedTuple):
    """Constants of all levels: aperture (None for a disc), its operator, position of the picture."""

    shape: Aperture | None
    operator: ScatterOperator
    viewport: Viewport


def _blocks(picture: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the four pixels of each 2x2 block in reading order; odd sizes are padded with zeros."""
    rest = (0, 0) * (picture.dim() - 2)
    even = functional.pad(picture, (*rest, 0, picture.shape[1] % 2, 0, picture.shape[0] % 2))
    return even[::2, ::2], even[::2, 1::2], even[1::2, ::2], even[1::2, 1::2]


def _largest(values: tuple[Tensor, Tensor, Tensor, Tensor]) -> Tensor:
    """Return the maximum of each block."""
    return torch.maximum(torch.maximum(values[0], values[1]), torch.maximum(values[2], values[3]))


def _repeat(blocks: Tensor, times: int, height: int, width: int) -> Tensor:
    """Repeat each number ``times`` times along both axes, clipped to (height, width, ...)."""
    return blocks.repeat_interleave(times, 0).repeat_interleave(times, 1)[:height, :width]


def _merges(values: Tensor, defocus: Tensor, operator: ScatterOperator) -> Tensor:
    """Return the blocks that become one source of the half-size picture, (ceil H/2, ceil W/2), bool."""
    radii = _blocks(defocus)
    high, negative_low = _largest(radii).double(), _largest(_blocks(-defocus)).double()
    smallest = torch.maximum(-negative_low, -high)
    is_uniform = (smallest > operator.merge_above) & (high + negative_low <= TOLERANCE * smallest)
    magnitude = values.abs()
    tiles = magnitude.movedim(2, 0)[None].double()
    limits = CONTRAST * functional.avg_pool2d(tiles, TILE, ceil_mode=True)[0].movedim(0, 2)
    is_highlight = _largest(_blocks(magnitude)) > _repeat(limits, TILE // 2, *is_uniform.shape)
    return is_uniform & ~is_highlight.any(-1)


def _half_defocus(defocus: Tensor, merges: Tensor, operator: ScatterOperator) -> Tensor:
    """Return the defocus of merged blocks in pixels of the half-size picture, 0 elsewhere."""
    a, b, c, d = (pixel.double() for pixel in _blocks(defocus))
    mean = 0.25 * (a + b + c + d)
    square = (mean * mean).where(merges, operator.excess + 1.0)
    half = 0.5 * torch.sqrt(square - operator.excess) * mean.detach().sign()
    return half.where(merges, 0.0).to(defocus.dtype)


def _half_values(values: Tensor, merges: Tensor) -> Tensor:
    """Return the means of merged blocks, 0 elsewhere."""
    a, b, c, d = _blocks(values)
    return (0.25 * ((a + b) + (c + d))).where(merges[..., None], 0.0)


def _double(coarse: Tensor) -> Tensor:
    """Return twice as many rows, by linear interpolation."""
    before, after = torch.cat([coarse[:1], coarse[:-1]]), torch.cat([coarse[1:], coarse[-1:]])
    pairs = torch.stack([0.75 * coarse + 0.25 * before, 0.75 * coarse + 0.25 * after], dim=1)
    return pairs.flatten(0, 1)


def _between(coarse: Tensor) -> Tensor:
    """Return the h rows with the mean of each adjacent pair between them, 2 h - 1 rows."""
    pairs = torch.stack([coarse[:-1], 0.5 * (coarse[:-1] + coarse[1:])], dim=1)
    return torch.cat([pairs.flatten(0, 1), coarse[-1:]])


def _along_both_axes(rows: Callable[[Tensor], Tensor], coarse: Tensor) -> Tensor:
    """Apply a function of rows along both axes."""
    return rows(rows(coarse).transpose(0, 1)).transpose(0, 1)


def _scatter_near_and_far(values: Tensor, defocus: Tensor, lens: _Lens, view: View | None) -> Tensor:
    """Scatter one level; shapes beyond the radius table recursively on every second pixel."""
    far = defocus.detach().abs() > LARGEST_TABLE
    if lens.shape is None or not far.any():
        return scatter_level(values, defocus, lens.shape, view)
    height, width = defocus.shape
    near_values, near_defocus = values.masked_fill(far[..., None], 0.0), defocus.masked_fill(far, 0.0)
    sums = scatter_level(near_values, near_defocus, lens.shape, view)
    for y, x in ((0, 0), (0, 1), (1, 0), (1, 1)):
        far_pixels = far[y::2, x::2]
        if not far_pixels.any():
            continue
        coarse_values = (values[y::2, x::2] / 4).where(far_pixels[..., None], 0.0)
        coarse_defocus = (defocus[y::2, x::2] / 2).where(far_pixels, 0.0)
        coarse_values = functional.pad(coarse_values, (0, 0, 1, 1, 1, 1))
        coarse_defocus = functional.pad(coarse_defocus, (1, 1, 1, 1))
        coarse_view = every_second(view, x - 2, y - 2) if view else None
        coarse = _scatter_near_and_far(coarse_values, coarse_defocus, lens, coarse_view)
        sums = sums + _along_both_axes(_between, coarse)[2 - y :, 2 - x :][:height, :width]
    return sums


def _scatter(values: Tensor, defocus: Tensor, lens: _Lens, scale: float) -> Tensor:
    """Scatter this level and all smaller ones; ``scale`` is the pixel size in full-size pixels."""
    view, (left, top, full_width, full_height) = None, lens.viewport.as_tuple()
    if lens.shape and lens.shape.cats_eye:
        view = make_view(lens.shape.cats_eye, (full_height, full_width), scale, (left, top))
    merges = _merges(values.detach(), defocus.detach(), lens.operator)
    if not merges.any():
        return _scatter_near_and_far(values, defocus, lens, view)
    height, width = defocus.shape
    merged = _repeat(merges, 2, height, width)
    fine_values, fine_defocus = values.masked_fill(merged[..., None], 0.0), defocus.masked_fill(merged, 0.0)
    fine_sums = _scatter_near_and_far(fine_values, fine_defocus, lens, view)
    half_defocus = _half_defocus(defocus, merges, lens.operator)
    coarse = _scatter(_half_values(values, merges), half_defocus, lens, 2 * scale)
    return fine_sums + _along_both_axes(_double, coarse)[:height, :width]


def check_dtypes(name: str, values: Tensor, defocus: Tensor) -> None:
    """Raise ``ParameterError`` unless both are float32 or both are float64.

    Args:
        name: Name of ``values`` in the error message.
        values: Tensor of values.
        defocus: Tensor of defocus.
    """
    if values.dtype not in (torch.float32, torch.float64) or defocus.dtype != values.dtype:
        raise ParameterError(
            name,
            "float32 or float64, and the same for `defocus`",
            str(values.dtype),
            "convert them with .float()",
            shown=f"{values.dtype} and {defocus.dtype}",
        )


@not_compiled  # sizes depend on the data
def scatter_sums(
    values: Tensor, defocus: Tensor, aperture: Aperture | None = None, viewport: Viewport | None = None
) -> Tensor:
    """Return the sums of values scattered over shapes, on the device of the tensors.

    Args:
        values: Values of the pixels, (H, W, C), float32 or float64; a channel of ones returns the weights for
            normalisation.
        defocus: Signed blur radius in pixels, positive in front of focus, (H, W), of the same dtype and
            device, at most ``LARGEST_RADIUS``.
        aperture: Shape of the aperture; default: a disc.
        viewport: Position of the pixels in the full picture, for a cat's-eye; default: the whole picture.

    Returns:
        Sums (H, W, C), bit-identical in every run, once differentiable in both tensors.

    Raises:
        ParameterError: The dtypes differ or are not supported.
    """
    check_dtypes("values", values, defocus)
    shape = None if aperture is None or aperture.is_disc else aperture
    viewport = viewport or Viewport.whole(defocus.shape[0], defocus.shape[1])
    return _scatter(values, defocus, _Lens(shape, scatter_operator(shape), viewport), 1.0)
