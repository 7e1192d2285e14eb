"""Surface materials: emission, diffuse and glossy reflection, and transmission."""

from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor
from torch.nn.functional import grid_sample

from bokehnet.checks import check_at_least, check_range
from bokehnet.errors import ParameterError, ShapeError

__all__ = ["Color", "Material", "texture_lookup"]

Color = tuple[float, float, float]

_BLACK: Color = (0.0, 0.0, 0.0)


def _white() -> Tensor:
    return torch.ones(4, 1, 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Material:
    """Lambertian surface with a glossy lobe and optional emission; both sides have the same properties.

    Attributes:
        color: Diffuse reflectance, scene-linear RGB.
        specular: Reflectance of the glossy lobe, independent of the angle as for metals.
        translucency: Transmittance, spread by the same lobe: frosted glass, or clear glass with a small
            roughness. The sheet is thin and refracts nothing. Shadow rays do not pass it; scattered rays
            gather the light behind it.
        roughness: Width of the lobe, 0.001 to 1; small values approach a mirror
            (:mod:`bokehnet.raytrace.surfaces.ggx`).
        emission: Emitted radiance.
        texture: Scene-linear RGB times alpha, and alpha, (4, Ht, Wt); multiplies ``color`` and ``emission``.
            Light passes where alpha is below 1. Interpolation is linear; the texture ends at the outer edges
            of its outer texels.

    Raises:
        ParameterError: A number is out of range, or more light leaves than arrives.
        ShapeError: ``texture`` is not (4, Ht, Wt).
    """

    color: Color = _BLACK
    specular: Color = _BLACK
    translucency: Color = _BLACK
    roughness: float = 0.1
    emission: Color = _BLACK
    texture: Tensor = field(default_factory=_white)

    def __post_init__(self) -> None:
        for name in ("color", "specular", "translucency", "emission"):
            for value in getattr(self, name):
                check_at_least(name, value, 0)
        check_range("roughness", self.roughness, 0.001, 1)
        largest_sum = max(map(sum, zip(self.color, self.specular, self.translucency, strict=True)))
        if largest_sum > 1 + 1e-6:
            others = "`specular` and `translucency`" if any(self.translucency) else "`specular`"
            raise ParameterError(
                "color", f"with {others} a sum of at most 1", self.color, shown=f"{largest_sum:g}"
            )
        if self.texture.ndim != 3 or self.texture.shape[0] != 4 or 0 in self.texture.shape:
            raise ShapeError(f"texture: expected shape (4, Ht, Wt), got {tuple(self.texture.shape)}")

    @property
    def reflects(self) -> bool:
        """True if the surface scatters or transmits any light."""
        return any(self.color) or any(self.specular) or any(self.translucency)

    @cached_property
    def opaque(self) -> bool:
        """True if alpha is 1 everywhere."""
        return bool((self.texture[3] >= 1).all())

    @cached_property
    def emits_uniformly(self) -> bool:
        """True if the whole surface has the same radiance."""
        return any(self.emission) and self.texture[0].numel() == 1 and self.opaque

    def texture_lookup(self, uv: Tensor) -> Tensor:
        """Return premultiplied RGB and alpha, (N, 4), at texture coordinates (N, 2) in [0, 1]."""
        if self.texture[0].numel() == 1:
            return self.texture[:, 0, 0].to(uv).expand(len(uv), 4)
        return texture_lookup(self.texture, uv)


def texture_lookup(texture: Tensor, uv: Tensor) -> Tensor:
    """Return the linearly interpolated values (N, C) of a texture (C, Ht, Wt) at (N, 2) in [0, 1]."""
    grid = (2 * uv - 1).to(texture)[None, None]
    return grid_sample(texture[None], grid, padding_mode="border", align_corners=False)[0, :, 0].T
