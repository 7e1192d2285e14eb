"""How pictures darken towards their corners: by geometry, by the rims of a lens, and by taste.

All factors multiply scene-linear light, are above 0, so that dividing undoes them, and 1 at strength 0.
Field positions are (..., 2), right and down from the middle, the corner of the picture at radius 1. NumPy
arrays and tensors alike, differentiable with respect to the strengths.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import Array, array_namespace, check_range, constant_like
from bokehnet.optics.irradiance import irradiance_cos4

__all__ = ["Vignette", "cos4_factor", "rim_factor", "table_factor", "with_color"]

_LUMINANCE = (0.2126, 0.7152, 0.0722)


def cos4_factor(field: Array, angle: Array) -> Array:
    """Light that the cos^4 law leaves, (...,).

    Args:
        field: Field positions, (..., 2).
        angle: Between the axis and the ray to the corner, degrees, 0 up to below 90; half the angle of view
            across the diagonal: 23.4 for a 50 mm lens on full frame, 42 for 24 mm.
    """
    radians = angle * (math.pi / 180)
    xp = array_namespace(radians)
    tangent = xp.sin(radians) / xp.cos(radians)
    return irradiance_cos4((field * field).sum(-1) ** 0.5 * tangent, 1.0, 1.0)


def rim_factor(field: Array, shift: Array) -> Array:
    """Share of the pupil that a second rim of its size leaves open, (...,): optical vignetting.

    Two unit discs at distance t share ``2 / pi (acos(t / 2) - t / 2 sqrt(1 - t^2 / 4))`` of their area. It
    is the light that the same ``cats_eye`` of :class:`bokehnet.optics.aperture.Aperture` cuts from blur
    discs, and it is missing in sharp places as well.

    Args:
        field: Field positions, (..., 2).
        shift: Of the rim in the corner, in radii of the pupil, 0 to 1.5.
    """
    xp = array_namespace(field)
    half = 0.5 * shift * (field * field).sum(-1) ** 0.5
    half = xp.clip(half, 0, 1 - 1e-9)
    return 2 / math.pi * (xp.arccos(half) - half * (1 - half * half) ** 0.5)


def table_factor(field: Array, light: Sequence[float]) -> Array:
    """Light that a table over the radius leaves, (...,), in straight lines between its places.

    Args:
        field: Field positions, (..., 2).
        light: At even steps of the radius from the middle to the corner, two or more.
    """
    xp = array_namespace(field)
    place = xp.clip((field * field).sum(-1) ** 0.5 * (len(light) - 1), 0, len(light) - 1)
    below = xp.clip(xp.floor(place), 0, len(light) - 2)
    index = below.astype(np.intp) if xp is np else below.long()
    table = constant_like(np.asarray(light), place)
    return table[index] * (1 - (place - below)) + table[index + 1] * (place - below)


@dataclass(frozen=True, kw_only=True, slots=True)
class Vignette:
    """A vignette of taste: ``2^(-stops m)``, m rising smoothly from 0 within ``radius`` to 1.

    Attributes:
        stops: Stops by which it darkens where it is full; below 0 it brightens. -10 to 10. A float, or a
            tensor without dimensions, as the others.
        radius: Where it begins, in half-diagonals (the corner is 1), 0 to 2.
        softness: How much farther out it is full, 0.01 to 2.
        roundness: 1 a circle, 0 the ellipse with the proportions of the picture; both the same in its
            corners.
        color_loss: Share of the colour that it takes where it is full, 0 to 1 (grey); luminance stays.

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
        """The factor, (...,).

        Args:
            field: Field positions, (..., 2).
            aspect: Width of the picture over its height.
        """
        return 2 ** (-self.stops * self._strength(field, aspect))

    def color(self, field: Array, aspect: float) -> Array:
        """Share of the colour that is left, (...,), see :func:`with_color`; arguments as of :meth:`factor`.

        Source:
            Thesis 004, 3.3, which mixes with the length of the colour instead of its luminance.
        """
        return 1 - self.color_loss * self._strength(field, aspect)

    def _strength(self, field: Array, aspect: float) -> Array:
        """m, (...,), from 0 to 1."""
        xp = array_namespace(field)
        x, y = field[..., 0] ** 2, field[..., 1] ** 2
        circle = x + y
        ellipse = 0.5 * (1 + aspect**-2) * x + 0.5 * (1 + aspect**2) * y
        square = ellipse + self.roundness * (circle - ellipse)
        full = self.radius + self.softness
        m = xp.clip((square - self.radius**2) / (full**2 - self.radius**2), 0, 1)
        return m * m * (3 - 2 * m)


def with_color(light: Array, share: Array) -> Array:
    """Light (..., 3), scene-linear Rec.709, with ``share`` (...,) times its distance from grey.

    Grey has the luminance of ITU-R BT.709, which stays as it is.
    """
    grey = (light * constant_like(np.array(_LUMINANCE), light)).sum(-1)[..., None]
    return grey + share[..., None] * (light - grey)
