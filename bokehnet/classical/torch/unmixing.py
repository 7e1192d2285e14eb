"""Pixels at depth discontinuities parted into the two surfaces that they mix, with gradients. Needs torch.

Model and formulas are those of :mod:`bokehnet.classical.layered.boundaries.unmixing`, on tensors of any
device. Which pixels are mixed, and which two surfaces they show, follows from the defocus and has no
gradient; colours and shares are differentiable in the picture and in a share that is given, as a network
predicts it. Slight steps (:mod:`bokehnet.classical.layered.slight_steps`) are not looked for here.
"""

from typing import NamedTuple

import torch
from torch import Tensor

from bokehnet.checks import check_rank
from bokehnet.classical.layered.boundaries.unmixing import LEAST_WEIGHT, OF_LIGHTS, PRIOR, TIE
from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.errors import ShapeError
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter

__all__ = ["Unmixed", "unmix"]


class Unmixed(NamedTuple):
    """Both surfaces of every pixel; pixels that mix none show the picture, covered by their own surface.

    Attributes:
        front: Colours of the nearer surface, (B, 3, H, W).
        back: Of the farther one, (B, 3, H, W).
        coverage: Share of the nearer surface, (B, 1, H, W) in [0, 1].
        near: Defocus of the nearer surface, (B, 1, H, W).
        far: Of the farther one, (B, 1, H, W).
        is_front: Whether the pixel's own depth is the nearer one, (B, 1, H, W) bool.
        mixed: Which pixels were parted, (B, 1, H, W) bool.
    """

    front: Tensor
    back: Tensor
    coverage: Tensor
    near: Tensor
    far: Tensor
    is_front: Tensor
    mixed: Tensor


class _Windows:
    """Values around N places of a batch, up to ``reach`` pixels away, row by row."""

    def __init__(self, places: tuple[Tensor, Tensor, Tensor], reach: int, height: int, width: int) -> None:
        batch, y, x = places
        steps = torch.arange(-reach, reach + 1, device=y.device)
        self.offsets = torch.cartesian_prod(steps, steps).T
        v, u = y[:, None] + self.offsets[0], x[:, None] + self.offsets[1]
        self.inside = (v >= 0) & (v < height) & (u >= 0) & (u < width)
        self.index = batch[:, None], v.clamp(0, height - 1), u.clamp(0, width - 1)

    def of(self, values: Tensor) -> Tensor:
        """What (B, H, W) or (B, H, W, C) holds there, (N, window) or (N, window, C); beyond it goes on."""
        return values[self.index]


def _sides(defocus: Tensor, reach: int) -> Tensor:
    """Which pixels of (B, H, W) have another surface within ``reach`` pixels, (B, H, W) bool."""
    size = 2 * reach + 1
    high = torch.nn.functional.max_pool2d(defocus[:, None], size, 1, reach)[:, 0]
    low = -torch.nn.functional.max_pool2d(-defocus[:, None], size, 1, reach)[:, 0]
    return (high > defocus + DISCONTINUITY_THRESHOLD) | (low < defocus - DISCONTINUITY_THRESHOLD)


