"""Rays through a sequence of surfaces, one after the other, all rays at once.

Axis ``t`` in mm runs from the scene to the sensor; rays may go either way. Behind a mirror the axis is turned
with the light, so that it runs on to the sensor: places and shapes there are those seen in the mirror. Where
rays miss a surface, are totally reflected or clipped they are marked and go on as they are, so that every
number stays finite and so do the gradients; what the marks say has no gradient.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from bokehnet.checks import Array, array_namespace

__all__ = ["Beam", "Met", "Surface", "beam_between", "meet", "pass_surface", "trace", "turned"]

Met = tuple[tuple[Array, Array, Array], tuple[Array, Array, Array], Array]
"""Points x, y, t; normals of any length towards the sensor; which rays meet the surface."""

# Height over semi-diameter of rays that a surface cannot pass on: more than any that is clipped.
_LOST = 1e6
# Steps that meet an asphere, and mm over 1 mm by which a ray may pass beside it.
_NEWTON_STEPS, _MET = 10, 1e-9
# Smallest share of a unit direction that runs along the axis.
_GRAZING = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class Surface:
    """A conic ``c (x^2 + y^2 + (1 + k) t^2) = 2 t``, counted from its vertex, or a stop.

    An asphere adds powers of the height to the depth of the conic.

    Attributes:
        vertex: Place of the vertex, mm.
        curvature: 1 / radius, 1/mm; positive when the centre is on the sensor's side; 0 is a plane.
        semi_diameter: Rays further from the axis are clipped, mm.
        conic: k; 0 is a sphere, -1 a parabola.
        before: Refractive index on the scene's side, a number or one per ray.
        behind: The same on the sensor's side.
        stop: Whether this is the aperture stop.
        aspheric: Coefficients of the height to the powers 2, 4, 6, ..., mm^-1, mm^-3, ...
        odd: Those to the powers 3, 5, 7, ..., mm^-2, mm^-4, ...
        mirror: Whether it reflects; the index is the same on both sides then.
        inner_radius: Rays nearer to the axis are stopped, mm.
        shift: How far its vertex stands from its place on the axis, x, y, t, mm.
        tilt: How it is turned about its vertex: radians about axes along x and y, together one turn about
            the sum of both as vectors.
    """

    vertex: Array
    curvature: Array
    semi_diameter: Array
    conic: Array = 0.0
    before: Array = 1.0
    behind: Array = 1.0
    stop: bool = False
    aspheric: tuple[float, ...] = ()
    odd: tuple[float, ...] = ()
    mirror: bool = False
    inner_radius: float = 0.0
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt: tuple[float, float] = (0.0, 0.0)

    @property
    def centred(self) -> bool:
        """Whether it stands where it should."""
        return not any(self.shift) and not any(self.tilt)

    def seen_from_behind(self) -> "Surface":
        """The same with the axis turned about its place on it."""
        aspheric, odd = (tuple(-a for a in powers) for powers in (self.aspheric, self.odd))
        (x, y, t), (about_x, about_y) = self.shift, self.tilt
        return replace(
            self,
            curvature=-self.curvature,
            aspheric=aspheric,
            odd=odd,
            shift=(x, y, -t),
            tilt=(-about_x, -about_y),
        )

    def into(self, position: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Places x, y, t in the frame of the surface, whose vertex is at :attr:`vertex` there."""
        x, y, t = (value - moved for value, moved in zip(position, self.shift, strict=True))
        x, y, t = turned((x, y, t - self.vertex), (-self.tilt[0], -self.tilt[1]))
        return x, y, t + self.vertex

    @property
    def index_after(self) -> Array:
        """Index behind the surface; with a minus behind a mirror, as formulas of refraction want it there."""
        return -self.before if self.mirror else self.behind

    @property
    def power(self) -> Array:
        """What it adds to ``-n u / y`` of rays near the axis, 1/mm."""
        return (self.index_after - self.before) * self.vertex_curvature

    @property
    def vertex_curvature(self) -> Array:
        """Curvature that rays near the axis meet, 1/mm."""
        return self.curvature + 2 * self.aspheric[0] if self.aspheric else self.curvature

    @property
    def fourth_order(self) -> Array:
        """Eight times the depth by the fourth power of the height, less that of the sphere at the vertex."""
        c, own = self.vertex_curvature, 8 * self.aspheric[1] if len(self.aspheric) > 1 else 0.0
        return (1 + self.conic) * self.curvature**3 + own - c**3

    def sag(self, square: Array) -> tuple[Array, Array]:
        """Depth behind the vertex at a squared height, mm, and its derivative by the squared height.

        Beyond the edge of the conic it goes on as at the edge.
        """
        xp = array_namespace(square)
        c = self.curvature
        inside = 1 - (1 + self.conic) * c * c * square
        root = xp.where(inside > 1e-9, inside, 1e-9 + 0 * inside) ** 0.5
        depth, slope = c * square / (1 + root), 0.5 * c / root
        power = 1.0 + 0 * square
        for number, coefficient in enumerate(self.aspheric, start=1):
            slope = slope + number * coefficient * power
            power = power * square
            depth = depth + coefficient * power
        if self.odd:
            height = (square + 1e-300) ** 0.5
            power = height
            for number, coefficient in enumerate(self.odd):
                slope = slope + (1.5 + number) * coefficient * power
                power = power * square
                depth = depth + coefficient * power
        return depth, slope


