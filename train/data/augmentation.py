"""Augmentation of true disparity with the errors of depth cameras and depth networks."""

import kornia
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

__all__ = ["augment_disparity"]


# Structuring elements of one growth step.
_SQUARE = torch.ones(3, 3)
_CROSS = torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 1.0, 0.0]])


def _grow(disparity: Tensor, radius: int, rounded: bool = False) -> Tensor:
    """Grow near surfaces by ``radius`` pixels, or far surfaces for a negative radius.

    The structuring element is a square, or an octagon if ``rounded``: square corners would reveal the radius
    to a network.
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
    """Return the map after a Gaussian blur, cut off at three sigma, border repeated."""
    side = 2 * int(np.ceil(3 * sigma)) + 1
    return kornia.filters.gaussian_blur2d(disparity, side, (sigma, sigma), border_type="replicate")


def _smooth_noise(shape: tuple[int, int], channels: int, cell: float, rng: np.random.Generator) -> Tensor:
    """Return interpolated noise of unit variance at nodes ``cell`` pixels apart, (1, channels, H, W)."""
    rows, columns = (max(2, round(side / cell)) for side in shape)
    nodes = torch.from_numpy(rng.standard_normal((1, channels, rows, columns)).astype(np.float32))
    return F.interpolate(nodes, size=shape, mode="bicubic", align_corners=True)


def _shift(disparity: Tensor, pixels: float, rng: np.random.Generator) -> Tensor:
    """Displace the map by a smooth random field of typically ``pixels`` pixels."""
    height, width = disparity.shape[-2:]
    offset = pixels * _smooth_noise((height, width), 2, float(rng.uniform(24, 96)), rng)
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return kornia.geometry.transform.remap(
        disparity, x + offset[:, 0], y + offset[:, 1], padding_mode="border", align_corners=True
    )


def _at_low_size(disparity: Tensor, factor: float) -> Tensor:
    """Return the map as a network at a resolution lower by ``factor`` would give it."""
    size = [max(2, round(side / factor)) for side in disparity.shape[-2:]]
    small = F.interpolate(disparity, size=size, mode="area")
    return F.interpolate(small, size=disparity.shape[-2:], mode="bilinear", align_corners=False)


def _jag(disparity: Tensor, pixels: float, rng: np.random.Generator) -> Tensor:
    """Fray edges by a rough random displacement of up to ``pixels`` pixels, without interpolation."""
    height, width = disparity.shape[-2:]
    offset = _smooth_noise((height, width), 2, float(rng.uniform(6, 40)), rng)
    offset = pixels * offset / offset.abs().max()
    y, x = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    rows = (y + offset[0, 1]).round().long().clamp(0, height - 1)
    columns = (x + offset[0, 0]).round().long().clamp(0, width - 1)
    return disparity[..., rows, columns]


def _in_blocks(disparity: Tensor, factor: float) -> Tensor:
    """Return the map in blocks, as after enlargement without smoothing."""
    size = [max(2, round(side / factor)) for side in disparity.shape[-2:]]
    return F.interpolate(F.interpolate(disparity, size=size), size=disparity.shape[-2:])


def _guided_by_picture(disparity: Tensor, image: np.ndarray, rng: np.random.Generator) -> Tensor:
    """Smooth the map with the picture as guide, so that brightness leaks into it."""
    brightness = torch.from_numpy(np.ascontiguousarray(image.mean(-1), np.float32)).clamp(0, 1).sqrt()
    side = 2 * int(rng.integers(2, 9)) + 1
    eps = float(10 ** rng.uniform(-4, -2))
    return kornia.filters.guided_blur(brightness[None, None], disparity, side, eps)


def _remove_objects(disparity: Tensor, rng: np.random.Generator) -> Tensor:
    """Remove near objects up to a random size in random regions."""
    radius = int(rng.integers(5, 13))
    small = disparity[..., ::2, ::2]
    opened = _grow(_grow(small, -(radius // 2)), radius // 2)
    opened = F.interpolate(opened, size=disparity.shape[-2:]).minimum(disparity)
    return _patchy(disparity, opened, rng)


def _patchy(plain: Tensor, changed: Tensor, rng: np.random.Generator) -> Tensor:
    """Apply the change in random regions only."""
    noise = _smooth_noise((plain.shape[-2], plain.shape[-1]), 1, float(rng.uniform(32, 128)), rng)
    return torch.where(noise > 0.125, changed, plain)


def augment_disparity(
    disparity: np.ndarray, rng: np.random.Generator, image: np.ndarray | None = None
) -> np.ndarray:
    """Return augmented ``disparity`` (H, W) float32 in [0, 1], with soft, grown, shrunk or displaced edges.

    Applies one or more of: growth or shrinkage, global or in patches; smooth displacement; frayed edges;
        blocks; the soft edges of a lower resolution; Gaussian blur; lost objects or gaps; 8 bits; and, with
        an ``image`` (H, W, 3), brightness that leaks into the map. Growth, blur and displacement are in
        pixels.

    Source:
        Blur, dilation and erosion are those of Peng et al., "BokehMe: When neural rendering meets classical
        rendering", CVPR 2022; the rest and all strengths are ours.
    """
    augmented = torch.from_numpy(disparity)[None, None]
    candidates = [
        "grow",
        "patches",
        "shift",
        "jag",
        "blocks",
        "size",
        "blur",
        *(["draw"] if image is not None else []),
    ]
    kinds = rng.permutation(candidates)[: rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15])]
    rounded = bool(rng.random() < 0.5)
    if rng.random() < 0.15:
        augmented = _remove_objects(augmented, rng)
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
        augmented = _guided_by_picture(augmented, image, rng)
    if "size" in kinds:
        augmented = _at_low_size(augmented, float(rng.uniform(1.5, 5.0)))
    if "blur" in kinds:
        augmented = _blur(augmented, float(rng.uniform(0.5, 4.0)))
    elif "jag" in kinds and rng.random() < 0.7:
        augmented = _blur(augmented, float(rng.uniform(0.5, 1.5)))
    if rng.random() < 0.3:
        augmented = (augmented * 255).round() / 255
    return np.ascontiguousarray(augmented[0, 0].clamp(0, 1).numpy())
