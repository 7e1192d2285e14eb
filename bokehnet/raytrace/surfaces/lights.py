"""Light that comes from known places, and light from all around."""

import math
from dataclasses import dataclass, field
from typing import Protocol

import torch
from torch import Tensor

from bokehnet.checks import check_at_least
from bokehnet.errors import ShapeError
from bokehnet.raytrace.geometry.space import dot
from bokehnet.raytrace.scene import Vector
from bokehnet.raytrace.surfaces.materials import Color, texture_lookup

__all__ = ["AreaLight", "Environment", "Light", "PointLight"]


class Light(Protocol):
    """Light from a known place."""

    @property
    def body(self) -> int:
        """Index of the shape that shines, which cannot be in its own way; -1 for none."""
        ...

    def sample(self, points: Tensor, time: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """Draw a place of the light for each of ``points`` (N, 3) from numbers (N, 2) in [0, 1).

        Returns:
            The way there (N, 3), mm, and radiance times solid angle (N, 3).
        """
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class PointLight:
    """A lamp without size: shadows are hard. Mirrors do not show it.

    Attributes:
        position: mm.
        intensity: Power per solid angle; irradiance is intensity / (distance in mm)^2.

    Raises:
        ParameterError: The intensity is negative.
    """

    position: Vector
    intensity: Color

    def __post_init__(self) -> None:
        for value in self.intensity:
            check_at_least("intensity", value, 0)

    @property
    def body(self) -> int:
        """No shape."""
        return -1

    def sample(self, points: Tensor, time: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`Light`."""
        way = points.new_tensor(self.position) - points
        return way, points.new_tensor(self.intensity) / dot(way, way).clamp_min(1e-12)[:, None]


class Emitter(Protocol):
    """A shape of which points can be drawn."""

    def sample(self, points: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """See ``Quad.sample``."""
        ...


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AreaLight:
    """A shape of even radiance, which casts soft shadows.

    Attributes:
        shape: What shines.
        body: Its index in the world.
        emission: Radiance.
        velocity: mm/s.
    """

    shape: Emitter
    body: int
    emission: Color
    velocity: Vector

    def sample(self, points: Tensor, time: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`Light`."""
        moved = points - time[:, None] * points.new_tensor(self.velocity)
        way, solid_angle = self.shape.sample(moved, square)
        return way, solid_angle[:, None] * points.new_tensor(self.emission)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Environment:
    """Light from infinitely far, all around.

    Attributes:
        texture: Radiance, scene-linear RGB, (3, Ht, Wt): a map of longitude and latitude. Its middle lies
            ahead of the camera, its first row above.

    Raises:
        ShapeError: ``texture`` is not (3, Ht, Wt).
    """

    texture: Tensor = field(default_factory=lambda: torch.zeros(3, 1, 1))

    def __post_init__(self) -> None:
        if self.texture.ndim != 3 or self.texture.shape[0] != 3 or 0 in self.texture.shape:
            shape = tuple(self.texture.shape)
            raise ShapeError(f"environment texture: expected shape (3, Ht, Wt), got {shape}")

    def texture_lookup(self, directions: Tensor) -> Tensor:
        """Radiance (N, 3) from ``directions`` (N, 3) of any length."""
        texture = self.texture.to(directions)
        if texture[0].numel() == 1:
            return texture[:, 0, 0].expand(len(directions), 3)
        x, y, z = directions.unbind(-1)
        longitude = torch.atan2(x, z) / (2 * math.pi) + 0.5
        latitude = torch.atan2(torch.hypot(x, z), -y) / math.pi
        width = texture.shape[2]
        around = torch.cat([texture[..., -1:], texture, texture[..., :1]], -1)  # first and last column meet
        return texture_lookup(around, torch.stack([(longitude * width + 1) / (width + 2), latitude], -1))
