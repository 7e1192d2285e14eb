"""RepairNet: moves the edges of an imperfect disparity map to where the picture has them."""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.optics.encoding import encode

__all__ = ["RepairNet", "RepairNetConfig", "extremes"]

# A span of the disparity, as a share of the whole map's, below which a window counts as flat.
FLAT = 0.01

# A pixel at an extreme of its window is taken to stand there with this much doubt.
_SURE = 0.02

# Evidence, in logits, below which nothing moves. Foregrounds grow more readily than they shrink: a rim of the
# foreground that counts as background stays visible, the reverse hardly does.
_GROW = 1.0
_SHRINK = 3.0

# Power of the share by which a pixel counts as near or far: softened steps hold few pure ones.
_PURITY = 4


@dataclass(frozen=True, kw_only=True)
class RepairNetConfig:
    """Shape of a RepairNet.

    Attributes:
        widths: Channels at 1/2, 1/4, 1/8 of the picture's size.
        radii: Half widths, rising, of the windows whose extremes it sees, pixels. What it gives stays
            between the extremes of the largest.
        color_radii: Half widths of the windows in which a pixel's colour is compared with those of near and
            far pixels, in units of two pixels.
    """

    widths: tuple[int, int, int] = (32, 48, 64)
    radii: tuple[int, ...] = (1, 2, 4, 7)
    color_radii: tuple[int, ...] = (2, 5, 9)


def extremes(disparity: Tensor, radii: tuple[int, ...]) -> Tensor:
    """The smallest and the largest value of each window around a pixel, from the smallest window on.

    Args:
        disparity: (B, 1, H, W).
        radii: Half widths of the square windows, rising.

    Returns:
        (B, 2 * len(radii), H, W).
    """
    low, high, reached = -disparity, disparity, 0
    values = []
    for radius in radii:
        # The extremes over a window are the extremes of the extremes over smaller ones.
        size = 2 * (radius - reached) + 1
        low, high = (F.max_pool2d(x, size, stride=1, padding=size // 2) for x in (low, high))
        values += [-low, high]
        reached = radius
    return torch.cat(values, dim=1)


def likeness(colors: Tensor, relative: Tensor, radius: int) -> Tensor:
    """Whether a pixel has the colour of what is near around it, or of what is far.

    Args:
        colors: Encoded, (B, 3, H, W), sides even.
        relative: Disparity between the extremes of its window, 0 to 1, (B, 1, H, W).
        radius: Half width of the window that tells the colours of both, in units of two pixels.

    Returns:
        (B, 1, H, W) from -1, like the far pixels, to 1, like the near ones.
    """

    def box(x: Tensor) -> Tensor:
        across = F.avg_pool2d(x, (1, 2 * radius + 1), 1, (0, radius))
        return F.avg_pool2d(across, (2 * radius + 1, 1), 1, (radius, 0))

    small, share = F.avg_pool2d(colors, 2), F.avg_pool2d(relative, 2)
    squares = []
    for side in (share, 1 - share):
        weight = side**_PURITY
        mean = box(weight * small) / (box(weight) + 1e-3)
        difference = colors - F.interpolate(mean, scale_factor=2, mode="nearest")
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
        repaired disparity (B, 1, H, W).
    """

    config: RepairNetConfig

    def __init__(self, config: RepairNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 3 + 2 * len(config.radii) + len(config.color_radii)
        self.unet = UNet(4 * channels, 1, config.widths)

    def place(self, image: Tensor, disparity: Tensor, span: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Logits of the place between the extremes, before and after, and those extremes; (B, 1, H, W)."""
        values = extremes(disparity, self.config.radii)
        low, high = values[:, -2:-1], values[:, -1:]
        width = high - low
        relative = (torch.cat([disparity, values[:, :-2]], dim=1) - low) / (width + FLAT * span)
        strength = torch.log1p(width / (FLAT * span)) / math.log1p(1 / FLAT)
        colors, own = encode(image), relative[:, :1].clamp(0, 1)
        alike = [likeness(colors, own, radius) for radius in self.config.color_radii]
        features = torch.cat([colors, relative, strength, *alike], dim=1)
        before = torch.logit(own, _SURE)
        return before, before + self.unet(F.pixel_unshuffle(features, 2)).float(), low, high

    def forward(self, image: Tensor, disparity: Tensor, span: Tensor) -> Tensor:
        """Return the repaired disparity."""
        before, after, low, high = self.place(image, disparity, span)
        change = after - before
        change = (change - _GROW).clamp(min=0) + (change + _SHRINK).clamp(max=0)
        moved = disparity + (high - low) * ((before + change).sigmoid() - before.sigmoid())
        return torch.minimum(torch.maximum(moved, low), high)
