"""EdgeNet: the two surfaces that meet in a pixel, and how much of it the nearer one fills."""

import math
from dataclasses import dataclass
from itertools import chain

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.models.repair import FLAT, extremes, likeness
from bokehnet.optics.encoding import encode

__all__ = ["EdgeNet", "EdgeNetConfig", "Surfaces"]

# A pixel at an extreme of its window is taken to stand there with this much doubt.
_SURE = 0.02

# Side of the cells in which the wide window is looked through.
_CELL = 4

# Parts of the wide window's span by which a surface may stand beyond what the map holds there.
_MARGIN = 0.1

# Least and largest scale of a surface's Laplace distribution in parts of the wide window's span, and what a
# fresh network starts from.
_SCALES, _FRESH_SCALE = (0.004, 0.4), 0.05


@dataclass(frozen=True, kw_only=True)
class EdgeNetConfig:
    """Shape of an EdgeNet.

    Attributes:
        widths: Channels at 1/2, 1/4, 1/8 of the picture's size.
        radii: Half widths, rising, of the windows whose extremes it sees, pixels; its first guess of both
            surfaces are those of the largest.
        reach: Half width of the window in which surfaces may be found, pixels, a multiple of 4.
        color_cells: Powers of two, rising; a pixel's colour is compared with those of near and far pixels in
            5x5 cells of that many pixels a side, at most 8.
    """

    widths: tuple[int, int, int] = (32, 64, 96)
    radii: tuple[int, ...] = (1, 2, 4, 7)
    reach: int = 32
    color_cells: tuple[int, ...] = (2, 4, 8)


@dataclass(frozen=True)
class Surfaces:
    """What stands in every pixel: a mixture of two Laplace distributions of disparity, (B, 1, H, W) each.

    Attributes:
        near, far: Middles, in the unit of the map.
        near_scale, far_scale: Scales, in the same unit.
        evidence: Logit of the part of the pixel that the nearer one fills.
    """

    near: Tensor
    far: Tensor
    near_scale: Tensor
    far_scale: Tensor
    evidence: Tensor


def _wide_extremes(disparity: Tensor, reach: int) -> tuple[Tensor, Tensor]:
    """Extremes within ``reach`` pixels and up to 3 more, (B, 1, H, W)."""
    small = [F.max_pool2d(sign * disparity, _CELL) for sign in (-1, 1)]
    (low, _), (_, high) = (extremes(x, (reach // _CELL,))[0] for x in (-small[0], small[1]))
    return F.interpolate(low, scale_factor=_CELL), F.interpolate(high, scale_factor=_CELL)


class EdgeNet(nn.Module):
    """Tells, for every pixel, the nearer and the farther surface in it and how much of it the nearer fills.

    Disparities in a pixel are taken to be drawn from a mixture of two distributions; where a boundary runs
    through it, their weights are the parts that both sides fill. Adding a constant to the map, or scaling it
    by a positive factor, adds to or scales the result when ``span`` is scaled alike.

    Shape:
        image (B, 3, H, W), scene-linear; disparity (B, 1, H, W), any unit and offset; span (B, 1, 1, 1), its
        largest minus smallest value over the whole map, above 0. H and W multiples of 8. Returns near, far
        and evidence as in :class:`Surfaces`, together as (B, 3, H, W).

    Source:
        Tosi, Liao, Schmitt and Geiger, "SMD-Nets: Stereo mixture density networks", CVPR 2021, for the
        mixture; that its weights are a pixel's coverage is ours.
    """

    config: EdgeNetConfig

    def __init__(self, config: EdgeNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 3 + 2 * len(config.radii) + 4 + len(config.color_cells)
        self.unet = UNet(4 * channels, 5, config.widths)

    def surfaces(self, image: Tensor, disparity: Tensor, span: Tensor) -> Surfaces:
        """Both surfaces of every pixel."""
        *inner, (low, high) = extremes(disparity, self.config.radii)
        least, most = _wide_extremes(disparity, self.config.reach)
        width, wide = high - low, most - least + FLAT * span
        scale, wide_scale = 1 / (width + FLAT * span), 1 / ((1 + 2 * _MARGIN) * wide)
        bottom = least - _MARGIN * wide
        relative = [(x - low) * scale for x in (disparity, *chain.from_iterable(inner))]
        placed = [(x - bottom) * wide_scale for x in (disparity, low, high)]
        strengths = [
            torch.log1p(x / (FLAT * span)) / math.log1p(1 / FLAT) for x in (width, wide - FLAT * span)
        ]
        colors, own = encode(image), relative[0].clamp(0, 1)
        alike = [likeness(colors, own, cell) for cell in self.config.color_cells]
        features = torch.cat([colors, *relative, *placed, *strengths, *alike], dim=1)
        near, far, evidence, *scales = self.unet(F.pixel_unshuffle(features, 2)).float().split(1, dim=1)
        near, far = (
            bottom + (torch.logit(start, 1e-3) + change).sigmoid() / wide_scale
            for start, change in ((placed[2], near), (placed[1], far))
        )
        near_scale, far_scale = (
            wide * (math.log(_FRESH_SCALE) + x).clamp(*map(math.log, _SCALES)).exp() for x in scales
        )
        return Surfaces(
            near=near,
            far=far,
            near_scale=near_scale,
            far_scale=far_scale,
            evidence=torch.logit(own, _SURE) + evidence,
        )

    def forward(self, image: Tensor, disparity: Tensor, span: Tensor) -> Tensor:
        """Return near, far and evidence."""
        found = self.surfaces(image, disparity, span)
        return torch.cat([found.near, found.far, found.evidence], dim=1)
