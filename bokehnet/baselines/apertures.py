"""Aperture tables of the baselines: outline by angle, and images at a ladder of blur radii."""

import math
from functools import lru_cache

import numpy as np

from bokehnet.classical.base import check_inputs
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture, transmission

__all__ = ["ANGLES", "check_baseline", "ladder_positions", "outline", "psf_image", "radius_ladder"]

# Number of angles of an outline, and of steps along a radius to measure it.
ANGLES, _STEPS = 1440, 2048

# Maximum radius of a disc inside its own pixel.
_MIN_RADIUS_PX = 0.5

# Maximum radius of a table, pixels: larger tables need excessive memory and time.
_MAX_RADIUS_PX = 256

# Steps of the ladder: minimum in pixels, and as a fraction of the radius.
_MIN_STEP_PX, _RELATIVE_STEP = 0.25, 0.04


def check_baseline(
    name: str, apertures: str, image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None
) -> tuple[np.ndarray, np.ndarray, Aperture]:
    """Check the inputs of a baseline.

    Args:
        name: Name of the baseline.
        apertures: Apertures that it supports, see :class:`bokehnet.baselines.registry.Baseline`.
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: Aperture; None means a plain disc.

    Returns:
        Image, defocus and aperture; the arrays are contiguous float32.

    Raises:
        ShapeError: The arrays are not (H, W, 3) and (H, W) of one size.
        ParameterError: An array has NaN or infinity, or the method does not support the aperture.
    """
    image, defocus = (np.ascontiguousarray(x, np.float32) for x in check_inputs(image, defocus))
    aperture = aperture or Aperture()
    uniform = aperture.spherical_profile == aperture.onion == aperture.grain == aperture.obstruction == 0
    fits = {
        "disc": aperture.is_disc,
        "outline": uniform and aperture.picture is None and aperture.cats_eye == 0,
        "cats-eye": uniform and aperture.picture is None,
        "any": aperture.cats_eye == 0,
    }
    descriptions = {
        "disc": "a plain disc",
        "outline": "a uniform aperture without a hole or a cat's-eye",
        "cats-eye": "a uniform aperture without a hole",
        "any": "an aperture without a cat's-eye",
    }
    if not fits[apertures]:
        raise ParameterError(
            "aperture",
            f"{descriptions[apertures]}, the only kind that {name} supports",
            shown="another aperture",
            remedy="use the engine `rays`",
        )
    return image, defocus, aperture


@lru_cache(maxsize=8)
def outline(aperture: Aperture) -> np.ndarray:
    """Return the radius of an aperture, pupil radii, at ``ANGLES`` angles from right over down, float32."""
    angle = np.arange(ANGLES) * (2 * math.pi / ANGLES)
    rho = np.arange(1, _STEPS + 1) / _STEPS
    transparent = transmission(aperture, rho * np.cos(angle)[:, None], rho * np.sin(angle)[:, None]) > 0
    return np.asarray(transparent.sum(axis=1) / _STEPS, np.float32)


@lru_cache(maxsize=256)
def psf_image(aperture: Aperture, radius: float, side: int) -> np.ndarray:
    """Return the image of a point, its light on each pixel of a square around it, float64, sum 1.

    Args:
        aperture: Aperture.
        radius: Blur radius in pixels; up to half a pixel all light stays in one pixel.
        side: +1 in front of focus, -1 behind it.

    Raises:
        ParameterError: The radius exceeds the maximum of the tables.
    """
    _check_radius(radius)
    if radius <= _MIN_RADIUS_PX:
        return np.ones((1, 1))
    half = math.ceil(radius - 0.5)
    parts = max(4, math.ceil(48 / radius))
    fine = (2 * half + 1) * parts
    position = ((np.arange(fine) + 0.5) / parts - half - 0.5) * (side / radius)
    light = transmission(aperture, position[None, :], position[:, None], side)
    image = light.reshape(2 * half + 1, parts, 2 * half + 1, parts).sum(axis=(1, 3))
    total = image.sum()
    if total == 0:  # an aperture narrower than the finest subpixels
        image[half, half] = total = 1.0
    return np.asarray(image / total)


def radius_ladder(largest: float) -> np.ndarray:
    """Return radii from half a pixel to ``largest``, float64; a radius between two is a mix of both.

    Raises:
        ParameterError: The radius exceeds the maximum of the tables.
    """
    _check_radius(largest)
    radii = [_MIN_RADIUS_PX]
    while radii[-1] < largest:
        radii.append(
            min(radii[-1] + max(_MIN_STEP_PX, _RELATIVE_STEP * radii[-1]), max(largest, radii[-1] + 1e-3))
        )
    return np.array(radii)


def _check_radius(radius: float) -> None:
    if radius > _MAX_RADIUS_PX:
        expected = f"blur radii of at most {_MAX_RADIUS_PX} pixels, the maximum of its tables"
        raise ParameterError("defocus", expected, radius, "use the engine `rays`")


def ladder_positions(defocus: np.ndarray, radii: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions of pixels of one side of focus on a ladder.

    Args:
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        radii: Radii of the ladder.
        side: +1 in front of focus, -1 behind or in focus.

    Returns:
        Index of the step at or below each pixel's radius, (H, W) int32, -1 for pixels of the other side; and
        the fraction towards the next step, (H, W) float32 in [0, 1).
    """
    radius = np.abs(defocus)
    low = np.clip(np.searchsorted(radii, radius, side="right") - 1, 0, len(radii) - 1)
    following = radii[np.minimum(low + 1, len(radii) - 1)]
    gap = np.maximum(following - radii[low], 1e-9)
    fraction = np.clip((radius - radii[low]) / gap, 0, 1)
    on_side = defocus > 0 if side > 0 else defocus <= 0
    return np.where(on_side, low, -1).astype(np.int32), fraction.astype(np.float32)
