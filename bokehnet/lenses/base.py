"""What every lens can do."""

from dataclasses import dataclass
from typing import Protocol

from bokehnet.checks import Array, check_rank

__all__ = ["LensModel", "Rays", "defocus_map"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Rays:
    """Rays that leave the lens plane z = 0 into the scene, z > 0.

    A point of the ray at depth z is ``origin + z * slope``.

    Attributes:
        origin: Where the ray crosses the lens plane, mm, shape (..., 2).
        slope: Lateral travel per unit of depth, shape (..., 2).
    """

    origin: Array
    slope: Array


class LensModel(Protocol):
    """A lens in the plane z = 0 that images the scene at z > 0 on a sensor behind it."""

    def coc_radius(self, disparity: Array) -> Array:
        """Signed blur radius on the sensor, mm, for inverse depth in 1/mm; positive in front of focus."""
        ...

    def sample_rays(self, sensor_xy: Array, pupil_uv: Array) -> Rays:
        """Rays from sensor points (..., 2), mm, through points (..., 2) of the unit disc."""
        ...


def defocus_map(disparity: Array, lens: LensModel, pixel_pitch: float) -> Array:
    """Return the signed circle-of-confusion radius of every pixel.

    Args:
        disparity: Inverse depth, 1/mm, shape (H, W), array or tensor; 0 is infinitely far.
        lens: Any lens model; only its paraxial properties are used.
        pixel_pitch: Distance between the centres of two pixels, mm.

    Returns:
        Radius in pixels, shape (H, W), positive in front of the focal plane.

    Raises:
        ShapeError: ``disparity`` is not two-dimensional.

    Source:
        Potmesil and Chakravarty, "A lens and aperture camera model for synthetic image generation",
        SIGGRAPH 1981; rewritten to be linear in disparity.
    """
    check_rank("disparity", disparity, 2, "(H, W)")
    return lens.coc_radius(disparity) / pixel_pitch
