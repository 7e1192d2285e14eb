"""Continuation of a picture beyond its border in torch: :mod:`bokehnet.arrays.beyond_border`."""

import math

import torch
from torch import Tensor

from bokehnet.arrays.beyond_border import COMPARED_PX, LAMP_RATIOS, LIGHT_FLOOR, LINE_RATIOS
from bokehnet.classical.scatter_renderer import MAX_CONTINUATION

__all__ = ["beyond_border", "continuation_px", "repeat_border"]


def continuation_px(defocus: Tensor) -> int:
    """Return the pixels to add on each side of a picture: the largest radius, with an upper bound.

    Args:
        defocus: Signed blur radius in pixels, (..., H, W). Under ``torch.func.vmap`` its values are unknown,
            and the bound is returned.
    """
    limit = math.ceil(MAX_CONTINUATION * min(defocus.shape[-2:]))
    if torch._C._functorch.is_batchedtensor(defocus):
        return limit
    return min(math.ceil(float(defocus.detach().abs().max())), limit)


def repeat_border(x: Tensor, reach: int) -> Tensor:
    """Return (..., H, W) with ``reach`` more pixels on every side that repeat the border."""
    for axis in (-2, -1):
        positions = torch.arange(-reach, x.shape[axis] + reach, device=x.device)
        x = x.index_select(axis, positions.clamp(0, x.shape[axis] - 1))
    return x


def _median(x: Tensor, axis: int) -> Tensor:
    return torch.quantile(x, 0.5, axis, keepdim=True)


def _weight(ratio: Tensor, ends: tuple[float, float]) -> Tensor:
    """Return 0 up to the first end, 1 from the second on, and linear values between."""
    low, high = ends
    return ((ratio - low) / (high - low)).clamp(0, 1)


def _continuation(rows: Tensor, count: int) -> Tensor:
    """Return ``count`` rows beyond the first of ``rows`` (C, H, W), from the border outwards."""
    nearest = rows[:, :COMPARED_PX]
    light = nearest.mean(0) + LIGHT_FLOOR
    ratio = light[:1] / _median(light, 0)
    of_side = _median(ratio, 1)
    of_side = torch.maximum(of_side, 1 / of_side)
    weight = torch.maximum(_weight(ratio, LAMP_RATIOS), _weight(of_side, LINE_RATIOS))
    number, compared = torch.arange(count, device=rows.device), nearest.shape[1]
    mirrored = nearest.index_select(1, number.clamp(max=compared - 1))
    is_mirrored = (number < compared // 2 + 1)[:, None]
    other = torch.where(is_mirrored, mirrored, _median(nearest, 1))
    return rows[:, :1] * (1 - weight) + other * weight


def _with_rows(picture: Tensor, count: int) -> Tensor:
    above, below = _continuation(picture, count), _continuation(picture.flip(1), count)
    return torch.cat([above.flip(1), picture, below], 1)


def beyond_border(picture: Tensor, reach: int) -> Tensor:
    """Return a picture (C, H, W) with ``reach`` more pixels on every side; differentiable."""
    if reach == 0:
        return picture
    return _with_rows(_with_rows(picture.mT, reach).mT, reach)
