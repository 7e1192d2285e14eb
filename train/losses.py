"""What the networks are trained to make small, and what the error map is to learn.

All on the perceptual scale of :func:`bokehnet.optics.encoding.encode`.
"""

from dataclasses import dataclass, fields

import torch
import torch.nn.functional as F
from torch import Tensor

from bokehnet.errors import ConfigError
from bokehnet.fusion import fuse
from bokehnet.optics.encoding import encode

__all__ = ["ERROR_TARGETS", "LossWeights", "arnet_loss", "iunet_loss", "measured_error"]

# From geometry, by the disparity alone; or from the pictures, by what the classical render got wrong.
ERROR_TARGETS = ("geometric", "measured")

# Errors that noise of the ray-traced truth explains, and errors that are plainly wrong.
_NOISE, _WRONG = 0.01, 0.04

# How much a pixel counts where the classical half is right and the network's answer is not used.
OUTSIDE = 0.1


def _encode_signed(linear: Tensor) -> Tensor:
    """``encode``, continued below 0 by its slope there, so that negative predictions are pulled back."""
    return encode(linear) + linear.clamp(max=0)


# How much squared errors count beside absolute ones; at 100 they balance for errors of a hundredth.
SQUARED = 100.0


def _distance(prediction: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Mean of weighted |d| + SQUARED d^2: absolute errors alone hardly moved a fresh network.

    Not divided by the sum of the weights, so that the loss of a batch is the mean of its examples' losses.
    """
    difference = (prediction - truth).abs()
    return (weight * difference * (1 + SQUARED * difference)).mean()


def _gradient_l1(prediction: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    difference = prediction - truth
    across = (weight[..., 1:] * difference.diff(dim=-1).abs()).mean()
    down = (weight[..., 1:, :] * difference.diff(dim=-2).abs()).mean()
    return across + down


@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """How much each part of ARNet's loss counts.

    Attributes:
        neural: The network's picture, above all where the target is 1.
        gradient: Its slopes, there.
        fused: What its error map makes of it and the classical render, everywhere.
        error_map: The error map's distance to the target. The more it counts, the less the map chooses
            what is better at each pixel.
    """

    neural: float = 1.0
    gradient: float = 0.2
    fused: float = 0.5
    error_map: float = 0.1

    def __post_init__(self) -> None:
        for part in fields(self):
            if not 0 <= (found := getattr(self, part.name)) < float("inf"):
                raise ConfigError(f"loss.{part.name}: expected 0 or more, found {found}")


def arnet_loss(
    bokeh: Tensor,
    error_map: Tensor,
    classical: Tensor,
    truth: Tensor,
    target: Tensor,
    weights: LossWeights | None = None,
) -> tuple[Tensor, dict[str, Tensor]]:
    """Loss of the coarse network.

    Args:
        bokeh: Its picture, scene-linear, (B, 3, H, W).
        error_map: Its error map, (B, 1, H, W).
        classical: Classical render at the same size.
        truth: Ray-traced bokeh at the same size.
        target: One of ``ERROR_TARGETS``, (B, 1, H, W).
        weights: Of the parts; default: those of a fresh network.

    Returns:
        The sum, and its parts by name.
    """
    counts = weights or LossWeights()
    wanted, neural = _encode_signed(truth), _encode_signed(bokeh)
    weight = OUTSIDE + (1 - OUTSIDE) * target
    fused = _encode_signed(fuse(classical, bokeh, error_map))
    parts = {
        "neural": counts.neural * _distance(neural, wanted, weight),
        "gradient": counts.gradient * _gradient_l1(neural, wanted, weight),
        "fused": counts.fused * _distance(fused, wanted, torch.ones_like(weight)),
        "error_map": counts.error_map * F.mse_loss(error_map, target),
    }
    return torch.stack(list(parts.values())).sum(), parts


def iunet_loss(bokeh: Tensor, truth: Tensor, target: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Loss of one upsampling step; arguments and result as in :func:`arnet_loss`."""
    wanted, neural = _encode_signed(truth), _encode_signed(bokeh)
    weight = OUTSIDE + (1 - OUTSIDE) * target
    parts = {
        "neural": _distance(neural, wanted, weight),
        "gradient": LossWeights.gradient * _gradient_l1(neural, wanted, weight),
    }
    return torch.stack(list(parts.values())).sum(), parts


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
