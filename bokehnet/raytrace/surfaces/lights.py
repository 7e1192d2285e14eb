"""Point lights, area lights and environment light."""

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
    """Light that shadow rays can sample."""

    @property
    def body(self) -> int:
        """Index of the emitting body, which casts no shadow on its own light; -1 for none."""
        ...

    def sample(self, points: Tensor, time: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """Sample a point of the light for each of ``points`` (N, 3) from numbers (N, 2) in [0, 1).

        Returns:
            Offsets to the light (N, 3), mm, and radiance times solid angle (N, 3).
        """
        ...


@dataclass(frozen=True, kw_only=True, slots=True)
class PointLight:
    """Point light: casts hard shadows and is invisible in mirrors.

    Attributes:
        position: Position, mm.
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
        """-1: a point light has no body."""
        return -1

    def sample(self, points: Tensor, time: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`Light`."""
        offset = points.new_tensor(self.position) - points
        return offset, points.new_tensor(self.intensity) / dot(offset, offset).clamp_min(1e-12)[:, None]


class Emitter(Protocol):
    """Shape with points that can be sampled."""

    def sample(self, points: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """See ``Quad.sample``."""
        ...


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class AreaLight:
    """Shape of uniform radiance, which casts soft shadows.

    Attributes:
        shape: Emitting shape.
        body: Index of its body in the world.
        emission: Radiance.
        velocity: Velocity, mm/s.
    """

    shape: Emitter
    body: int
    emission: Color
    velocity: Vector

    def sample(self, points: Tensor, time: Tensor, square: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`Light`."""
        relative_points = points - time[:, None] * points.new_tensor(self.velocity)
        offset, solid_angle = self.shape.sample(relative_points, square)
        return offset, solid_angle[:, None] * points.new_tensor(self.emission)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Environment:
    """Light from infinity in all directions.

    Attributes:
        texture: Radiance, scene-linear RGB, (3, Ht, Wt): a latitude-longitude map. Its centre lies ahead of
            the camera, its first row above.

    Raises:
        ShapeError: ``texture`` is not (3, Ht, Wt).
    """

    texture: Tensor = field(default_factory=lambda: torch.zeros(3, 1, 1))

    def __post_init__(self) -> None:
        if self.texture.ndim != 3 or self.texture.shape[0] != 3 or 0 in self.texture.shape:
            shape = tuple(self.texture.shape)
            raise ShapeError(f"environment texture: expected shape (3, Ht, Wt), got {shape}")

    def texture_lookup(self, directions: Tensor) -> Tensor:
        """Return the radiance (N, 3) from ``directions`` (N, 3) of any length."""
        texture = self.texture.to(directions)
        if texture[0].numel() == 1:
            return texture[:, 0, 0].expand(len(directions), 3)
        x, y, z = directions.unbind(-1)
        longitude = torch.atan2(x, z) / (2 * math.pi) + 0.5
        latitude = torch.atan2(torch.hypot(x, z), -y) / math.pi
        width = texture.shape[2]
        wrapped = torch.cat(
            [texture[..., -1:], texture, texture[..., :1]], -1
        )  # first and last column are adjacent
        return texture_lookup(wrapped, torch.stack([(longitude * width + 1) / (width + 2), latitude], -1))
