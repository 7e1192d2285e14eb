"""Catalog lenses for training views, scaled to a given pupil radius and without distortion."""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from bokehnet.checks import Array
from bokehnet.errors import LensError
from bokehnet.lenses import PrescriptionLens, Rays, TransferLens, load_lens

__all__ = ["TrainingLens", "covered_slope", "make_training_lens"]

_NUM_RADII = 65


@dataclass(frozen=True, kw_only=True)
class TrainingLens:
    """Lens of real glass without distortion; a ``LensModel``.

    Each pixel is moved to the position where the lens images the direction that a pinhole in its entrance
    pupil shows there, so that in-focus regions agree with an all-in-focus picture, as in photographs with
    distortion correction. The shape of the blur remains that of the lens.

    Attributes:
        lens: Lens as designed, mm.
        scale: Scale of the lens in the scene.
        sensor_distance: Sensor distance of the pinhole, mm: pixels at ``sensor_xy`` show the slopes
            ``-sensor_xy / sensor_distance``.
    """

    lens: PrescriptionLens
    scale: float
    sensor_distance: float

    @cached_property
    def _radii(self) -> tuple[np.ndarray, np.ndarray]:
        """Slopes of a pinhole, and the distances from the axis, mm, at which the lens images them."""
        radius = np.linspace(0, 1.05 * self.lens.prescription.image_radius, _NUM_RADII)
        points = np.stack([-radius, np.zeros(_NUM_RADII)], -1)
        aim = PrescriptionLens(
            prescription=self.lens.prescription,
            f_number=self.lens.f_number,
            focus_distance=self.lens.focus_distance,
            pupil_sampling="exit",
        )
        chief = aim.sample_rays(points, np.zeros_like(points))
        return chief.slope[:, 0] + chief.origin[:, 0] / self.lens.focus_distance, radius

    def coc_radius(self, disparity: Array) -> Array:
        """Return the paraxial signed blur radius on the pinhole's sensor, mm, for inverse depth in 1/mm."""
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
        scaling = np.interp(slope, slopes, radii) / np.maximum(slope * self.sensor_distance, 1e-9)
        rays = self.lens.sample_rays(sensor_xy * scaling.astype(sensor_xy.dtype), pupil_uv, wavelength)
        return Rays(origin=self.scale * rays.origin, slope=rays.slope, weight=rays.weight)


@lru_cache
def covered_slope(name: str) -> float:
    """Return the slope at the edge of the image circle of a catalog lens focused at infinity.

    Raises:
        LensError: There is no such lens.
    """
    lens = load_lens(name)
    return float(lens.prescription.image_radius / lens.focal_length)


def make_training_lens(
    name: str, pupil_radius: float, focus_distance: float, stops: float, sensor_distance: float
) -> TrainingLens:
    """Scale a catalog lens to a pupil radius.

    Args:
        name: Name in the catalog.
        pupil_radius: Radius of the entrance pupil, mm.
        focus_distance: Focus distance from the entrance pupil, mm; may be infinite.
        stops: Stops by which the iris is closed; 0 is fully open.
        sensor_distance: See :class:`TrainingLens`.

    Raises:
        LensError: There is no such lens, or it cannot focus at this distance.
    """
    design = load_lens(name)
    f_number = design.min_f_number * 2 ** (stops / 2)
    scale = pupil_radius / (design.focal_length / f_number / 2)
    if not math.isfinite(scale) or scale <= 0:
        raise LensError(f"{name}: pupil radius: expected more than 0 mm, got {pupil_radius:g} mm")
    lens = TransferLens(
        prescription=design.prescription, f_number=f_number, focus_distance=focus_distance / scale
    )
    return TrainingLens(lens=lens, scale=scale, sensor_distance=sensor_distance)
