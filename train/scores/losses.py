"""Training losses of the networks, and the measured target of the error map.

All use the perceptual scale of :func:`bokehnet.optics.encoding.encode`.
"""

from dataclasses import dataclass, fields

import torch
import torch.nn.functional as F
from torch import Tensor

from bokehnet.arrays.fusion import fuse
from bokehnet.errors import ConfigError
from bokehnet.optics.encoding import encode

__all__ = ["ERROR_TARGETS", "LossWeights", "arnet_loss", "bokehme_loss", "iunet_loss", "measured_error"]

# Derived from the disparity alone, or measured as the error of the classical render.
ERROR_TARGETS = ("geometric", "measured")

# Encoded error at the level of the noise of the ray-traced truth, and encoded error that is clearly wrong.
_NOISE_ERROR, _CLEAR_ERROR = 0.01, 0.04

# Weight of a pixel where the classical half is right and the network's output is not used.
WEIGHT_OUTSIDE = 0.1


def _encode_signed(linear: Tensor) -> Tensor:
    """Return ``encode``, extended linearly below 0, so that the loss penalizes negative predictions."""
    return encode(linear) + linear.clamp(max=0)


# Weight of squared errors relative to absolute ones; at 100 both are equal for an error of 0.01.
SQUARED_ERROR_WEIGHT = 100.0


def _distance(prediction: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    """Return the weighted mean of |d| + SQUARED_ERROR_WEIGHT d^2.

    Absolute errors alone hardly trained a fresh network. The mean is not divided by the sum of the weights,
    so that the loss of a batch is the mean of its examples' losses.
    """
    difference = (prediction - truth).abs()
    return (weight * difference * (1 + SQUARED_ERROR_WEIGHT * difference)).mean()


def _gradient_l1(prediction: Tensor, truth: Tensor, weight: Tensor) -> Tensor:
    difference = prediction - truth
    across = (weight[..., 1:] * difference.diff(dim=-1).abs()).mean()
    down = (weight[..., 1:, :] * difference.diff(dim=-2).abs()).mean()
    return across + down


@dataclass(frozen=True, kw_only=True)
class LossWeights:
    """Weights of the terms of ARNet's loss.

    Attributes:
        neural: Error of the network's picture, mainly where the target is 1.
        gradient: Error of its gradients, with the same pixel weights.
        fused: Error of the fusion with the classical render by the error map, over all pixels.
        error_map: Distance of the error map to the target. A larger weight reduces the map's freedom to
            select the better picture at each pixel.
    """

    neural: float = 1.0
    gradient: float = 0.2
    fused: float = 0.5
    error_map: float = 0.1

    def __post_init__(self) -> None:
        for part in fields(self):
            if not 0 <= (value := getattr(self, part.name)) < float("inf"):
                raise ConfigError(f"loss.{part.name}: expected 0 or more, found {value}")


def arnet_loss(
    bokeh: Tensor,
    error_map: Tensor,
    classical: Tensor,
    truth: Tensor,
    target: Tensor,
    weights: LossWeights | None = None,
) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss of the coarse network.

    Args:
        bokeh: Picture of the network, scene-linear, (B, 3, H, W).
        error_map: Error map of the network, (B, 1, H, W).
        classical: Classical render at the same size.
        truth: Ray-traced bokeh at the same size.
        target: Target of the error map, (B, 1, H, W).
        weights: Weights of the terms; default: those for a fresh network.

    Returns:
        Sum of the terms, and the terms by name.
    """
    counts = weights or LossWeights()
    encoded_truth, neural = _encode_signed(truth), _encode_signed(bokeh)
    weight = WEIGHT_OUTSIDE + (1 - WEIGHT_OUTSIDE) * target
    fused = _encode_signed(fuse(classical, bokeh, error_map))
    parts = {
        "neural": counts.neural * _distance(neural, encoded_truth, weight),
        "gradient": counts.gradient * _gradient_l1(neural, encoded_truth, weight),
        "fused": counts.fused * _distance(fused, encoded_truth, torch.ones_like(weight)),
        "error_map": counts.error_map * F.mse_loss(error_map, target),
    }
    return torch.stack(list(parts.values())).sum(), parts


def iunet_loss(bokeh: Tensor, truth: Tensor, target: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss of one upsampling step; arguments and result as in :func:`arnet_loss`."""
    encoded_truth, neural = _encode_signed(truth), _encode_signed(bokeh)
    weight = WEIGHT_OUTSIDE + (1 - WEIGHT_OUTSIDE) * target
    parts = {
        "neural": _distance(neural, encoded_truth, weight),
        "gradient": LossWeights.gradient * _gradient_l1(neural, encoded_truth, weight),
    }
    return torch.stack(list(parts.values())).sum(), parts


def bokehme_loss(
    steps: list[tuple[Tensor, Tensor, Tensor]],
    error_map: Tensor | None = None,
    classical: Tensor | None = None,
) -> tuple[Tensor, dict[str, Tensor]]:
    """Return the loss of BokehMe's networks, on encoded pictures; the published losses are unknown.

    Args:
        steps: Prediction (B, 3, h, w), truth and target (B, 1, h, w) at each size.
        error_map: Error map of ARNet at the size of the last step, (B, 1, H, W); ``None`` for IUNet. It is
            drawn to the target, and by the fusion to the better picture.
        classical: Encoded classical render at the size of the last step, (B, 3, H, W).

    Returns:
        Sum of the terms, and the terms by name.
    """
    rows = []
    for prediction, truth, near in steps:
        weight = WEIGHT_OUTSIDE + (1 - WEIGHT_OUTSIDE) * near
        gradient = LossWeights.gradient * _gradient_l1(prediction, truth, weight)
        rows.append({"neural": _distance(prediction, truth, weight), "gradient": gradient})
    parts = {key: torch.stack([row[key] for row in rows]).mean() for key in rows[0]}
    if error_map is not None and classical is not None:
        bokeh, truth, near = steps[-1]
        fused = fuse(classical, bokeh, error_map)
        parts["fused"] = _distance(fused, truth, torch.ones_like(near))
        parts["error_map"] = LossWeights.error_map * F.mse_loss(error_map, near)
    return torch.stack(list(parts.values())).sum(), parts


def measured_error(classical: Tensor, truth: Tensor) -> Tensor:
    """Return the error map of a classical render against the truth.

    Args:
        classical: Classical render, scene-linear, (B, 3, H, W).
        truth: True picture, scene-linear, (B, 3, H, W).

    Returns:
        0 where the mean error over colours and 3x3 pixels is at noise level, 1 where it is clearly wrong,
        linear between, (B, 1, H, W).
    """
    error = (encode(classical) - encode(truth)).abs().mean(1, keepdim=True)
    error = F.avg_pool2d(error, 3, stride=1, padding=1, count_include_pad=False)
    return ((error - _NOISE_ERROR) / (_CLEAR_ERROR - _NOISE_ERROR)).clamp(0, 1)
