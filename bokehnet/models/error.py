"""ErrorNet: how far off each way to render is, pixel by pixel, without the truth."""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.optics.encoding import encode

__all__ = ["CANDIDATES", "FEATURES", "ErrorNet", "ErrorNetConfig"]

# The ways to render that are told apart.
CANDIDATES = ("rays", "scatter", "neural")

# What is known besides, one channel each.
FEATURES = ("defocus", "noise", "disocclusion_weight", "error_map")

# Least and most that is ever expected, and what a fresh network expects everywhere; 8-bit levels.
_RANGE, _FRESH = (0.05, 128.0), 2.0

# Levels between encoded black and white.
_LEVELS = 255.0

# Blur radius that counts as large, pixels.
_LARGE = 10.0


@dataclass(frozen=True, kw_only=True)
class ErrorNetConfig:
    """Shape of an ErrorNet.

    Attributes:
        widths: Channels at 1/2, 1/4, 1/8 of the picture's size.
    """

    widths: tuple[int, int, int] = (16, 24, 32)


def _size(difference: Tensor) -> Tensor:
    """How large an encoded difference is, on a scale of 0 to 1 on which small ones differ, too."""
    return torch.log1p(_LEVELS * difference) / math.log1p(_LEVELS)


class ErrorNet(nn.Module):
    """Tells the expected absolute error of each of ``CANDIDATES``.

    It looks at where they differ, and at what the rays know of themselves: their noise, the share of light
    that comes from guessed colours, and where depth is complicated.

    Shape:
        image, rays, scatter, neural (B, 3, H, W), scene-linear; features (B, 4, H, W): defocus in pixels,
        standard deviation of the rays' noise in scene-linear light, disocclusion weight and error map in [0,
        1]. H and W multiples of 8. Returns (B, 3, H, W): what is expected of the mean over colours of |sRGB
        value - truth|, in 8-bit levels, for each candidate.
    """

    config: ErrorNetConfig

    def __init__(self, config: ErrorNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 3 * 4 + 3 + len(FEATURES)
        self.unet = UNet(4 * channels, len(CANDIDATES), config.widths)

    def forward(
        self, image: Tensor, rays: Tensor, scatter: Tensor, neural: Tensor, features: Tensor
    ) -> Tensor:
        """Return the expected errors."""
        defocus, noise, *rest = features.split(1, dim=1)
        sharp, *shown = (encode(x) for x in (image, rays, scatter, neural))
        pairs = ((0, 1), (0, 2), (1, 2))
        apart = [_size((shown[i] - shown[j]).abs().mean(1, keepdim=True)) for i, j in pairs]
        middle = rays.mean(1, keepdim=True)
        grain = _size(encode(middle + noise) - encode(middle))
        blur = torch.log1p(defocus.abs() / _LARGE)
        stacked = torch.cat([sharp, *shown, *apart, blur, grain, *rest], dim=1)
        found = self.unet(F.pixel_unshuffle(stacked, 2)).float()
        low, high = (math.log(x) for x in _RANGE)
        return (math.log(_FRESH) + found).clamp(low, high).exp()
