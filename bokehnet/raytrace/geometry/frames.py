"""Orthonormal frames and directions around a normal."""

import torch
from torch import Tensor

from bokehnet.optics.sampling import disc_from_square

__all__ = ["cosine_directions", "from_frame", "to_frame"]


def _basis(axis: Tensor) -> Tensor:
    """Return three orthonormal vectors as rows, (N, 3, 3); the last is the unit vector ``axis`` (N, 3).

    Source:
        Duff et al., "Building an orthonormal basis, revisited", Journal of Computer Graphics Techniques,
        2017.
    """
    x, y, z = axis.unbind(-1)
    sign = torch.where(z < 0, -1.0, 1.0).to(axis)
    a = -1 / (sign + z)
    b = x * y * a
    first = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    second = torch.stack([b, sign + y * y * a, -y], -1)
    return torch.stack([first, second, axis], -2)


def from_frame(axis: Tensor, local: Tensor) -> Tensor:
    """Rotate vectors ``local`` (N, 3) so that their z axis becomes the unit vector ``axis`` (N, 3)."""
    return (local[:, None] @ _basis(axis))[:, 0]


def to_frame(axis: Tensor, vectors: Tensor) -> Tensor:
    """Apply the inverse of :func:`from_frame`."""
    return (_basis(axis) @ vectors[..., None])[..., 0]


def cosine_directions(normal: Tensor, square: Tensor) -> Tensor:
    """Return directions (N, 3) with density cosine / pi about ``normal`` from numbers (N, 2) in [0, 1).

    Projects points of the unit disc up to the hemisphere: Malley's method, as in Pharr, Jakob and
    Humphreys, "Physically based rendering", 2023.
    """
    disc = disc_from_square(square)
    height = (1 - (disc * disc).sum(-1, keepdim=True)).clamp_min(0).sqrt()
    return from_frame(normal, torch.cat([disc, height], -1))
