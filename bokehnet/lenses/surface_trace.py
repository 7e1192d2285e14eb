"""Sequential ray tracing through surfaces, for all rays at once.

The axis ``t`` in mm runs from the scene to the sensor; rays may travel either way. Behind a mirror the axis
is reversed with the light, so that it continues to the sensor: positions and shapes are those of the unfolded
system. Rays that miss a surface, are totally reflected or are clipped are marked and continue unchanged, so
that all numbers and gradients stay finite; the marks have no gradient.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from bokehnet.checks import Array, array_namespace

__all__ = ["Beam", "Intersection", "Surface", "beam_between", "intersect", "pass_surface", "rotated", "trace"]

Intersection = tuple[tuple[Array, Array, Array], tuple[Array, Array, Array], Array]
"""Points x, y, t; normals of any length towards the sensor; True for rays that meet the surface."""

# Height over semi-diameter of rays that a surface cannot pass on: larger than that of clipped rays.
_LOST = 1e6
# Iterations for the intersection with an asphere, and tolerance of the residual, mm per mm.
_NEWTON_ITERATIONS, _NEWTON_TOLERANCE = 10, 1e-9
# Smallest axial component of a unit direction.
_MIN_AXIAL = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True)
class Surface:
    """Conic ``c (x^2 + y^2 + (1 + k) t^2) = 2 t``, relative to its vertex, or a stop.

    An asphere adds powers of the height to the sag of the conic.

    Attributes:
        vertex: Position of the vertex, mm.
        curvature: 1 / radius, 1/mm; positive if the centre is on the sensor side; 0 is a plane.
        semi_diameter: Radius beyond which rays are clipped, mm.
        conic: k; 0 is a sphere, -1 a parabola.
        before: Refractive index on the scene side, a number or one per ray.
        behind: Refractive index on the sensor side, a number or one per ray.
        stop: True for the aperture stop.
        aspheric: Coefficients of the height to the powers 2, 4, 6, ..., mm^-1, mm^-3, ...
        odd: Coefficients of the height to the powers 3, 5, 7, ..., mm^-2, mm^-4, ...
        mirror: True for a mirror; the index is then the same on both sides.
        inner_radius: Radius below which rays are blocked, mm.
        shift: Decentring of the vertex, x, y, t, mm.
        tilt: Rotation about the vertex: radians about axes along x and y, together one rotation about
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
        """True if the surface is centred on the axis."""
        return not any(self.shift) and not any(self.tilt)

    def flipped(self) -> "Surface":
        """Return the surface for a reversed axis, about its position."""
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

    def to_local(self, position: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        """Return positions x, y, t in the frame of the surface, whose vertex is at :attr:`vertex`."""
        x, y, t = (value - offset for value, offset in zip(position, self.shift, strict=True))
        x, y, t = rotated((x, y, t - self.vertex), (-self.tilt[0], -self.tilt[1]))
        return x, y, t + self.vertex

    @property
    def index_after(self) -> Array:
        """Index behind the surface, with the sign of paraxial formulas: negative behind a mirror."""
        return -self.before if self.mirror else self.behind

    @property
    def power(self) -> Array:
        """Contribution to ``-n u / y`` of paraxial rays, 1/mm."""
        return (self.index_after - self.before) * self.vertex_curvature

    @property
    def vertex_curvature(self) -> Array:
        """Curvature at the vertex, 1/mm."""
        return self.curvature + 2 * self.aspheric[0] if self.aspheric else self.curvature

    @property
    def fourth_order(self) -> Array:
        """Eight times the fourth-order coefficient of the sag, less that of the sphere at the vertex."""
        c, aspheric = self.vertex_curvature, 8 * self.aspheric[1] if len(self.aspheric) > 1 else 0.0
        return (1 + self.conic) * self.curvature**3 + aspheric - c**3

    def sag(self, square: Array) -> tuple[Array, Array]:
        """Return the sag at a squared height, mm, and its derivative with respect to the squared height.

        Constant continuation beyond the edge of the conic.
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
        fill: Largest height over semi-diameter at any surface so far, except the stop; above 1 is clipped.
        stop_fill: Height over semi-diameter at the stop; above 1 is clipped.
    """

    position: tuple[Array, Array, Array]
    direction: tuple[Array, Array, Array]
    fill: Array
    stop_fill: Array

    @property
    def passes(self) -> Array:
        """True for unobstructed rays."""
        return (self.fill <= 1) & (self.stop_fill <= 1)

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return the height x, y of the straight rays in the plane ``t``, mm."""
        (x, y, t0), (dx, dy, dt) = self.position, self.direction
        along = (t - t0) / dt
        return x + along * dx, y + along * dy


def beam_between(start: Sequence[Array], end: Sequence[Array]) -> Beam:
    """Return rays from points ``start`` towards points ``end``, each three arrays x, y, t that broadcast."""
    dx, dy, dt = (b - a for a, b in zip(start, end, strict=True))
    length = (dx * dx + dy * dy + dt * dt) ** 0.5
    zeros = 0 * length
    x, y, t = (a + zeros for a in start)
    return Beam(
        position=(x, y, t),
        direction=(dx / length, dy / length, dt / length),
        fill=zeros,
        stop_fill=zeros,
    )


def trace(surfaces: Iterable[Surface], beam: Beam, backwards: bool = False) -> Beam:
    """Trace rays through surfaces.

    Args:
        surfaces: Surfaces from the scene to the sensor, for both directions.
        beam: Rays in front of the first surface on their way.
        backwards: True for rays from the sensor.

    Returns:
        The rays behind the last surface on their way, with positions on that surface.

    Source:
        Welford, "Aberrations of optical systems", 1986, 4.2 to 4.4, in vector form.
    """
    for surface in reversed(list(surfaces)) if backwards else surfaces:
        beam = pass_surface(surface, beam, -1.0 if backwards else 1.0)
    return beam


def pass_surface(surface: Surface, beam: Beam, sign: float, intersection: Intersection | None = None) -> Beam:
    """Trace rays through one surface; ``intersection`` is the result of :func:`intersect`, if known."""
    xp = array_namespace(beam.direction[2])
    if surface.stop:
        x, y = beam.at(surface.vertex)
        stop_fill = xp.maximum(beam.stop_fill, _height(x, y) / surface.semi_diameter)
        position = (x, y, surface.vertex + 0 * x)
        return Beam(position=position, direction=beam.direction, fill=beam.fill, stop_fill=stop_fill)
    if surface.mirror and sign < 0:  # from behind, where the shape is flipped
        surface = surface.flipped()
    (x, y, t), normal, hits = intersect(surface, beam, sign) if intersection is None else intersection
    local_t = t
    if surface.mirror:
        direction, refracted = _reflect(beam.direction, normal, sign)
        t = 2 * surface.vertex - t
    else:
        ratio = surface.before / surface.behind if sign > 0 else surface.behind / surface.before
        direction, refracted = _refract(beam.direction, normal, ratio, sign)
    height = _height(x, y) if surface.centred else _height(*surface.to_local((x, y, local_t))[:2])
    fill = xp.maximum(beam.fill, height / surface.semi_diameter)
    if surface.inner_radius > 0:
        fill = xp.maximum(fill, surface.inner_radius / xp.where(height > 0, height, _MIN_AXIAL + 0 * height))
    fill = xp.where(hits & refracted, fill, _LOST * xp.ones_like(x))
    return Beam(position=(x, y, t), direction=direction, fill=fill, stop_fill=beam.stop_fill)


def intersect(surface: Surface, beam: Beam, sign: float) -> Intersection:
    """Return the intersections of rays with a surface other than a stop.

    Args:
        surface: Surface to intersect.
        beam: Rays.
        sign: 1 for rays towards the sensor, -1 for rays from it.

    Returns:
        The points x, y, t, mm; the normals at them, of any length, towards the sensor; and True for rays that
        meet the surface. The other rays stay in the plane of its vertex.
    """
    if not surface.centred:
        return _intersect_decentred(surface, beam, sign)
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
    # The root near the vertex, in the form that avoids cancellation and includes planes.
    denominator = half + sign * xp.where(hits, root2, one) ** 0.5
    hits = hits & (sign * denominator > _MIN_AXIAL)
    s = xp.where(hits, lateral, 0 * one) / xp.where(hits, denominator, one)
    if surface.aspheric or surface.odd:
        s, intersection = _intersect_asphere(surface, (x, y), beam.direction, s)
        hits = hits & intersection
    x, y, t = x + s * dx, y + s * dy, s * dt
    if surface.aspheric or surface.odd:
        _, slope = surface.sag(x * x + y * y)
        normal = (-2 * slope * x, -2 * slope * y, one)
    else:
        normal = (-c * x, -c * y, 1 - c * (1 + conic) * t)
    return (x, y, surface.vertex + t), normal, hits


def _intersect_decentred(surface: Surface, beam: Beam, sign: float) -> Intersection:
    """Intersect a surface off the axis in its own frame; arguments and result as :func:`intersect`."""
    back = (-surface.tilt[0], -surface.tilt[1])
    local_beam = replace(
        beam, position=surface.to_local(beam.position), direction=rotated(beam.direction, back)
    )
    centred = replace(surface, shift=(0.0, 0.0, 0.0), tilt=(0.0, 0.0))
    (x, y, t), normal, hits = intersect(centred, local_beam, sign)
    x, y, t = rotated((x, y, t - surface.vertex), surface.tilt)
    right, down, along = surface.shift
    return (x + right, y + down, t + along + surface.vertex), rotated(normal, surface.tilt), hits


def rotated(vector: tuple[Array, Array, Array], rotation: tuple[float, float]) -> tuple[Array, Array, Array]:
    """Return vectors x, y, t rotated about a lateral axis; ``rotation`` is that axis times the angle.

    Source:
        Rodrigues' formula: ``v cos + (k x v) sin + k (k.v) (1 - cos)``.
    """
    angle = math.hypot(*rotation)
    if angle == 0:
        return vector
    (x, y, t), kx, ky = vector, rotation[0] / angle, rotation[1] / angle
    cosine, sine = math.cos(angle), math.sin(angle)
    along = (kx * x + ky * y) * (1 - cosine)
    return (
        x * cosine + ky * t * sine + kx * along,
        y * cosine - kx * t * sine + ky * along,
        t * cosine + (kx * y - ky * x) * sine,
    )


def _intersect_asphere(
    surface: Surface, start: tuple[Array, Array], direction: tuple[Array, Array, Array], s: Array
) -> tuple[Array, Array]:
    """Return the length along rays from the vertex plane to an asphere, and True for rays that meet it.

    ``s`` is the initial length.

    Source:
        Newton's method, as in Welford, "Aberrations of optical systems", 1986, 4.7, for aspheres.
    """
    (x, y), (dx, dy, dt) = start, direction
    for _ in range(_NEWTON_ITERATIONS):
        px, py = x + s * dx, y + s * dy
        depth, slope = surface.sag(px * px + py * py)
        s = s - (s * dt - depth) / (dt - 2 * slope * (px * dx + py * dy))
    px, py = x + s * dx, y + s * dy
    residual = abs(s * dt - surface.sag(px * px + py * py)[0])
    intersection = residual < _NEWTON_TOLERANCE * (1 + abs(s))
    return array_namespace(s).where(intersection, s, 0 * s), intersection


def _height(x: Array, y: Array) -> Array:
    """Return the distance from the axis; its gradient is 0 on the axis."""
    square = x * x + y * y
    return array_namespace(x).where(square > 0, square, square + 1) ** 0.5 * (square > 0)


def _reflect(
    direction: tuple[Array, Array, Array], normal: tuple[Array, Array, Array], sign: float
) -> tuple[tuple[Array, Array, Array], Array]:
    """Return the reflected direction, in the reversed axis, and True for rays that continue along it."""
    dx, dy, dt = direction
    nx, ny, nt = normal
    xp = array_namespace(dt)
    along = 2 * (dx * nx + dy * ny + dt * nt) / (nx * nx + ny * ny + nt * nt)
    mirrored = (dx - along * nx, dy - along * ny, along * nt - dt)
    reflected = (sign * along * nt > 0) & (sign * mirrored[2] > _MIN_AXIAL)
    x, y, t = (xp.where(reflected, new, old) for new, old in zip(mirrored, direction, strict=True))
    return (x, y, t), reflected


def _refract(
    direction: tuple[Array, Array, Array], normal: tuple[Array, Array, Array], ratio: Array, sign: float
) -> tuple[tuple[Array, Array, Array], Array]:
    """Return the refracted direction by Snell's law, else the old one; and True for refracted rays.

    ``ratio`` is the index before over that after, seen along the ray. Of ``n d`` the part along the surface
    is preserved, so ``d' = ratio d + (cos' - ratio cos) n``.
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
    new_direction = (
        ratio * dx + push * nx,
        ratio * dy + push * ny,
        ratio * dt + push * nt,
    )
    refracted = refracted & (sign * new_direction[2] > _MIN_AXIAL)
    x, y, t = (xp.where(refracted, new, old) for new, old in zip(new_direction, direction, strict=True))
    return (x, y, t), refracted
