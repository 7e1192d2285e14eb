"""Catalog lenses for training views: as wide open and as large as the wanted blur asks for, undistorted."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses import PrescriptionLens, Rays, TransferLens, load_lens

__all__ = ["TrainingLens", "covered_slope", "make_training_lens"]

_PLACES = 65


@dataclass(frozen=True, kw_only=True)
class TrainingLens:
    """A lens of real glass behind which straight lines are straight; a ``LensModel``.

    Each pixel is moved to where the lens images what a pinhole in its entrance pupil would show there, so
    that pictures agree with an all-in-focus picture wherever they are sharp, as developed photographs do.
    What is left is what cannot be undone: the shape of the blur.

    Attributes:
        lens: The lens as designed, mm.
        scale: How many times larger it is in the scene.
        sensor_distance: Of the pinhole, mm: pixels at ``sensor_xy`` show slopes ``-sensor_xy`` over it.
    """

    lens: PrescriptionLens
    scale: float
    sensor_distance: float

    @cached_property
    def _radii(self) -> tuple[np.ndarray, np.ndarray]:
        """Slopes that a pinhole would show, and the distances from the axis where the lens images them."""
        radius = np.linspace(0, 1.05 * self.lens.prescription.image_radius, _PLACES)
        points = np.stack([-radius, np.zeros(_PLACES)], -1)
        aim = PrescriptionLens(
            prescription=self.lens.prescription,
            f_number=self.lens.f_number,
            focus_distance=self.lens.focus_distance,
            pupil_sampling="exit",
        )
        chief = aim.sample_rays(points, np.zeros_like(points))
        return chief.slope[:, 0] + chief.origin[:, 0] / self.lens.focus_distance, radius

    def coc_radius(self, disparity: Array) -> Array:
        """Signed blur radius on the pinhole's sensor, mm, for inverse depth in 1/mm, by Gaussian optics."""
        pupil = self.scale * abs(self.lens.paraxial.entrance.radius)
        focus = 1 / (self.scale * self.lens.focus_distance)
        return pupil * self.sensor_distance * (disparity - focus)

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        """See :class:`bokehnet.lenses.LensModel`; NumPy arrays only, ``sensor_offset`` must be None."""
        assert sensor_offset is None
        slopes, radii = self._radii
        slope = np.linalg.norm(sensor_xy, axis=-1, keepdims=True) / self.sensor_distance
        enlarged = np.interp(slope, slopes, radii) / np.maximum(slope * self.sensor_distance, 1e-9)
        rays = self.lens.sample_rays(sensor_xy * enlarged.astype(sensor_xy.dtype), pupil_uv, wavelength)
        return Rays(origin=self.scale * rays.origin, slope=rays.slope, weight=rays.weight)


@lru_cache
def covered_slope(name: str) -> float:
    """Slope at the edge of what a lens of the catalog shows when focused at infinity.

    Raises:
        LensError: There is no such lens.
    """
    lens = load_lens(name)
    return float(lens.prescription.image_radius / lens.focal_length)


def make_training_lens(
    name: str, pupil_radius: float, focus_distance: float, stops: float, sensor_distance: float
) -> TrainingLens:
    """Enlarge a lens of the catalog until its pupil fits.

    Args:
        name: In the catalog.
        pupil_radius: Of the entrance pupil, mm.
        focus_distance: From the entrance pupil, mm; may be infinite.
        stops: How far its iris is closed; 0 is fully open.
        sensor_distance: See :class:`TrainingLens`.

    Raises:
        LensError: There is no such lens, or it cannot focus so near.
    """
    design = load_lens(name)
    f_number = design.fastest * 2 ** (stops / 2)
    scale = pupil_radius / (design.focal_length / f_number / 2)
    if not math.isfinite(scale) or scale <= 0:
        raise LensError(f"{name}: pupil radius: expected more than 0 mm, got {pupil_radius:g} mm")
    lens = TransferLens(
        prescription=design.prescription, f_number=f_number, focus_distance=focus_distance / scale
    )
    return TrainingLens(lens=lens, scale=scale, sensor_distance=sensor_distance)
