"""LightNet: gain of the light of a clipped region, as a correction of the closed form."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

__all__ = ["CLOSED_FORM", "FEATURES", "LightNet", "LightNetConfig"]

# Features of a region: its own, and their mean over the picture.
FEATURES = 2 * 50

# Position of the binary logarithm of the closed form's gain in the features, one for each channel.
CLOSED_FORM = slice(23, 26)

# Largest correction, octaves, and largest gain, binary logarithm.
_MAX_CORRECTION, _MAX_LOG_GAIN = 4.0, 7.0

# Logit of the probability of light of an untrained network.
_INITIAL_LOGIT = 4.0

# Largest magnitude of a standardised feature.
_MAX_FEATURE = 4.0


@dataclass(frozen=True, kw_only=True)
class LightNetConfig:
    """Shape of a LightNet.

    Attributes:
        widths: Channels of the hidden layers.
    """

    widths: tuple[int, ...] = (96, 96, 64)


class LightNet(nn.Module):
    """Network that predicts the gain on the light of a region with clipped pixels.

    Untrained, it returns the gain of the closed form.

    Shape:
        features (B, FEATURES). Returns (B, 3), the binary logarithm of the gain of each channel, and (B, 1),
        the probability that the region is light and not matter.
    """

    config: LightNetConfig

    def __init__(self, config: LightNetConfig) -> None:
        super().__init__()
        self.config = config
        self.scale = nn.BatchNorm1d(FEATURES, affine=False, momentum=0.01)
        layers: list[nn.Module] = []
        before = FEATURES
        for width in config.widths:
            layers += [nn.Linear(before, width), nn.SiLU()]
            before = width
        last = nn.Linear(before, 4)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.layers = nn.Sequential(*layers, last)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return logarithmic gains and probabilities."""
        outputs = self.layers(self.scale(features).clamp(-_MAX_FEATURE, _MAX_FEATURE))
        probability = torch.sigmoid(_INITIAL_LOGIT + outputs[:, 3:])
        correction = _MAX_CORRECTION * torch.tanh(outputs[:, :3])
        gain = (features[:, CLOSED_FORM] + correction).clamp(0.0, _MAX_LOG_GAIN)
        return probability * gain, probability