@dataclass(frozen=True, kw_only=True, slots=True)
class Beam:
    """Rays between two surfaces, each array (...,).

    Attributes:
        position: x, y, t of a point on each ray, mm.
        direction: Unit vector along x, y, t.
        fill: Largest height over semi-diameter at any surface so far, the stop left out; above 1 is clipped.
        stop_fill: The same at the stop.
    """

    position: tuple[Array, Array, Array]
    direction: tuple[Array, Array, Array]
    fill: Array
    stop_fill: Array

    @property
    def passes(self) -> Array:
        """Which rays nothing has stopped, boolean."""
        return (self.fill <= 1) & (self.stop_fill <= 1)

    def at(self, t: Array) -> tuple[Array, Array]:
        """Height x, y of the straight rays in the plane ``t``, mm."""
        (x, y, t0), (dx, dy, dt) = self.position, self.direction
        along = (t - t0) / dt
        return x + along * dx, y + along * dy


def beam_between(start: Sequence[Array], end: Sequence[Array]) -> Beam:
    """Rays from points ``start`` towards points ``end``, each three arrays x, y, t that broadcast."""
    dx, dy, dt = (b - a for a, b in zip(start, end, strict=True))
    length = (dx * dx + dy * dy + dt * dt) ** 0.5
    nothing = 0 * length
    x, y, t = (a + nothing for a in start)
    return Beam(
        position=(x, y, t),
        direction=(dx / length, dy / length, dt / length),
        fill=nothing,
        stop_fill=nothing,
    )


def trace(surfaces: Iterable[Surface], beam: Beam, backwards: bool = False) -> Beam:
    """Send rays through surfaces.

    Args:
        surfaces: From the scene to the sensor, in both cases.
        beam: Rays in front of the first surface that they meet.
        backwards: Whether they come from the sensor.

    Returns:
        The rays behind the last surface that they meet, positions on that surface.

    Source:
        Welford, "Aberrations of optical systems", 1986, 4.2 to 4.4, in vector form.
    """
    for surface in reversed(list(surfaces)) if backwards else surfaces:
        beam = pass_surface(surface, beam, -1.0 if backwards else 1.0)
    return beam


