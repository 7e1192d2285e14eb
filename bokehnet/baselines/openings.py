"""What baselines make of an aperture: its outline by angle, and its images at a ladder of blur radii."""

import math
from functools import lru_cache

import numpy as np

from bokehnet.classical.base import check_inputs
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture, transmission

__all__ = ["ANGLES", "check_baseline", "outline", "psf_image", "radius_ladder", "rungs"]

# Angles at which an outline is known; steps along a radius to find it.
ANGLES, _STEPS = 1440, 2048

# Discs of this radius lie inside their own pixel.
_SMALLEST = 0.5

# Largest radius of a table, pixels: beyond it tables take memory and time out of all proportion.
_LARGEST = 256

# Steps of the ladder: pixels, and share of the radius.
_STEP, _RATIO = 0.25, 0.04


def check_baseline(
    name: str, openings: str, image: np.ndarray, defocus: np.ndarray, aperture: Aperture | None
) -> tuple[np.ndarray, np.ndarray, Aperture]:
    """Check what a baseline is given.

    Args:
        name: Of the baseline.
        openings: What it knows, as :class:`bokehnet.baselines.registry.Baseline` has it.
        image: Scene-linear, (H, W, 3).
        defocus: Signed blur radius in pixels, (H, W).
        aperture: None is a plain disc.

    Returns:
        The three, the arrays contiguous float32.

    Raises:
        ShapeError: Not (H, W, 3) and (H, W) of one size.
        ParameterError: NaN or infinity in either, or an opening that the method does not know.
    """
    image, defocus = (np.ascontiguousarray(x, np.float32) for x in check_inputs(image, defocus))
    aperture = aperture or Aperture()
    even = aperture.spherical_profile == aperture.onion == aperture.grain == aperture.obstruction == 0
    fits = {
        "disc": aperture.is_disc,
        "outline": even and aperture.picture is None and aperture.cats_eye == 0,
        "cats-eye": even and aperture.picture is None,
        "any": aperture.cats_eye == 0,
    }
    words = {
        "disc": "a plain disc",
        "outline": "evenly lit, without a hole or a cat's-eye",
        "cats-eye": "evenly lit, without a hole",
        "any": "without a cat's-eye",
    }
    if not fits[openings]:
        raise ParameterError(
            "aperture",
            f"{words[openings]}, all that {name} knows",
            shown="another opening",
            remedy="use the engine `rays`",
        )
    return image, defocus, aperture


@lru_cache(maxsize=8)
def outline(aperture: Aperture) -> np.ndarray:
    """Radius of an opening, in pupil radii, at each of ``ANGLES`` angles from right over down; float32."""
    angle = np.arange(ANGLES) * (2 * math.pi / ANGLES)
    rho = np.arange(1, _STEPS + 1) / _STEPS
    open_here = transmission(aperture, rho * np.cos(angle)[:, None], rho * np.sin(angle)[:, None]) > 0
    return np.asarray(open_here.sum(axis=1) / _STEPS, np.float32)


@lru_cache(maxsize=256)
def psf_image(aperture: Aperture, radius: float, side: int) -> np.ndarray:
    """Image of a point, its light on each pixel of a square around it; float64, sum 1.

    Args:
        aperture: The opening.
        radius: Blur radius in pixels; up to half a pixel all light stays in one.
        side: +1 in front of focus, -1 behind it.

    Raises:
        ParameterError: The radius is larger than tables are made for.
    """
    _check_radius(radius)
    if radius <= _SMALLEST:
        return np.ones((1, 1))
    half = math.ceil(radius - 0.5)
    parts = max(4, math.ceil(48 / radius))
    fine = (2 * half + 1) * parts
    at = ((np.arange(fine) + 0.5) / parts - half - 0.5) * (side / radius)
    light = transmission(aperture, at[None, :], at[:, None], side)
    image = light.reshape(2 * half + 1, parts, 2 * half + 1, parts).sum(axis=(1, 3))
    total = image.sum()
    if total == 0:  # an opening narrower than the finest parts
        image[half, half] = total = 1.0
    return np.asarray(image / total)


def radius_ladder(largest: float) -> np.ndarray:
    """Radii from half a pixel to ``largest``; a radius between two is a mix of both; float64.

    Raises:
        ParameterError: The radius is larger than tables are made for.
    """
    _check_radius(largest)
    found = [_SMALLEST]
    while found[-1] < largest:
        found.append(min(found[-1] + max(_STEP, _RATIO * found[-1]), max(largest, found[-1] + 1e-3)))
    return np.array(found)


def _check_radius(radius: float) -> None:
    if radius > _LARGEST:
        expected = f"blur radii of at most {_LARGEST} pixels, for which tables are made"
        raise ParameterError("defocus", expected, radius, "use the engine `rays`")


def rungs(defocus: np.ndarray, radii: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Where pixels of one side of focus stand on a ladder.

    Args:
        defocus: Signed blur radius in pixels, (H, W), + in front of focus.
        radii: The ladder.
        side: +1 in front of focus, -1 behind it, with what is in focus.

    Returns:
        Rung at or below each pixel's radius, (H, W) int32, -1 for pixels of the other side; and how far it
        stands towards the next one, (H, W) float32 in [0, 1).
    """
    radius = np.abs(defocus)
    low = np.clip(np.searchsorted(radii, radius, side="right") - 1, 0, len(radii) - 1)
    following = radii[np.minimum(low + 1, len(radii) - 1)]
    gap = np.maximum(following - radii[low], 1e-9)
    share = np.clip((radius - radii[low]) / gap, 0, 1)
    here = defocus > 0 if side > 0 else defocus <= 0
    return np.where(here, low, -1).astype(np.int32), share.astype(np.float32)
