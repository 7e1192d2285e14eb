"""ErrorNet: how far off the rays are, pixel by pixel, without the truth."""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.optics.encoding import encode

__all__ = ["FEATURES", "ErrorNet", "ErrorNetConfig"]

# What is known besides the pictures, one channel each.
FEATURES = ("defocus", "disocclusion_weight", "error_map")

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
    """Tells the expected absolute error of the rays.

    It looks at how they differ from the picture and from the scatter, and at what they know of themselves:
    the share of light that comes from guessed colours, and where depth is complicated.

    Shape:
        image, rays, scatter (B, 3, H, W), scene-linear; features (B, 3, H, W): defocus in pixels,
        disocclusion weight and error map in [0, 1]. H and W multiples of 8. Returns (B, 1, H, W): what is
        expected of the mean over colours of |sRGB value - truth|, in 8-bit levels.
    """

    config: ErrorNetConfig

    def __init__(self, config: ErrorNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 3 * 3 + 2 + len(FEATURES)
        self.unet = UNet(4 * channels, 1, config.widths)

    def forward(self, image: Tensor, rays: Tensor, scatter: Tensor, features: Tensor) -> Tensor:
        """Return the expected errors."""
        defocus, *rest = features.split(1, dim=1)
        sharp, found, spread = (encode(x) for x in (image, rays, scatter))
        apart = [_size((found - other).abs().mean(1, keepdim=True)) for other in (spread, sharp)]
        blur = torch.log1p(defocus.abs() / _LARGE)
        stacked = torch.cat([sharp, found, spread, *apart, blur, *rest], dim=1)
        told = self.unet(F.pixel_unshuffle(stacked, 2)).float()
        low, high = (math.log(x) for x in _RANGE)
        return (math.log(_FRESH) + told).clamp(low, high).exp()