def pass_surface(surface: Surface, beam: Beam, sign: float, met: Met | None = None) -> Beam:
    """Send rays through one surface; ``met`` is what :func:`meet` says of them, where that is known."""
    xp = array_namespace(beam.direction[2])
    if surface.stop:
        x, y = beam.at(surface.vertex)
        stop_fill = xp.maximum(beam.stop_fill, _height(x, y) / surface.semi_diameter)
        position = (x, y, surface.vertex + 0 * x)
        return Beam(position=position, direction=beam.direction, fill=beam.fill, stop_fill=stop_fill)
    if surface.mirror and sign < 0:  # from behind, where its turned shape is seen
        surface = surface.seen_from_behind()
    (x, y, t), normal, hits = meet(surface, beam, sign) if met is None else met
    own = t
    if surface.mirror:
        direction, refracted = _reflect(beam.direction, normal, sign)
        t = 2 * surface.vertex - t
    else:
        ratio = surface.before / surface.behind if sign > 0 else surface.behind / surface.before
        direction, refracted = _refract(beam.direction, normal, ratio, sign)
    height = _height(x, y) if surface.centred else _height(*surface.into((x, y, own))[:2])
    fill = xp.maximum(beam.fill, height / surface.semi_diameter)
    if surface.inner_radius > 0:
        fill = xp.maximum(fill, surface.inner_radius / xp.where(height > 0, height, _GRAZING + 0 * height))
    fill = xp.where(hits & refracted, fill, _LOST * xp.ones_like(x))
    return Beam(position=(x, y, t), direction=direction, fill=fill, stop_fill=beam.stop_fill)


def meet(surface: Surface, beam: Beam, sign: float) -> Met:
    """Where rays meet a surface that is no stop.

    Args:
        surface: The surface.
        beam: Rays.
        sign: 1 where they go towards the sensor, -1 where they come from it.

    Returns:
        The points x, y, t, mm; the normals there, of any length, towards the sensor; and which rays meet it.
        The others are left in the plane of its vertex.
    """
    if not surface.centred:
        return _meet_moved(surface, beam, sign)
    c, conic = surface.curvature, surface.conic
    dx, dy, dt = beam.direction
    xp = array_namespace(dt)
    x, y = beam.at(surface.vertex)
    one = xp.ones_like(x)
    # With the point (x, y, 0) of the vertex plane the conic becomes A s^2 - 2 B s + C = 0.
    lateral = c * (x * x + y * y)
    half = dt - c * (x * dx + y * dy)
    root2 = half * half - c * (1 + conic * dt * dt) * lateral
    hits = root2 > 0
    # The root near the vertex, in the form that knows no cancellation and takes planes, too.
    denominator = half + sign * xp.where(hits, root2, one) ** 0.5
    hits = hits & (sign * denominator > _GRAZING)
    s = xp.where(hits, lateral, 0 * one) / xp.where(hits, denominator, one)
    if surface.aspheric or surface.odd:
        s, met = _meet_asphere(surface, (x, y), beam.direction, s)
        hits = hits & met
    x, y, t = x + s * dx, y + s * dy, s * dt
    if surface.aspheric or surface.odd:
        _, slope = surface.sag(x * x + y * y)
        normal = (-2 * slope * x, -2 * slope * y, one)
    else:
        normal = (-c * x, -c * y, 1 - c * (1 + conic) * t)
    return (x, y, surface.vertex + t), normal, hits


def _meet_moved(surface: Surface, beam: Beam, sign: float) -> Met:
    """What :func:`meet` says of a surface off its place: rays are moved into its frame, and back."""
    back = (-surface.tilt[0], -surface.tilt[1])
    there = replace(beam, position=surface.into(beam.position), direction=turned(beam.direction, back))
    own = replace(surface, shift=(0.0, 0.0, 0.0), tilt=(0.0, 0.0))
    (x, y, t), normal, hits = meet(own, there, sign)
    x, y, t = turned((x, y, t - surface.vertex), surface.tilt)
    right, down, along = surface.shift
    return (x + right, y + down, t + along + surface.vertex), turned(normal, surface.tilt), hits


