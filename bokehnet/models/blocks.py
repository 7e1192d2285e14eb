"""What ARNet and IUNet are made of."""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

__all__ = ["Backbone", "ResidualBlock", "decode", "encode"]

# Steepness of the encoding near black; at 20 a step in the shadows weighs about as much as in sRGB.
STEEPNESS = 20.0


def encode(linear: Tensor) -> Tensor:
    """Scene-linear light to the perceptual scale the networks work in; 0 to 0, 1 to 1, unbounded above."""
    return torch.log1p(STEEPNESS * linear.clamp(min=0)) / math.log1p(STEEPNESS)


def decode(encoded: Tensor) -> Tensor:
    """Inverse of :func:`encode`; continues smoothly below 0, so that its gradient never vanishes."""
    return torch.expm1(encoded * math.log1p(STEEPNESS)) / STEEPNESS


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions with ELU around a skip; (B, width, H, W) to the same."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, features: Tensor) -> Tensor:
        """Add a correction to ``features``."""
        return features + self.second(F.elu(self.first(F.elu(features))))


class Backbone(nn.Module):
    """3x3 convolution in, residual blocks, 3x3 convolution out, pixel shuffle by 2.

    Shape:
        features (B, in_channels, H/2, W/2) to (B, out_channels, H, W). The last convolution starts at
        zero, so that a fresh network leaves what it corrects as it is.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    def __init__(self, in_channels: int, out_channels: int, width: int, num_blocks: int) -> None:
        super().__init__()
        self.stem = nn.Conv2d(in_channels, width, 3, padding=1)
        self.blocks = nn.Sequential(*(ResidualBlock(width) for _ in range(num_blocks)))
        self.head = nn.Conv2d(width, 4 * out_channels, 3, padding=1)
        for layer in self.modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
                assert layer.bias is not None
                nn.init.zeros_(layer.bias)
        nn.init.zeros_(self.head.weight)

    def forward(self, features: Tensor) -> Tensor:
        """Map half-size features to full-size outputs."""
        return F.pixel_shuffle(self.head(F.elu(self.blocks(self.stem(features)))), 2)
