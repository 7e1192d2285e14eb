"""Where the classical render is wrong by measurement: the other target of ARNet's error map."""

import torch.nn.functional as F
from torch import Tensor

from bokehnet.optics.encoding import encode

__all__ = ["ERROR_TARGETS", "measured_error"]

# From geometry, by the disparity alone; or from the pictures, by what the classical render got wrong.
ERROR_TARGETS = ("geometric", "measured")

# Errors on the perceptual scale: what noise of the ray-traced truth explains, and what is plainly wrong.
_NOISE, _WRONG = 0.01, 0.04


def measured_error(classical: Tensor, truth: Tensor) -> Tensor:
    """Error map of a classical render against the truth.

    Args:
        classical: Scene-linear, (B, 3, H, W).
        truth: The same.

    Returns:
        0 where the mean of the colours' errors over 3x3 pixels is no more than noise, 1 where it is plainly
        wrong, linear between, (B, 1, H, W).
    """
    error = (encode(classical) - encode(truth)).abs().mean(1, keepdim=True)
    error = F.avg_pool2d(error, 3, stride=1, padding=1, count_include_pad=False)
    return ((error - _NOISE) / (_WRONG - _NOISE)).clamp(0, 1)