def turned(vector: tuple[Array, Array, Array], turn: tuple[float, float]) -> tuple[Array, Array, Array]:
    """Vectors x, y, t turned about an axis across the optical one; ``turn`` is that axis times the angle.

    Source:
        Rodrigues' formula: ``v cos + (k x v) sin + k (k.v) (1 - cos)``.
    """
    angle = math.hypot(*turn)
    if angle == 0:
        return vector
    (x, y, t), kx, ky = vector, turn[0] / angle, turn[1] / angle
    cosine, sine = math.cos(angle), math.sin(angle)
    along = (kx * x + ky * y) * (1 - cosine)
    return (
        x * cosine + ky * t * sine + kx * along,
        y * cosine - kx * t * sine + ky * along,
        t * cosine + (kx * y - ky * x) * sine,
    )


def _meet_asphere(
    surface: Surface, start: tuple[Array, Array], direction: tuple[Array, Array, Array], s: Array
) -> tuple[Array, Array]:
    """Length along rays from the vertex plane to an asphere, and which rays meet it; ``s`` begins the search.

    Source:
        Newton's method, as Welford, "Aberrations of optical systems", 1986, 4.7, has it for aspheres.
    """
    (x, y), (dx, dy, dt) = start, direction
    for _ in range(_NEWTON_STEPS):
        px, py = x + s * dx, y + s * dy
        depth, slope = surface.sag(px * px + py * py)
        s = s - (s * dt - depth) / (dt - 2 * slope * (px * dx + py * dy))
    px, py = x + s * dx, y + s * dy
    left = abs(s * dt - surface.sag(px * px + py * py)[0])
    met = left < _MET * (1 + abs(s))
    return array_namespace(s).where(met, s, 0 * s), met


def _height(x: Array, y: Array) -> Array:
    """Distance from the axis; its gradient is 0 on the axis."""
    square = x * x + y * y
    return array_namespace(x).where(square > 0, square, square + 1) ** 0.5 * (square > 0)


def _reflect(
    direction: tuple[Array, Array, Array], normal: tuple[Array, Array, Array], sign: float
) -> tuple[tuple[Array, Array, Array], Array]:
    """Reflection, and the axis turned with it: new direction, and where it goes on along the axis."""
    dx, dy, dt = direction
    nx, ny, nt = normal
    xp = array_namespace(dt)
    along = 2 * (dx * nx + dy * ny + dt * nt) / (nx * nx + ny * ny + nt * nt)
    turned = (dx - along * nx, dy - along * ny, along * nt - dt)
    reflected = (sign * along * nt > 0) & (sign * turned[2] > _GRAZING)
    x, y, t = (xp.where(reflected, new, old) for new, old in zip(turned, direction, strict=True))
    return (x, y, t), reflected


def _refract(
    direction: tuple[Array, Array, Array], normal: tuple[Array, Array, Array], ratio: Array, sign: float
) -> tuple[tuple[Array, Array, Array], Array]:
    """Snell's law: new direction, and where there is one; elsewhere the old direction.

    ``ratio`` is the index before over that after, seen along the ray. Of ``n d`` the part along the surface
    stays, so ``d' = ratio d + (cos' - ratio cos) n``.
    """
    dx, dy, dt = direction
    nx, ny, nt = normal
    xp = array_namespace(dt)
    one = xp.ones_like(dt)
    length = (nx * nx + ny * ny + nt * nt) ** 0.5 * sign
    nx, ny, nt = nx / length, ny / length, nt / length
    cosine = dx * nx + dy * ny + dt * nt
    cosine2 = 1 - ratio * ratio * (1 - cosine * cosine)
    refracted = (cosine2 > 0) & (cosine > 0)
    push = xp.where(refracted, cosine2, one) ** 0.5 - ratio * cosine
    bent = (ratio * dx + push * nx, ratio * dy + push * ny, ratio * dt + push * nt)
    refracted = refracted & (sign * bent[2] > _GRAZING)
    x, y, t = (xp.where(refracted, new, old) for new, old in zip(bent, direction, strict=True))
    return (x, y, t), refracted
