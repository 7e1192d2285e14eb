"""Surfaces of the scenes: textured planes with an outline, spheres, and lamps.

Lengths are metres. The camera is at the origin and looks along +z; x is to the right and y down. All
functions accept rays as arrays: an origin (N, 3) and a slope (N, 2), the change of x and y for one metre of
z.
"""

from dataclasses import dataclass, field

import numpy as np

__all__ = ["Card", "Outline", "Sphere", "Surface", "Texture"]

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Texture:
    """Procedural colour: a base colour times waves, with an optional hard pattern.

    Attributes:
        color: Scene-linear base colour.
        waves: Frequency x and y, radians per metre, phase and amplitude of each wave, (K, 4).
        pattern: ``plain``, ``checks`` or ``stripes``.
        period: Period of the pattern, metres.
        second: Colour of the other half of the pattern.
    """

    color: tuple[float, float, float]
    waves: Array
    pattern: str = "plain"
    period: float = 1.0
    second: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __call__(self, x: Array, y: Array) -> Array:
        """Return the scene-linear colours (N, 3) at positions on the surface, metres."""
        light = np.ones_like(x)
        for across, down, phase, amplitude in self.waves:
            light = light + amplitude * np.sin(across * x + down * y + phase)
        color = np.broadcast_to(np.asarray(self.color, np.float32), (*x.shape, 3))
        if self.pattern != "plain":
            odd = np.floor(x / self.period).astype(np.int64)
            if self.pattern == "checks":
                odd = odd + np.floor(y / self.period).astype(np.int64)
            color = np.where((odd % 2 == 1)[..., None], np.asarray(self.second, np.float32), color)
        return np.maximum(light, 0.02)[..., None] * color


@dataclass(frozen=True, kw_only=True)
class Outline:
    """Outline of a card in its own coordinates.

    Attributes:
        kind: ``all`` (unbounded), ``disc``, ``box``, ``star``, ``ring`` or ``fence``.
        size: Half width and half height, metres; a disc, star or ring uses the first.
        period: Distance between the bars of a fence, metres.
        fraction: Width of a bar over the period, inner over outer radius of a ring, or depth of a star's
            teeth.
        teeth: Number of teeth of a star.
    """

    kind: str = "all"
    size: tuple[float, float] = (1.0, 1.0)
    period: float = 1.0
    fraction: float = 0.5
    teeth: int = 5

    def contains(self, x: Array, y: Array) -> Array:
        """Return the mask of positions inside, (N,) bool."""
        width, height = self.size
        if self.kind == "all":
            return np.ones(x.shape, bool)
        if self.kind == "box":
            return (np.abs(x) <= width) & (np.abs(y) <= height)
        if self.kind == "fence":
            bars = np.minimum(np.mod(x, self.period), np.mod(y, self.period)) < self.fraction * self.period
            return bars & (np.abs(x) <= width) & (np.abs(y) <= height)
        radius = np.hypot(x, y)
        if self.kind == "disc":
            return radius <= width
        if self.kind == "ring":
            return (radius <= width) & (radius >= self.fraction * width)
        bound = width * (1 - self.fraction * (0.5 + 0.5 * np.cos(self.teeth * np.arctan2(y, x))))
        return radius <= bound


@dataclass(frozen=True, kw_only=True)
class Card:
    """Plane ``z = depth + gx (x - cx) + gy (y - cy)`` with an outline.

    Attributes:
        center: Position cx, cy and depth, metres.
        texture: Colour; a lamp has a bright one.
        outline: Outline, turned by ``angle``.
        angle: Rotation of outline and texture, radians.
        gradient: Change of z with x and y.
        lamp: True for a small upright disc of one bright colour, which the tracer samples directly.
    """

    center: tuple[float, float, float]
    texture: Texture
    outline: Outline = field(default_factory=Outline)
    angle: float = 0.0
    gradient: tuple[float, float] = (0.0, 0.0)
    lamp: bool = False

    def reach(self) -> tuple[float, float] | None:
        """Return the centre's depth and a bound of the radius around it, metres; None if unbounded."""
        if self.outline.kind == "all":
            return None
        radius = float(np.hypot(*self.outline.size))
        return self.center[2], radius * (1 + float(np.hypot(*self.gradient)))

    def hit(self, origin: Array, slope: Array) -> Array:
        """Return the depth z of each ray's hit, infinite without one, (N,)."""
        cx, cy, depth = self.center
        gx, gy = self.gradient
        start = depth + gx * (origin[:, 0] - cx) + gy * (origin[:, 1] - cy)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = start / (1 - gx * slope[:, 0] - gy * slope[:, 1])
            z = np.where(np.isfinite(z) & (z > 0.02), z, np.inf)
            x, y = self._place(origin, slope, z)
            return np.where(self.outline.contains(x, y), z, np.inf)

    def color(self, origin: Array, slope: Array, z: Array) -> Array:
        """Return the colours (N, 3) of hits at depth z."""
        return self.texture(*self._place(origin, slope, z))

    def _place(self, origin: Array, slope: Array, z: Array) -> tuple[Array, Array]:
        x = origin[:, 0] + slope[:, 0] * z - self.center[0]
        y = origin[:, 1] + slope[:, 1] * z - self.center[1]
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        return cosine * x + sine * y, cosine * y - sine * x


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """Textured sphere, lit from above and from the camera's left.

    Attributes:
        center: Position, metres.
        radius: Metres.
        texture: Colour, projected along z.
    """

    center: tuple[float, float, float]
    radius: float
    texture: Texture

    def reach(self) -> tuple[float, float] | None:
        """Return the nearest depth and a bound of the radius around the centre, metres."""
        return self.center[2] - self.radius, self.radius

    def hit(self, origin: Array, slope: Array) -> Array:
        """Return the depth z of each ray's hit, infinite without one, (N,)."""
        cx, cy, cz = self.center
        px, py = origin[:, 0] - cx + slope[:, 0] * cz, origin[:, 1] - cy + slope[:, 1] * cz
        a = slope[:, 0] ** 2 + slope[:, 1] ** 2 + 1
        b = px * slope[:, 0] + py * slope[:, 1]
        inside = b * b - a * (px * px + py * py - self.radius**2)
        z = cz - (b + np.sqrt(np.maximum(inside, 0))) / a
        return np.where((inside > 0) & (z > 0.02), z, np.inf)

    def color(self, origin: Array, slope: Array, z: Array) -> Array:
        """Return the colours (N, 3) of hits at depth z."""
        x = (origin[:, 0] + slope[:, 0] * z - self.center[0]) / self.radius
        y = (origin[:, 1] + slope[:, 1] * z - self.center[1]) / self.radius
        facing = np.sqrt(np.maximum(1 - x * x - y * y, 0))
        light = 0.25 + 0.75 * np.maximum(0.8 * facing - 0.45 * y - 0.4 * x, 0)
        return light[:, None] * self.texture(x * self.radius, y * self.radius)


Surface = Card | Sphere
