"""ErrorNet: expected error of the rays engine per pixel, without the truth."""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import UNet
from bokehnet.optics.encoding import encode

__all__ = ["FEATURES", "ErrorNet", "ErrorNetConfig"]

# Inputs besides the pictures, one channel each.
FEATURES = ("defocus", "disocclusion_weight", "error_map")

# Minimum and maximum expected error, and the output of an untrained network, 8-bit levels.
_ERROR_RANGE, _INITIAL_ERROR = (0.05, 128.0), 2.0

# Number of 8-bit levels between encoded black and white.
_LEVELS = 255.0

# Scale of the logarithmic blur input, pixels.
_BLUR_SCALE_PX = 10.0


@dataclass(frozen=True, kw_only=True)
class ErrorNetConfig:
    """Shape of an ErrorNet.

    Attributes:
        widths: Channels at 1/2, 1/4, 1/8 of the resolution.
    """

    widths: tuple[int, int, int] = (16, 24, 32)


def _log_magnitude(difference: Tensor) -> Tensor:
    """Return the logarithmic magnitude of an encoded difference, 0 to 1, which resolves small differences."""
    return torch.log1p(_LEVELS * difference) / math.log1p(_LEVELS)


class ErrorNet(nn.Module):
    """Network that predicts the expected absolute error of the rays engine.

    Its inputs are the differences of the rays from the picture and from the scatter, and features of the
    rays: the fraction of light from inpainted colours, and the error map of depth discontinuities.

    Shape:
        image, rays, scatter (B, 3, H, W), scene-linear; features (B, 3, H, W): defocus in pixels,
        disocclusion weight and error map in [0, 1]. H and W multiples of 8. Returns (B, 1, H, W): the
        expected mean over colours of |sRGB value - truth|, in 8-bit levels.
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
        sharp, rendered, spread = (encode(x) for x in (image, rays, scatter))
        differences = [
            _log_magnitude((rendered - other).abs().mean(1, keepdim=True)) for other in (spread, sharp)
        ]
        blur = torch.log1p(defocus.abs() / _BLUR_SCALE_PX)
        stacked = torch.cat([sharp, rendered, spread, *differences, blur, *rest], dim=1)
        log_ratio = self.unet(F.pixel_unshuffle(stacked, 2)).float()
        low, high = (math.log(x) for x in _ERROR_RANGE)
        return (math.log(_INITIAL_ERROR) + log_ratio).clamp(low, high).exp()
