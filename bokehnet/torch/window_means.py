"""Picture from the rays' means: blurred surfaces are averaged over windows of pixels.

The rule is that of :mod:`bokehnet.classical.layered.march.ray_averages`, with square windows of fixed sizes
and a linear blend from one size to the next.
"""

import torch
from torch import Tensor
from torch.nn import functional

__all__ = ["BACK", "FRONT", "GROUPS", "SHARP", "SHARP_RADIUS_PX", "average_windows"]

# Groups of surfaces, and the radius in pixels below which a surface is sharp.
GROUPS, FRONT, SHARP, BACK = 3, 0, 1, 2
SHARP_RADIUS_PX = 4.0

# Half-widths of the windows, pixels, and half-width over the blur radius of what a window averages.
_REACHES_PX = (1, 2, 4, 8, 16, 32)
_REACH_BY_RADIUS = 1 / 12

_EPSILON = 1e-9


def _line_sums(sums: Tensor, reach: int, axis: int) -> Tensor:
    """Return the sums over ``2 reach + 1`` pixels along an axis, by doubling; ``reach`` is a power of two."""
    length, side = sums.shape[axis], 2 * reach
    padded = functional.pad(sums, (0, 0, reach, reach) if axis == -2 else (reach, reach))
    total, count = padded, 1
    while count < side:
        rest = total.shape[axis] - count
        total = total.narrow(axis, 0, rest) + total.narrow(axis, count, rest)
        count *= 2
    return total.narrow(axis, 0, length) + padded.narrow(axis, side, length)


def _window_sums(sums: Tensor, reach: int) -> Tensor:
    """Return the sums over windows, (B, N, H, W); pixels beyond the border count as 0."""
    return _line_sums(_line_sums(sums, reach, -1), reach, -2)


def _reach(window: Tensor, group: int) -> Tensor:
    """Return the half-width of a window that the discs of a group allow, pixels, (B, 1, H, W)."""
    weight, steepness = window[:, group, -2:].unbind(1)
    return (_REACH_BY_RADIUS * weight / steepness.clamp(min=_EPSILON)).clamp(1, _REACHES_PX[-1])[
        :, None, None
    ]


def _average(windows: list[Tensor], group: int) -> Tensor:
    """Return the widest window that the discs of a group allow, as means over the weight of all groups."""
    result = windows[0]
    allowed = torch.ones_like(result[:, :1, :1])
    for last, reach, window in zip(_REACHES_PX, _REACHES_PX[1:], windows[1:], strict=False):
        within = torch.minimum(_reach(result, group), _reach(window, group))
        step = ((within - last) / (reach - last)).clamp(0, 1) * allowed
        allowed = allowed * (step >= 1)
        result = torch.lerp(_normalised(result), _normalised(window), step)
    return _normalised(result)


def _normalised(window: Tensor) -> Tensor:
    return window / window[:, :, -2:-1].sum(1, keepdim=True).clamp(min=_EPSILON)


def average_windows(sums: Tensor) -> Tensor:
    """Return the picture (B, C, H, W).

    Args:
        sums: Sums over the rays of each pixel, (B, GROUPS, C + 2, H, W): weighted colours, weight, and weight
            over the blur radius.
    """
    batch, groups, numbers, height, width = sums.shape
    flat = sums.reshape(batch, groups * numbers, height, width)
    used = [reach for reach in _REACHES_PX if reach <= max(1, min(height, width) // 4)]
    windows = [_window_sums(flat, reach).view_as(sums) for reach in used]
    front_window, back_window = (_average(windows, group) for group in (FRONT, BACK))
    colors, weights = front_window[:, :, :-2], front_window[:, :, -2:-1]
    own_colors, own_weights = sums[:, :, :-2], sums[:, :, -2:-1]
    back_color = back_window[:, BACK, :-2] / back_window[:, BACK, -2:-1].clamp(min=_EPSILON)
    own = own_weights[:, SHARP] + own_weights[:, BACK]
    rest = (own_colors[:, SHARP] + own_weights[:, BACK] * back_color) / own.clamp(min=_EPSILON)
    around = weights[:, SHARP] + weights[:, BACK]
    rest_around = (colors[:, SHARP] + colors[:, BACK]) / around.clamp(min=_EPSILON)
    rest = torch.where(own > _EPSILON, rest, rest_around)
    return colors[:, FRONT] + (1 - weights[:, FRONT]) * rest