def _surfaces(around: Tensor, own: Tensor, weights: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Near and far defocus of N pixels, the share of the nearer, and whether that is their own, (N,)."""
    in_front = around > own[:, None] + DISCONTINUITY_THRESHOLD
    beyond = around < own[:, None] - DISCONTINUITY_THRESHOLD
    before, behind, same = (weights * side for side in (in_front, beyond, ~in_front & ~beyond))
    before, behind, same = before.sum(1), behind.sum(1), same.sum(1)
    nearest = torch.where(in_front, around, own[:, None]).amax(1)
    farthest = torch.where(beyond, around, own[:, None]).amin(1)
    is_front = before < behind - TIE
    near, far = torch.where(is_front, own, nearest), torch.where(is_front, farthest, own)
    share = torch.where(is_front, same / (behind + same), before / (before + same))
    return near, far, share, is_front


def _mean(colors: Tensor, weights: Tensor, pixel: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted means (N, 3) of windows (N, window, 3), and variances (N,): below 0 where nothing has weight.

    Squares are taken about the pixel, which changes nothing but rounding.
    """
    total = weights.sum(1)
    none = total == 0
    part = weights / torch.where(none, 1.0, total)[:, None]
    away = colors - pixel.detach()[:, None]
    mean = (part[..., None] * away).sum(1)
    square = (part * (away * away).sum(-1)).sum(1)
    variance = (square - (mean * mean).sum(-1)).clamp(min=0.0) / 3.0
    found = torch.where(none[:, None], pixel, mean + pixel.detach())
    return found, torch.where(none, -1.0, variance)


def _most_variances(colors: Tensor, pure: list[Tensor], pixel: Tensor) -> list[Tensor]:
    """Most variance of parted pixels of two surfaces, (N,) each, by which of windows (N, window) are pure."""
    most = [PRIOR.pure_ratio * _mean(colors, which.to(colors.dtype), pixel)[1] for which in pure]
    known = (pure[0].sum(1) >= PRIOR.pure) & (pure[1].sum(1) >= PRIOR.pure)
    return [torch.where(known, variance, torch.inf) for variance in most]


def _part(
    pixel: Tensor,
    front: Tensor,
    back: Tensor,
    share: Tensor,
    share_spread: float,
    variances: tuple[Tensor, Tensor],
) -> tuple[Tensor, Tensor, Tensor]:
    """The most probable colours (N, 3) and share (N, 1), of means, a first share and variances (N, 1)."""

    def weights(share: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        own, other = share * variances[0], (1.0 - share) * variances[1]
        return own, other, share * own + (1.0 - share) * other

    own, other, spread = weights(share)
    shift = share_spread**2
    difference = front - back
    error = pixel - share * front - (1.0 - share) * back
    along = (difference * error).sum(1, keepdim=True)
    along = along / (spread + shift * (difference * difference).sum(1, keepdim=True))
    multiplier = (error - shift * along * difference) / spread
    front, back = front + own * multiplier, back + other * multiplier
    share = (share + shift * along).clamp(0.0, 1.0)
    own, other, spread = weights(share)
    error = pixel - share * front - (1.0 - share) * back
    front, back = front + own / spread * error, back + other / spread * error
    least = pixel.clamp(max=0.0)
    too_dark = (front < least) & (share < 1.0)
    other_dark = ~too_dark & (back < least) & (share > 0.0)
    rest_behind = (pixel - share * least) / torch.where(share < 1.0, 1.0 - share, 1.0)
    rest_before = (pixel - (1.0 - share) * least) / torch.where(share > 0.0, share, 1.0)
    parted_front = torch.where(too_dark, least, torch.where(other_dark, rest_before, front))
    parted_back = torch.where(too_dark, rest_behind, torch.where(other_dark, least, back))
    return parted_front, parted_back, share


def _part_means(
    pixel: Tensor,
    found: list[tuple[Tensor, Tensor]],
    most: list[Tensor],
    share: Tensor,
    share_spread: float,
) -> tuple[Tensor, Tensor, Tensor]:
    """As :func:`_part`, of means and variances (N,), below 0 for nothing to average, at the most ``most``."""
    means = [mean for mean, _ in found]
    variances = [torch.minimum(variance, limit) for (_, variance), limit in zip(found, most, strict=True)]
    alone = ((variances[0] < 0) | (variances[1] < 0))[:, None]  # nothing tells the two apart
    front, back = (torch.where(alone, pixel, mean) for mean in means)
    least = PRIOR.least**2 + PRIOR.relative**2 * (front**2 + back**2).sum(1, keepdim=True) / 3.0
    both = [torch.where(alone, 1.0, variance[:, None]) + least for variance in variances]
    return _part(pixel, front, back, share, share_spread, (both[0], both[1]))


def _shown(
    surface: Tensor, others: Tensor, around: Tensor, colors: Tensor, parted: tuple[Tensor, ...]
) -> tuple[Tensor, Tensor]:
    """What the pixels around show of a surface (N, 1): colours (N, window, 3) and weights (N, window).

    ``others`` are the numbers of parted pixels, -1 for whole ones, of defocus ``around`` and ``colors``.
    """
    near, far, front, back, share = parted
    is_parted, number = others >= 0, others.clamp(min=0)
    to_near, to_far = (near[number] - surface).abs(), (far[number] - surface).abs()
    in_front = is_parted & (to_near <= to_far) & (to_near <= DISCONTINUITY_THRESHOLD)
    behind = is_parted & (to_far < to_near) & (to_far <= DISCONTINUITY_THRESHOLD)
    whole = ~is_parted & ((around - surface).abs() <= DISCONTINUITY_THRESHOLD)
    shown = torch.where(in_front[..., None], front[number], back[number])
    shown = torch.where(is_parted[..., None], shown, colors)
    part = torch.where(in_front, share[number, 0], 1.0 - share[number, 0])
    return shown, whole + (in_front | behind) * (part * part + PRIOR.unseen)


def _placed(
    first: Tensor, others: Tensor, falloff: Tensor, parted: tuple[Tensor, Tensor, Tensor, Tensor, Tensor]
) -> Tensor:
    """First shares (N,) moved to where parted pixels around, of numbers ``others``, say that the edge is."""
    near, far, front, back, share = parted
    slope = (4.0 * first * (1.0 - first)).clamp(min=PRIOR.edge_slope)
    number = others.clamp(min=0)
    same = others >= 0
    for surface in (near, far):
        same = same & ((surface[number] - surface[:, None]).abs() <= DISCONTINUITY_THRESHOLD)
    apart = ((front - back) ** 2).sum(1)
    weight = falloff * same * (apart / (apart + PRIOR.edge_contrast))[number] * slope[number]
    moved = (weight * (share[:, 0] - first)[number]).sum(1)
    shift = moved / ((weight * slope[number]).sum(1) + PRIOR.edge_doubt)
    return (first + slope * shift).clamp(0.0, 1.0)


def unmix(
    image: Tensor,
    defocus: Tensor,
    share: Tensor | None = None,
    spared: Tensor | None = None,
    pixel_filter: PixelFilter = DEFAULT_FILTER,
) -> Unmixed:
    """Part the pixels at depth discontinuities; differentiable in picture and share.

    Args:
        image: All-in-focus pictures, scene-linear, (B, 3, H, W), float32 or float64.
        defocus: Signed blur radius in pixels, (B, 1, H, W), + in front of focus, with sharp steps.
        share: First estimate of the share of the nearer surface, (B, 1, H, W) in [0, 1], read at mixed
            pixels; default: from the defocus and the pixel filter.
        spared: Pixels that stay as they are and tell nothing about their neighbours: lights, (B, 1, H, W)
            bool.
        pixel_filter: Of the pictures.

    Raises:
        ShapeError: The sizes do not fit.
    """
    check_rank("image", image, 4, "(B, 3, H, W)")
    batch, channels, height, width = image.shape
    if channels != 3:
        raise ShapeError(f"image: expected 3 channels, got {channels}")
    for name, tensor in (("defocus", defocus), ("share", share), ("spared", spared)):
        if tensor is not None and tensor.shape != (batch, 1, height, width):
            raise ShapeError(f"{name}: expected {(batch, 1, height, width)}, got {tuple(tensor.shape)}")
    weights = torch.as_tensor(pixel_filter.weights(), dtype=image.dtype, device=image.device)
    weights = weights.clamp(min=LEAST_WEIGHT)
    depth, light = defocus.detach()[:, 0].to(image.dtype), image.movedim(1, -1)
    sides = _sides(depth, len(weights) // 2)
    kept = torch.ones_like(sides) if spared is None else ~spared[:, 0]
    mixed = sides & kept
    batches, rows, columns = torch.nonzero(mixed, as_tuple=True)
    places = batches, rows, columns

    near_by = _Windows(places, len(weights) // 2, height, width)
    near, far, first, is_front = _surfaces(
        near_by.of(depth), depth[places], torch.outer(weights, weights).ravel()
    )
    if share is not None:
        first = share[:, 0][places]

    window = _Windows(places, PRIOR.window, height, width)
    around, colors, pixel = window.of(depth), window.of(light), light[places]
    purity = 1.0 - (1.0 - PRIOR.mixed) * window.of(sides).to(image.dtype)
    falloff = torch.exp(-(window.offsets**2).sum(0) / PRIOR.square).to(image.dtype)
    usable = window.inside * torch.where(window.of(kept), 1.0, OF_LIGHTS) * purity * falloff
    alone = window.inside & ~window.of(sides)

    there = [(around - surface[:, None]).abs() <= DISCONTINUITY_THRESHOLD for surface in (near, far)]
    most = _most_variances(colors, [alone & is_there for is_there in there], pixel)
    found = [_mean(colors, usable * is_there, pixel) for is_there in there]
    spread = PRIOR.share_spread
    front, back, parted = _part_means(pixel, found, most, first[:, None], spread)

    index = torch.full(mixed.shape, -1, device=rows.device)
    index[places] = torch.arange(len(rows), device=rows.device)
    close = _Windows(places, 1, height, width)
    others, around, colors = close.of(index), close.of(depth), close.of(light)
    falloff = torch.exp(-(close.offsets**2).sum(0) / PRIOR.near_square).to(image.dtype)
    usable = (close.inside & close.of(kept)) * falloff
    for number in range(PRIOR.rounds + PRIOR.placed_rounds if len(rows) else 0):
        before = near, far, front, back, parted
        if number == PRIOR.rounds:
            wide = _Windows(places, PRIOR.edge_window, height, width)
            far_off = torch.exp(-(wide.offsets**2).sum(0) / PRIOR.edge_square).to(image.dtype)
            first, spread = _placed(first, wide.of(index), wide.inside * far_off, before), PRIOR.placed_spread
        found = []
        for surface in (near, far):
            shown, weight = _shown(surface[:, None], others, around, colors, before)
            found.append(_mean(shown, usable * weight, pixel))
        front, back, parted = _part_means(pixel, found, most, first[:, None], spread)

    def put(values: Tensor, found: Tensor) -> Tensor:
        return values.index_put(places, found).movedim(-1, 1)

    plain, whole = depth[..., None], torch.ones_like(light[..., :1])
    return Unmixed(
        front=put(light, front),
        back=put(light, back),
        coverage=put(whole, parted),
        near=put(plain, near[:, None]),
        far=put(plain, far[:, None]),
        is_front=put(torch.ones_like(mixed)[..., None], is_front[:, None]),
        mixed=mixed[:, None],
    )
