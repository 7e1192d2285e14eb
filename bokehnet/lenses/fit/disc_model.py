"""Model of the blur disc of a lamp, smooth in all its parameters."""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.optics.aperture import blade_margin, cats_eye_shift

__all__ = ["LOOK", "Look", "draw_disc", "edge_depth"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """Parameters shared by all discs of a photograph; names and units are those of the settings.

    Attributes:
        blades: Number of blades; 0 is a round aperture.
        curvature: Curvature of the blades, from 0 (straight) to 1 (disc).
        rotation: Rotation, degrees, counter-clockwise.
        spherical_profile: Light at the rim of discs behind focus, -1 to 1.
        obstruction: Radius of the dark core, disc radii.
        cats_eye: Shift of the second pupil disc in the corner, disc radii.
        axial: Axial chromatic aberration, percent of the half-diagonal.
        lateral: Lateral chromatic aberration, percent of the half-diagonal.
        softness: Standard deviation of the blur of the edges, pixels: lamp size and sensor.
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


# Name: lower and upper bound, and step of finite differences.
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
    """Return the light of a disc at pixels, 1 inside an evenly lit one.

    Args:
        look: Parameters of the disc.
        x: Columns of a grid of pixels, (h, w).
        y: Rows of a grid of pixels, (h, w).
        middle: Centre of the disc, x and y, pixels.
        radius: Signed radius, pixels, positive in front of focus.
        size: Width and height of the whole photograph, pixels.
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
        square_distance = (u - right) ** 2 + (v - down) ** 2
        edges.append((1 - square_distance, 2 * np.sqrt(square_distance)))
    if look.blades:
        angle = math.radians(look.rotation)
        a, b = u * math.cos(angle) - v * math.sin(angle), u * math.sin(angle) + v * math.cos(angle)
        edges.append(blade_margin(look.blades, look.curvature, a, b, square))
    else:  # blades stay within the circle, and share its corners
        edges.append((1 - square, 2 * np.sqrt(square)))
    for margin, slope in edges:
        light = light * _soft(margin, slope, radius, spread)
    return light


def edge_depth(blades: int, curvature: float) -> float:
    """Return the depth of a blade edge inside the circle, radii; 1 - cos(pi / blades) if straight."""
    low, high = math.cos(math.pi / blades), 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        at = np.array([-middle])  # one edge is on the left
        inside = blade_margin(blades, curvature, at, 0 * at, at * at)[0][0] >= 0
        low, high = (middle, high) if inside else (low, middle)
    return 1 - low


def _soft(margin: np.ndarray, slope: np.ndarray, radius: float, spread: float) -> np.ndarray:
    """Return the fraction of a pixel with ``margin`` above 0: the normal distribution of the distance."""
    distance = margin / np.maximum(slope, 1e-3) * abs(radius) / spread
    # Within 2e-3 of the integral; Bowling et al., 2009.
    fraction: np.ndarray = 1 / (1 + np.exp(-np.clip(1.5976 * distance + 0.07056 * distance**3, -40, 40)))
    return fraction
