"""RepairNet: aligns the edges of an imperfect disparity map with the picture."""

import math
from dataclasses import dataclass
from itertools import chain

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.optics.encoding import encode

__all__ = ["RepairNet", "RepairNetConfig", "extremes"]

# Disparity range below which a window is flat, as a fraction of the range of the whole map.
FLAT = 0.01

# Minimum disparity range of a depth edge, as a fraction of the range of the whole map.
_MIN_STEP = 0.05

# Clamp of the logit input: the assumed uncertainty of a pixel at an extreme of its window.
_LOGIT_EPSILON = 0.02

# Minimum change, logits, that moves a pixel. Growth of foregrounds needs less than shrinkage: a foreground
# rim at background depth remains visible, the reverse hardly does.
_MIN_GROW_LOGIT = 1.0
_MIN_SHRINK_LOGIT = 3.0

# Minimum change, logits, with which a pixel votes to move the adjacent edge.
_MIN_VOTE_LOGIT = 0.5

# Exponent of the near and far weights of a pixel: soft edges hold few pure pixels.
_PURITY_EXPONENT = 4


@dataclass(frozen=True, kw_only=True)
class RepairNetConfig:
    """Shape of a RepairNet.

    Attributes:
        widths: Channels at 1/2, 1/4, 1/8 of the resolution.
        radii: Half widths, rising, of the windows whose extremes are inputs, pixels. The output stays between
            the extremes of the largest window.
        color_cells: Cell sides, pixels, rising powers of two up to 8; a pixel's colour is compared with those
            of near and far pixels in 5x5 cells.
    """

    widths: tuple[int, int, int] = (32, 48, 64)
    radii: tuple[int, ...] = (1, 2, 4, 7)
    color_cells: tuple[int, ...] = (2, 4, 8)


def _window_maximum(x: Tensor, radius: int) -> Tensor:
    """Return the maximum of the square window around each pixel, along rows, then columns."""
    size = 2 * radius + 1
    across = F.max_pool2d(x, (1, size), 1, (0, radius))
    return F.max_pool2d(across, (size, 1), 1, (radius, 0))


def extremes(disparity: Tensor, radii: tuple[int, ...]) -> list[tuple[Tensor, Tensor]]:
    """Return the minimum and maximum of each window around a pixel, from the smallest window up.

    Args:
        disparity: Disparity, (B, 1, H, W).
        radii: Half widths of the square windows, rising.

    Returns:
        Minimum and maximum of each window, (B, 1, H, W).
    """
    low, high, reached = -disparity, disparity, 0
    windows = []
    for radius in radii:
        # The extremes over a window are the extremes of the extremes over smaller ones.
        low, high = (_window_maximum(x, radius - reached) for x in (low, high))
        windows.append((-low, high))
        reached = radius
    return windows


def color_similarity(colors: Tensor, relative: Tensor, cell: int) -> Tensor:
    """Return the similarity of a pixel's colour to the near or to the far pixels around it.

    Args:
        colors: Encoded colours, (B, 3, H, W), sides multiples of ``cell``.
        relative: Disparity relative to the extremes of its window, 0 to 1, (B, 1, H, W).
        cell: Side of the cells, pixels, of which 5x5 are compared.

    Returns:
        (B, 1, H, W) from -1, like the far pixels, to 1, like the near ones.
    """
    small, nearness = F.avg_pool2d(colors, cell), F.avg_pool2d(relative, cell)
    squares = []
    for side in (nearness, 1 - nearness):
        weight = side**_PURITY_EXPONENT
        # Along rows, then columns, which is 2.5 times as fast.
        across = F.avg_pool2d(torch.cat([weight * small, weight], dim=1), (1, 5), 1, padding=(0, 2))
        sums = F.avg_pool2d(across, (5, 1), 1, padding=(2, 0))
        mean = sums[:, :3] / (sums[:, 3:] + 1e-3)
        difference = colors - F.interpolate(mean, scale_factor=cell, mode="nearest")
        squares.append(difference.square().mean(dim=1, keepdim=True))
    near, far = squares
    return (far - near) / (far + near + 1e-3)


class RepairNet(nn.Module):
    """Network that predicts each pixel's position between the farthest and the nearest surface around it.

    The output stays within the range of the window around a pixel, so flat regions are unchanged and no new
    depths appear. A pixel with too little evidence keeps its exact value. Adding a constant to the map, or
    scaling map and ``span`` by a positive factor, adds to or scales the result.

    Shape:
        image (B, 3, H, W), scene-linear; disparity (B, 1, H, W), any unit and offset; span (B, 1, 1, 1), its
        range over the whole map, above 0. H and W multiples of 8. Returns the
        repaired disparity (B, 1, H, W), and votes (B, 4): the number of pixels on the far side of an edge
            that vote to become near, the number of all such pixels, and both numbers for the near side.
    """

    config: RepairNetConfig

    def __init__(self, config: RepairNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 3 + 2 * len(config.radii) + len(config.color_cells)
        self.unet = UNet(4 * channels, 1, config.widths)

    def position_logits(
        self, image: Tensor, disparity: Tensor, span: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Return the logits of the position between the extremes, before and after, and the extremes."""
        *inner, (low, high) = extremes(disparity, self.config.radii)
        width = high - low
        scale = 1 / (width + FLAT * span)
        relative = [(x - low) * scale for x in (disparity, *chain.from_iterable(inner))]
        strength = torch.log1p(width / (FLAT * span)) / math.log1p(1 / FLAT)
        colors, position = encode(image), relative[0].clamp(0, 1)
        similarities = [color_similarity(colors, position, cell) for cell in self.config.color_cells]
        features = torch.cat([colors, *relative, strength, *similarities], dim=1)
        before = torch.logit(position, _LOGIT_EPSILON)
        return before, before + self.unet.from_full_size(features).float(), low, high

    def forward(self, image: Tensor, disparity: Tensor, span: Tensor) -> tuple[Tensor, Tensor]:
        """Return the repaired disparity, and votes on the edge positions of the input."""
        before, after, low, high = self.position_logits(image, disparity, span)
        change = after - before
        step, near = high - low > _MIN_STEP * span, before > 0
        sides = (step & ~near, change > _MIN_VOTE_LOGIT), (step & near, change < -_MIN_VOTE_LOGIT)
        votes = [x.sum(dim=(1, 2, 3)) for side, in_favour in sides for x in (side & in_favour, side)]
        change = (change - _MIN_GROW_LOGIT).clamp(min=0) + (change + _MIN_SHRINK_LOGIT).clamp(max=0)
        repaired = disparity + (high - low) * ((before + change).sigmoid() - before.sigmoid())
        return torch.minimum(torch.maximum(repaired, low), high), torch.stack(votes, dim=1).float()
