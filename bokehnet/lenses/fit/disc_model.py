"""The disc that an opening makes of a lamp, smooth in all its parameters."""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.optics.aperture import blade_margin, cats_eye_shift

__all__ = ["LOOK", "Look", "draw_disc", "edge_depth"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """What all discs of a photograph share; names and units are those of the settings.

    Attributes:
        blades: Number of blades; 0 is a round opening.
        curvature: 0 for straight blades to 1 for a disc.
        rotation: Degrees, counter-clockwise.
        spherical_profile: Light at the rim of discs behind focus, -1 to 1.
        obstruction: Radius of the dark core, of the disc's.
        cats_eye: Displacement of the second pupil disc in the corner, in radii.
        axial: Percent of the half-diagonal.
        lateral: Percent of the half-diagonal.
        softness: Standard deviation of what blurs the edges, pixels: the lamp's size, the sensor.
    """

    blades: int = 0
    curvature: float = 0.0
    rotation: float = 0.0
    spherical_profile: float = 0.0
    obstruction: float = 0.0
    cats_eye: float = 0.0
    axial: float = 0.0
    lateral: float = 0.0
    softness: float = 0.4


# Name, smallest and largest value, and the step of its derivative.
LOOK = {
    "curvature": (0.0, 1.0, 2e-3),
    "rotation": (-math.inf, math.inf, 0.1),
    "spherical_profile": (-1.0, 1.0, 2e-3),
    "obstruction": (0.0, 0.95, 2e-3),
    "cats_eye": (0.0, 1.5, 2e-3),
    "axial": (-5.0, 5.0, 2e-3),
    "lateral": (-5.0, 5.0, 2e-3),
    "softness": (0.05, 20.0, 1e-2),
}


def draw_disc(
    look: Look,
    x: np.ndarray,
    y: np.ndarray,
    middle: tuple[float, float],
    radius: float,
    size: tuple[int, int],
) -> np.ndarray:
    """Return the light of a disc at pixels, 1 where an evenly lit one is open.

    Args:
        look: The opening.
        x: Columns of a grid of pixels, (h, w).
        y: Rows.
        middle: Of the disc, x and y.
        radius: Signed, pixels, positive in front of focus.
        size: Width and height of the whole photograph.
    """
    u, v = (x - middle[0]) / radius, (y - middle[1]) / radius
    square = u * u + v * v
    spread = math.hypot(look.softness, math.sqrt(1 / 12))
    side = 1 if radius > 0 else -1
    light = np.maximum(1 - side * look.spherical_profile * (2 * np.minimum(square, 1) - 1), 0)
    edges = []
    if look.obstruction > 0:
        light = light * (1 - _soft(look.obstruction**2 - square, 2 * np.sqrt(square), radius, spread))
    if look.cats_eye > 0:
        right, down = cats_eye_shift(look.cats_eye, middle[0], middle[1], *size)
        away = (u - right) ** 2 + (v - down) ** 2
        edges.append((1 - away, 2 * np.sqrt(away)))
    if look.blades:
        turn = math.radians(look.rotation)
        a, b = u * math.cos(turn) - v * math.sin(turn), u * math.sin(turn) + v * math.cos(turn)
        edges.append(blade_margin(look.blades, look.curvature, a, b, square))
    else:  # blades stay within the circle, and share its corners
        edges.append((1 - square, 2 * np.sqrt(square)))
    for margin, slope in edges:
        light = light * _soft(margin, slope, radius, spread)
    return light


def edge_depth(blades: int, curvature: float) -> float:
    """How far the middle of a blade's edge lies within the circle, radii; straight: 1 - cos(pi / blades)."""
    low, high = math.cos(math.pi / blades), 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        at = np.array([-middle])  # one edge is on the left
        inside = blade_margin(blades, curvature, at, 0 * at, at * at)[0][0] >= 0
        low, high = (middle, high) if inside else (low, middle)
    return 1 - low


def _soft(margin: np.ndarray, slope: np.ndarray, radius: float, spread: float) -> np.ndarray:
    """Share of a pixel that lies where ``margin`` is above 0: the normal distribution of the distance."""
    distance = margin / np.maximum(slope, 1e-3) * abs(radius) / spread
    # Within 2e-3 of the integral; Bowling et al., 2009.
    share: np.ndarray = 1 / (1 + np.exp(-np.clip(1.5976 * distance + 0.07056 * distance**3, -40, 40)))
    return share
