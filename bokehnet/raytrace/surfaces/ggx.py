"""Glossy lobe: reflection by microfacets with the GGX distribution.

Directions (N, 3) have length 1 and point away from the surface; ``roughness`` (N,) is the width of the
distribution of slopes, near 0 for a mirror. The microfacets reflect all light.

Source:
    Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007.
"""

import math

import torch
from torch import Tensor

from bokehnet.raytrace.geometry.frames import from_frame, to_frame
from bokehnet.raytrace.geometry.space import dot, unit

__all__ = ["ggx_reflectance", "sample_ggx"]


def sample_ggx(view: Tensor, normal: Tensor, roughness: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
    """Sample directions of the light that is reflected towards ``view``.

    Args:
        view: Directions of reflection, (N, 3).
        normal: Surface normals on the side of ``view``, (N, 3).
        roughness: Roughness, (N,).
        square: Random numbers in [0, 1), (N, 2).

    Returns:
        Directions, (N, 3), and reflectance times cosine over density, (N,); 0 for light from below.

    Source:
        Dupuy and Benyoub, "Sampling visible GGX normals with spherical caps", High-Performance Graphics
        2023.
    """
    local = to_frame(normal, view)
    stretch = torch.stack([roughness, roughness, torch.ones_like(roughness)], -1)
    stretched = unit(local * stretch)
    z = (1 - square[:, 1]) * (1 + stretched[:, 2]) - stretched[:, 2]
    across = (1 - z * z).clamp_min(0).sqrt()
    angle = 2 * math.pi * square[:, 0]
    cap = torch.stack([across * angle.cos(), across * angle.sin(), z], -1)
    mirror = unit((cap + stretched) * stretch)
    light = 2 * dot(local, mirror)[:, None] * mirror - local
    factor = torch.where(light[:, 2] > 0, _unshadowed(light[:, 2], roughness), 0)
    return from_frame(normal, light), factor


def ggx_reflectance(view: Tensor, light: Tensor, normal: Tensor, roughness: Tensor) -> Tensor:
    """Return the reflectance (N,), 1/sr, from ``light`` towards ``view``, both above the surface."""
    up, down = dot(view, normal).clamp_min(1e-6), dot(light, normal).clamp_min(1e-6)
    half = dot(unit(view + light), normal)
    square = roughness**2
    density = square / (math.pi * ((square - 1) * half**2 + 1) ** 2)
    return density * _unshadowed(up, roughness) * _unshadowed(down, roughness) / (4 * up * down)


def _unshadowed(cosine: Tensor, roughness: Tensor) -> Tensor:
    """Return the visible fraction of the microfacets that face a direction: Smith's masking term."""
    tangent2 = (1 - cosine**2).clamp_min(0) / cosine.clamp_min(1e-6) ** 2
    return 2 / (1 + (1 + roughness**2 * tangent2).sqrt())
