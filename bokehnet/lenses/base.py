"""Interface of all lens models, and the defocus map of a lens."""

import math
from dataclasses import dataclass
from typing import Protocol

from bokehnet.checks import Array, Values, check_rank, number_of
from bokehnet.errors import LensError, ParameterError

__all__ = ["LensModel", "Rays", "check_lens_number", "defocus_map"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Rays:
    """Rays that leave the plane z = 0 into the scene, z > 0.

    The point of a ray at depth z is ``origin + z * slope``.

    Attributes:
        origin: Intersection of the ray, or its straight continuation, with the plane z = 0, mm, (..., 2).
        slope: Lateral displacement per unit of depth, (..., 2).
        weight: Transmitted fraction of light, >= 0, (...,); None is 1 for all rays.
            The mean of ``weight * radiance`` over the unit disc is the light on the sensor, relative to
            that of the open pupil at the centre of the picture. Rays of weight 0 are finite.
    """

    origin: Array
    slope: Array
    weight: Array | None = None


class LensModel(Protocol):
    """Lens that images the scene at z > 0 on a sensor behind it.

    The plane z = 0 is that of the entrance pupil: its centre is the centre of perspective, and blur is linear
    in inverse depth measured from it. For a thin lens whose stop is the lens, it is the lens plane.
    """

    def coc_radius(self, disparity: Array) -> Array:
        """Return the signed blur radius on the sensor, mm; positive in front of focus; disparity in 1/mm."""
        ...

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        """Return rays from sensor points through the pupil into the scene.

        Args:
            sensor_xy: Points of the sensor, mm, (..., 2); the image on it is turned by 180 degrees.
            pupil_uv: Points of the unit disc, (..., 2).
            wavelength: Wavelength, nm, a number or (...,); None is the design wavelength of the lens.
            sensor_offset: Distance of each point behind the sensor plane of the lens, mm, a number or
                (...,); None is 0. Tilted sensors need it.
        """
        ...


def defocus_map(disparity: Values, lens: LensModel, pixel_pitch: float) -> Values:
    """Return the signed circle-of-confusion radius of every pixel.

    Args:
        disparity: Inverse depth, 1/mm, (H, W), array or tensor; 0 is infinitely far.
        lens: Any lens model; only its paraxial properties are used.
        pixel_pitch: Distance between the centres of two pixels, mm.

    Returns:
        Radius in pixels, (H, W), positive in front of the focal plane.

    Raises:
        ShapeError: ``disparity`` is not two-dimensional.

    Source:
        Potmesil and Chakravarty, "A lens and aperture camera model for synthetic image generation",
        SIGGRAPH 1981; rewritten to be linear in disparity.
    """
    check_rank("disparity", disparity, 2, "(H, W)")
    defocus: Values = lens.coc_radius(disparity) / pixel_pitch
    return defocus


def check_lens_number(name: str, value: object, *, finite: bool = False) -> float:
    """Return ``value`` as a number; raise ``LensError`` if it is not one, or not finite although required."""
    number = number_of(value)
    if math.isnan(number) or (finite and math.isinf(number)):
        problem = ParameterError(name, "a finite number" if finite else "a number", value)
        raise LensError(str(problem), parameter=name)
    return number
