"""RepairNet: moves the edges of an imperfect disparity map to where the picture has them."""

import math
from dataclasses import dataclass
from itertools import chain

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.optics.encoding import encode

__all__ = ["RepairNet", "RepairNetConfig", "extremes"]

# A span of the disparity, as a share of the whole map's, below which a window counts as flat.
FLAT = 0.01

# A span, as a share of the whole map's, that makes a step.
_STEP = 0.05

# A pixel at an extreme of its window is taken to stand there with this much doubt.
_SURE = 0.02

# Evidence, in logits, below which nothing moves. Foregrounds grow more readily than they shrink: a rim of the
# foreground that counts as background stays visible, the reverse hardly does.
_GROW = 1.0
_SHRINK = 3.0

# Evidence from which on a pixel votes for the step beside it to move.
_VOTE = 0.5

# Power of the share by which a pixel counts as near or far: softened steps hold few pure ones.
_PURITY = 4


@dataclass(frozen=True, kw_only=True)
class RepairNetConfig:
    """Shape of a RepairNet.

    Attributes:
        widths: Channels at 1/2, 1/4, 1/8 of the picture's size.
        radii: Half widths, rising, of the windows whose extremes it sees, pixels. What it gives stays
            between the extremes of the largest.
        color_cells: Powers of two, rising; a pixel's colour is compared with those of near and far pixels in
            5x5 cells of that many pixels a side, at most 8.
    """

    widths: tuple[int, int, int] = (32, 48, 64)
    radii: tuple[int, ...] = (1, 2, 4, 7)
    color_cells: tuple[int, ...] = (2, 4, 8)


def _largest(x: Tensor, radius: int) -> Tensor:
    """The largest value of the square window around each pixel, along rows, then columns."""
    size = 2 * radius + 1
    across = F.max_pool2d(x, (1, size), 1, (0, radius))
    return F.max_pool2d(across, (size, 1), 1, (radius, 0))


def extremes(disparity: Tensor, radii: tuple[int, ...]) -> list[tuple[Tensor, Tensor]]:
    """The smallest and the largest value of each window around a pixel, from the smallest window on.

    Args:
        disparity: (B, 1, H, W).
        radii: Half widths of the square windows, rising.

    Returns:
        For each window its two extremes, (B, 1, H, W).
    """
    low, high, reached = -disparity, disparity, 0
    windows = []
    for radius in radii:
        # The extremes over a window are the extremes of the extremes over smaller ones.
        low, high = (_largest(x, radius - reached) for x in (low, high))
        windows.append((-low, high))
        reached = radius
    return windows


def likeness(colors: Tensor, relative: Tensor, cell: int) -> Tensor:
    """Whether a pixel has the colour of what is near around it, or of what is far.

    Args:
        colors: Encoded, (B, 3, H, W), sides multiples of ``cell``.
        relative: Disparity between the extremes of its window, 0 to 1, (B, 1, H, W).
        cell: Side, in pixels, of the cells whose colours are taken together, 5x5 of them.

    Returns:
        (B, 1, H, W) from -1, like the far pixels, to 1, like the near ones.
    """
    small, share = F.avg_pool2d(colors, cell), F.avg_pool2d(relative, cell)
    squares = []
    for side in (share, 1 - share):
        weight = side**_PURITY
        # Along rows, then columns, which is 2.5 times as fast.
        across = F.avg_pool2d(torch.cat([weight * small, weight], dim=1), (1, 5), 1, padding=(0, 2))
        sums = F.avg_pool2d(across, (5, 1), 1, padding=(2, 0))
        mean = sums[:, :3] / (sums[:, 3:] + 1e-3)
        difference = colors - F.interpolate(mean, scale_factor=cell, mode="nearest")
        squares.append(difference.square().mean(dim=1, keepdim=True))
    near, far = squares
    return (far - near) / (far + near + 1e-3)


class RepairNet(nn.Module):
    """Tells how near each pixel stands between the farthest and the nearest surface around it.

    What it gives stays inside the window around a pixel: flat regions remain as they are, and nothing is
    invented. A pixel for which it sees no reason to move stays exactly where it is. Adding a constant to the
    map, or scaling it by a positive factor, adds to or scales the result when ``span`` is scaled alike.

    Shape:
        image (B, 3, H, W), scene-linear; disparity (B, 1, H, W), any unit and offset; span (B, 1, 1, 1),
        its largest minus smallest value over the whole map, above 0. H and W multiples of 8. Returns the
        repaired disparity (B, 1, H, W), and votes (B, 4): how many pixels on the far side of a step have
        reason to become near, how many there are, and both numbers of those on the near side.
    """

    config: RepairNetConfig

    def __init__(self, config: RepairNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 3 + 2 * len(config.radii) + len(config.color_cells)
        self.unet = UNet(4 * channels, 1, config.widths)

    def place(self, image: Tensor, disparity: Tensor, span: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Logits of the place between the extremes, before and after, and those extremes; (B, 1, H, W)."""
        *inner, (low, high) = extremes(disparity, self.config.radii)
        width = high - low
        scale = 1 / (width + FLAT * span)
        relative = [(x - low) * scale for x in (disparity, *chain.from_iterable(inner))]
        strength = torch.log1p(width / (FLAT * span)) / math.log1p(1 / FLAT)
        colors, own = encode(image), relative[0].clamp(0, 1)
        alike = [likeness(colors, own, cell) for cell in self.config.color_cells]
        features = torch.cat([colors, *relative, strength, *alike], dim=1)
        before = torch.logit(own, _SURE)
        return before, before + self.unet.from_full_size(features).float(), low, high

    def forward(self, image: Tensor, disparity: Tensor, span: Tensor) -> tuple[Tensor, Tensor]:
        """Return the repaired disparity, and votes on where it stands as it is."""
        before, after, low, high = self.place(image, disparity, span)
        change = after - before
        step, near = high - low > _STEP * span, before > 0
        sides = (step & ~near, change > _VOTE), (step & near, change < -_VOTE)
        votes = [x.sum(dim=(1, 2, 3)) for side, for_it in sides for x in (side & for_it, side)]
        change = (change - _GROW).clamp(min=0) + (change + _SHRINK).clamp(max=0)
        moved = disparity + (high - low) * ((before + change).sigmoid() - before.sigmoid())
        return torch.minimum(torch.maximum(moved, low), high), torch.stack(votes, dim=1).float()
