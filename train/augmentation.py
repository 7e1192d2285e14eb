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


def _jag(disparity: Tensor, pixels: float, rng: np.random.Generator) -> Tensor:
    """Edges frayed by a rough random way of up to that many pixels, values kept."""
    height, width = disparity.shape[-2:]
    way = _smooth_noise((height, width), 2, float(rng.uniform(6, 40)), rng)
    way = pixels * way / way.abs().max()
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    rows = (y + way[0, 1]).round().long().clamp(0, height - 1)
    columns = (x + way[0, 0]).round().long().clamp(0, width - 1)
    return disparity[..., rows, columns]


def _in_blocks(disparity: Tensor, factor: float) -> Tensor:
    """In stairs, as enlarged without smoothing."""
    size = [max(2, round(side / factor)) for side in disparity.shape[-2:]]
    return F.interpolate(F.interpolate(disparity, size=size), size=disparity.shape[-2:])


def _drawn_to_picture(disparity: Tensor, image: np.ndarray, rng: np.random.Generator) -> Tensor:
    """Smoothed along the picture's edges, so that its brightness shows in the map."""
    brightness = torch.from_numpy(np.ascontiguousarray(image.mean(-1), np.float32)).clamp(0, 1).sqrt()
    side = 2 * int(rng.integers(2, 9)) + 1
    eps = float(10 ** rng.uniform(-4, -2))
    return kornia.filters.guided_blur(brightness[None, None], disparity, side, eps)


def _without_some_things(disparity: Tensor, rng: np.random.Generator) -> Tensor:
    """Near things up to some size are lost here and there."""
    radius = int(rng.integers(5, 13))
    small = disparity[..., ::2, ::2]
    opened = _grow(_grow(small, -(radius // 2)), radius // 2)
    opened = F.interpolate(opened, size=disparity.shape[-2:]).minimum(disparity)
    return _patchy(disparity, opened, rng)


def _patchy(plain: Tensor, changed: Tensor, rng: np.random.Generator) -> Tensor:
    """Change some regions only."""
    noise = _smooth_noise((plain.shape[-2], plain.shape[-1]), 1, float(rng.uniform(32, 128)), rng)
    return torch.where(noise > 0.125, changed, plain)


def augment_disparity(
    disparity: np.ndarray, rng: np.random.Generator, image: np.ndarray | None = None
) -> np.ndarray:
    """Return ``disparity`` (H, W) float32, in [0, 1], with edges soft, grown, shrunk or out of place.

    One or more of: growing or shrinking everywhere or in patches, smooth displacements, frayed edges, stairs,
    the soft edges of a lower resolution, Gaussian blur, things or gaps lost, 8 bits; and with an ``image``
    (H, W, 3) brightness that shows in the map. Growth, blur and displacement are measured in pixels.

    Source:
        Blur, dilation and erosion are those of Peng et al., "BokehMe: When neural rendering meets classical
        rendering", CVPR 2022; the rest and all strengths are ours.
    """
    augmented = torch.from_numpy(disparity)[None, None]
    known = [
        "grow",
        "patches",
        "shift",
        "jag",
        "blocks",
        "size",
        "blur",
        *(["draw"] if image is not None else []),
    ]
    kinds = rng.permutation(known)[: rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15])]
    rounded = bool(rng.random() < 0.5)
    if rng.random() < 0.15:
        augmented = _without_some_things(augmented, rng)
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
    if "jag" in kinds:
        augmented = _jag(augmented, float(rng.uniform(1.0, 6.0)), rng)
    if "blocks" in kinds:
        augmented = _in_blocks(augmented, float(rng.uniform(1.5, 5.0)))
    if "draw" in kinds and image is not None:
        augmented = _drawn_to_picture(augmented, image, rng)
    if "size" in kinds:
        augmented = _at_low_size(augmented, float(rng.uniform(1.5, 5.0)))
    if "blur" in kinds:
        augmented = _blur(augmented, float(rng.uniform(0.5, 4.0)))
    elif "jag" in kinds and rng.random() < 0.7:
        augmented = _blur(augmented, float(rng.uniform(0.5, 1.5)))
    if rng.random() < 0.3:
        augmented = (augmented * 255).round() / 255
    return np.ascontiguousarray(augmented[0, 0].clamp(0, 1).numpy())
