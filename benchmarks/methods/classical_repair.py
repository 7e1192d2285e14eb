"""Disparity repair without learning, for comparison: edge-aware filters guided by the picture."""

import kornia
import numpy as np
import torch

from bokehnet.io.color.srgb import linear_to_srgb

__all__ = ["guided", "joint_bilateral"]

# Half width of the windows, pixels: the reach of the degradations of the evaluation.
_RADIUS_PX = 9
_SIDE = 2 * _RADIUS_PX + 1

# Difference of sRGB colours at an edge.
_COLOR_SIGMA = 0.06


def _tensors(image: np.ndarray, disparity: np.ndarray) -> tuple[torch.Tensor, torch.Tensor, float, float]:
    """Return the picture as sRGB (1, 3, H, W), the normalized map (1, 1, H, W), its minimum and range."""
    low, span = float(disparity.min()), float(np.ptp(disparity)) or 1.0
    colors = torch.from_numpy(linear_to_srgb(np.clip(image, 0, 1)).astype(np.float32))
    relative = torch.from_numpy(((disparity - low) / span).astype(np.float32))
    return colors.permute(2, 0, 1)[None], relative[None, None], low, span


def guided(image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Return a map (H, W) after a guided filter by its picture (H, W, 3).

    Source:
        He, Sun and Tang, "Guided image filtering", ECCV 2010; the filter is kornia's.
    """
    colors, relative, low, span = _tensors(image, disparity)
    result = kornia.filters.guided_blur(colors, relative, _SIDE, _COLOR_SIGMA**2)
    return np.asarray(low + span * result[0, 0].numpy(), np.float32)


def joint_bilateral(image: np.ndarray, disparity: np.ndarray) -> np.ndarray:
    """Return a map (H, W) after a joint bilateral filter by its picture (H, W, 3).

    Source:
        Petschnigg et al., "Digital photography with flash and no-flash image pairs", SIGGRAPH 2004; the
        filter is kornia's.
    """
    colors, relative, low, span = _tensors(image, disparity)
    sigma = _RADIUS_PX / 2
    result = kornia.filters.joint_bilateral_blur(relative, colors, _SIDE, _COLOR_SIGMA, (sigma, sigma))
    return np.asarray(low + span * result[0, 0].numpy(), np.float32)
