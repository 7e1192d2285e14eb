"""Disparity as cameras and depth networks see it: what is done to the true map before a network gets it."""

import kornia
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["augment_disparity"]


# What a pixel grows over in one step.
_SQUARE = torch.ones(3, 3)
_CROSS = torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]])


def _grow(disparity: Tensor, radius: int, rounded: bool = False) -> Tensor:
    """Let near surfaces grow by ``radius`` pixels, far ones for a negative radius.

    A square grows with them, or an octagon if ``rounded``: square corners would tell a network how far to go.
    """
    if radius < 0:
        return -_grow(-disparity, -radius, rounded)
    if not rounded:
        side = 2 * radius + 1
        return kornia.morphology.dilation(disparity, torch.ones(side, side))
    for i in range(radius):
        disparity = kornia.morphology.dilation(disparity, _SQUARE if i % 2 else _CROSS)
    return disparity


def _blur(disparity: Tensor, sigma: float) -> Tensor:
    """Gaussian blur, cut off at three sigma, the border repeated."""
    side = 2 * int(np.ceil(3 * sigma)) + 1
    return kornia.filters.gaussian_blur2d(disparity, side, (sigma, sigma), border_type="replicate")


def _smooth_noise(shape: tuple[int, int], channels: int, cell: float, rng: np.random.Generator) -> Tensor:
    """Noise of unit variance at its nodes, ``cell`` pixels apart, (1, channels, H, W)."""
    rows, columns = (max(2, round(side / cell)) for side in shape)
    nodes = torch.from_numpy(rng.standard_normal((1, channels, rows, columns)).astype(np.float32))
    return F.interpolate(nodes, size=shape, mode="bicubic", align_corners=True)


def _shift(disparity: Tensor, pixels: float, rng: np.random.Generator) -> Tensor:
    """Move every place by its own smooth way, typically of that many pixels."""
    height, width = disparity.shape[-2:]
    way = pixels * _smooth_noise((height, width), 2, float(rng.uniform(24, 96)), rng)
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return kornia.geometry.transform.remap(
        disparity, x + way[:, 0], y + way[:, 1], padding_mode="border", align_corners=True
    )


def _at_low_size(disparity: Tensor, factor: float) -> Tensor:
    """As a network of that much lower resolution gives it."""
    size = [max(2, round(side / factor)) for side in disparity.shape[-2:]]
    small = F.interpolate(disparity, size=size, mode="area")
    return F.interpolate(small, size=disparity.shape[-2:], mode="bilinear", align_corners=False)


def _patchy(plain: Tensor, changed: Tensor, rng: np.random.Generator) -> Tensor:
    """Change some regions only."""
    noise = _smooth_noise((plain.shape[-2], plain.shape[-1]), 1, float(rng.uniform(32, 128)), rng)
    return torch.where(noise > 0.125, changed, plain)


def augment_disparity(disparity: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return ``disparity`` (H, W) float32, in [0, 1], with edges soft, grown, shrunk or out of place.

    One or more of: growing or shrinking everywhere or in patches, smooth displacements, the soft edges of a
    lower resolution, Gaussian blur, thin things or gaps lost, 8 bits. Growth, blur and displacement are
    measured in pixels of the map.

    Source:
        Blur, dilation and erosion are those of Peng et al., "BokehMe: When neural rendering meets classical
        rendering", CVPR 2022; the rest and all strengths are ours.
    """
    augmented = torch.from_numpy(disparity)[None, None]
    kinds = rng.permutation(["grow", "patches", "shift", "size", "blur"])[
        : rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15])
    ]
    rounded = bool(rng.random() < 0.5)
    if rng.random() < 0.25:
        radius = int(rng.choice([-1, 1]) * rng.integers(1, 5))
        augmented = _grow(_grow(augmented, -radius, rounded), radius, rounded)
    if "grow" in kinds:
        augmented = _grow(augmented, int(rng.choice([-1, 1]) * rng.integers(1, 7)), rounded)
    if "patches" in kinds:
        changes = [_grow(augmented, sign * int(rng.integers(1, 6)), rounded) for sign in (-1, 1)]
        for changed in changes:
            augmented = _patchy(augmented, changed, rng)
    if "shift" in kinds:
        augmented = _shift(augmented, float(rng.uniform(0.5, 3.0)), rng)
    if "size" in kinds:
        augmented = _at_low_size(augmented, float(rng.uniform(1.5, 5.0)))
    if "blur" in kinds:
        augmented = _blur(augmented, float(rng.uniform(0.5, 4.0)))
    if rng.random() < 0.3:
        augmented = (augmented * 255).round() / 255
    return np.ascontiguousarray(augmented[0, 0].clamp(0, 1).numpy())
