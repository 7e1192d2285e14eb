"""Vignetting: natural (cos^4), optical (rims of a lens), tabulated and artistic.

All factors multiply scene-linear light, are above 0, so that division inverts them, and are 1 at strength 0.
Field positions are (..., 2), right and down from the centre, with radius 1 at the corner of the picture. All
functions accept NumPy arrays and tensors and are differentiable with respect to the strengths.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, array_namespace, check_range, constant_like

__all__ = [
    "Vignette",
    "cos4_factor",
    "disc_form_factor",
    "irradiance_cos4",
    "rim_factor",
    "scale_saturation",
    "table_factor",
]

_LUMINANCE = (0.2126, 0.7152, 0.0722)


def irradiance_cos4(field: Array, distance: Array, pupil_radius: Array) -> Array:
    """Return the irradiance by the cos^4 law, for pupils that are small compared with their distance.

    Args:
        field: Distance of the sensor point from the axis, mm.
        distance: Distance from the exit pupil to the sensor, mm.
        pupil_radius: Radius of the exit pupil, mm.

    Returns:
        ``(R / D)^2 cos^4``, the irradiance divided by pi times the radiance.
    """
    square = distance * distance
    return pupil_radius**2 * square / (field * field + square) ** 2


def disc_form_factor(field: Array, distance: Array, pupil_radius: Array) -> Array:
    """Return the irradiance for pupils of any size; arguments and unit are those of :func:`irradiance_cos4`.

    With S = a^2 + Z^2 + r^2 and q = sqrt(S^2 - 4 r^2 a^2) the form factor ``(1 - (S - 2 r^2) / q) / 2`` loses
    all digits for small pupils. Because q^2 - (S - 2 r^2)^2 = 4 r^2 Z^2, it is
    ``2 r^2 Z^2 / (q (q + S - 2 r^2))``.

    Source:
        Moon and Spencer, "The photic field", 1981, on the form factor of a disc parallel to a patch;
        Marsicano, "Rendering real time depth of field effects", 2023, (3.11).
    """
    r2, z2 = pupil_radius * pupil_radius, distance * distance
    total = field * field + z2 + r2
    root = (total * total - 4 * r2 * field * field) ** 0.5
    return 2 * r2 * z2 / (root * (root + total - 2 * r2))


def cos4_factor(field: Array, angle: Array) -> Array:
    """Return the transmitted fraction of light by the cos^4 law, (...,).

    Args:
        field: Field positions, (..., 2).
        angle: Angle between the axis and the ray to the corner, degrees, 0 up to below 90; half the diagonal
            angle of view: 23.4 for a 50 mm lens on full frame, 42 for 24 mm.
    """
    radians = angle * (math.pi / 180)
    xp = array_namespace(radians)
    tangent = xp.sin(radians) / xp.cos(radians)
    return irradiance_cos4((field * field).sum(-1) ** 0.5 * tangent, 1.0, 1.0)


def rim_factor(field: Array, shift: Array) -> Array:
    """Return the fraction of the pupil that a second rim of its size leaves open, (...,): optical vignetting.

    Two unit discs at distance t share ``2 / pi (acos(t / 2) - t / 2 sqrt(1 - t^2 / 4))`` of their area. The
    ``cats_eye`` of :class:`bokehnet.optics.aperture.Aperture` removes this light from blur discs; sharp
    regions lose it as well.

    Args:
        field: Field positions, (..., 2).
        shift: Shift of the rim in the corner, pupil radii, 0 to 1.5.
    """
    xp = array_namespace(field)
    half = 0.5 * shift * (field * field).sum(-1) ** 0.5
    half = xp.clip(half, 0, 1 - 1e-9)
    return 2 / math.pi * (xp.arccos(half) - half * (1 - half * half) ** 0.5)


def table_factor(field: Array, light: Sequence[float]) -> Array:
    """Return the transmitted fraction of light from a table over the radius, (...,), linearly interpolated.

    Args:
        field: Field positions, (..., 2).
        light: Transmitted fractions at equal steps of the radius from the centre to the corner, two or more.
    """
    xp = array_namespace(field)
    position = xp.clip((field * field).sum(-1) ** 0.5 * (len(light) - 1), 0, len(light) - 1)
    below = xp.clip(xp.floor(position), 0, len(light) - 2)
    index = below.astype(np.intp) if xp is np else below.long()
    table = constant_like(np.asarray(light), position)
    return table[index] * (1 - (position - below)) + table[index + 1] * (position - below)


@dataclass(frozen=True, kw_only=True, slots=True)
class Vignette:
    """Artistic vignette: ``2^(-stops m)``, with m rising smoothly from 0 inside ``radius`` to 1.

    Attributes:
        stops: Full darkening in stops, -10 to 10; below 0 the vignette brightens. A float, or a
            tensor without dimensions, like the other fields.
        radius: Inner radius of the vignette, half-diagonals (1 at the corner), 0 to 2.
        softness: Distance from the inner radius to full strength, half-diagonals, 0.01 to 2.
        roundness: 1 for a circle, 0 for an ellipse with the proportions of the picture; both have the same
            value in the corners.
        color_loss: Fraction of the saturation removed at full strength, 0 to 1 (grey); luminance is
            preserved.

    Raises:
        ParameterError: A number is out of range.
    """

    stops: Array
    radius: Array = 0.3
    softness: Array = 0.7
    roundness: Array = 1.0
    color_loss: Array = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("stops", -10, 10),
            ("radius", 0, 2),
            ("softness", 0.01, 2),
            ("roundness", 0, 1),
            ("color_loss", 0, 1),
        ):
            check_range(name, getattr(self, name), low, high)

    def factor(self, field: Array, aspect: float) -> Array:
        """Return the factor, (...,).

        Args:
            field: Field positions, (..., 2).
            aspect: Width of the picture over its height.
        """
        return 2 ** (-self.stops * self._strength(field, aspect))

    def color(self, field: Array, aspect: float) -> Array:
        """Return the remaining fraction of the saturation, (...,), for :func:`scale_saturation`.

        Args:
            field: Field positions, (..., 2).
            aspect: Width of the picture over its height.

        Source:
            Thesis 004, 3.3, which mixes with the length of the colour instead of its luminance.
        """
        return 1 - self.color_loss * self._strength(field, aspect)

    def _strength(self, field: Array, aspect: float) -> Array:
        """Return m, (...,), from 0 to 1."""
        xp = array_namespace(field)
        x, y = field[..., 0] ** 2, field[..., 1] ** 2
        circle = x + y
        ellipse = 0.5 * (1 + aspect**-2) * x + 0.5 * (1 + aspect**2) * y
        square = ellipse + self.roundness * (circle - ellipse)
        full = self.radius + self.softness
        m = xp.clip((square - self.radius**2) / (full**2 - self.radius**2), 0, 1)
        return m * m * (3 - 2 * m)


def scale_saturation(light: Array, factor: Array) -> Array:
    """Scale the distance of light (..., 3), scene-linear Rec.709, from grey by ``factor`` (...,).

    Preserves the luminance of ITU-R BT.709.
    """
    grey = (light * constant_like(np.array(_LUMINANCE), light)).sum(-1)[..., None]
    return grey + factor[..., None] * (light - grey)
