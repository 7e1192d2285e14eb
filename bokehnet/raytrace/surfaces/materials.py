"""What surfaces do with light: they give it off, scatter it evenly, gloss, and let it through."""

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
    """A Lambert surface with a glossy lobe over it, which may shine by itself; both sides are alike.

    Attributes:
        color: Share of light that is scattered evenly, scene-linear RGB.
        specular: Share of light that is reflected by the glossy lobe, as metals do: at all angles alike.
        translucency: Share of light that goes through, spread by the same lobe: frosted glass, or clear glass
            with a small roughness. The sheet is thin, so that nothing is bent. Shadow rays do not pass it;
            the light behind it is found by scattered rays.
        roughness: Width of the lobe, 0.001 to 1; small is like a mirror
            (:mod:`bokehnet.raytrace.surfaces.ggx`).
        emission: Radiance that the surface gives off.
        texture: Scene-linear RGB times alpha, and alpha, (4, Ht, Wt); multiplies ``color`` and
            ``emission``. Light passes where alpha is below 1. Interpolated linearly, the texture ends at
            the outer edges of its outer texels.

    Raises:
        ParameterError: A number is out of range, or more light is scattered than comes in.
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
        most = max(map(sum, zip(self.color, self.specular, self.translucency, strict=True)))
        if most > 1 + 1e-6:
            others = "`specular` and `translucency`" if any(self.translucency) else "`specular`"
            raise ParameterError("color", f"with {others} a sum of at most 1", self.color, shown=f"{most:g}")
        if self.texture.ndim != 3 or self.texture.shape[0] != 4 or 0 in self.texture.shape:
            raise ShapeError(f"texture: expected shape (4, Ht, Wt), got {tuple(self.texture.shape)}")

    @property
    def reflects(self) -> bool:
        """Whether light that comes in is scattered at all."""
        return any(self.color) or any(self.specular) or any(self.translucency)

    @cached_property
    def opaque(self) -> bool:
        """Whether no light passes anywhere."""
        return bool((self.texture[3] >= 1).all())

    @cached_property
    def shines_evenly(self) -> bool:
        """Whether all of the surface has the same radiance."""
        return any(self.emission) and self.texture[0].numel() == 1 and self.opaque

    def texture_lookup(self, uv: Tensor) -> Tensor:
        """RGB times alpha, and alpha, (N, 4), at places (N, 2) in [0, 1]."""
        if self.texture[0].numel() == 1:
            return self.texture[:, 0, 0].to(uv).expand(len(uv), 4)
        return texture_lookup(self.texture, uv)


def texture_lookup(texture: Tensor, uv: Tensor) -> Tensor:
    """Values (N, C) of a texture (C, Ht, Wt) at places (N, 2) in [0, 1], interpolated linearly."""
    grid = (2 * uv - 1).to(texture)[None, None]
    return grid_sample(texture[None], grid, padding_mode="border", align_corners=False)[0, :, 0].T
