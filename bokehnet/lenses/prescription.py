"""Lens made of real glass: every ray is refracted surface by surface."""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from bokehnet.checks import Array, array_namespace, number_of
from bokehnet.deprecation import earlier_name
from bokehnet.errors import LensError
from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription_file import Prescription
from bokehnet.lenses.pupils.effective_pupil import EffectivePupil, find_effective_pupil
from bokehnet.lenses.pupils.focus_shift import focus_shift
from bokehnet.lenses.pupils.paraxial_lens import ParaxialLens, paraxial_lens
from bokehnet.lenses.surface_trace import Beam, Surface, beam_between, trace
from bokehnet.lenses.thick import ThickLens
from bokehnet.optics.coc import coc_radius

__all__ = ["PrescriptionLens"]

# Field radius of the effective pupil over the design image radius, for sensors larger than the image circle.
_FIELD_RESERVE = 1.2
# Tolerance of f-numbers: engraved values are rounded, and one smaller by up to this factor is fully open.
_F_NUMBER_TOLERANCE = 1.02


@dataclass(frozen=True, kw_only=True)
class PrescriptionLens:
    """Prescription in use: focused by moving the whole lens, stopped down by its iris.

    The plane z = 0 of the scene is the paraxial entrance pupil at the design wavelength;
    it moves with the lens, and :attr:`front_vertex` is the distance from it to the front of the glass.

    Attributes:
        prescription: Surfaces; :meth:`Prescription.scaled` changes the focal length.
        f_number: Focal length over diameter of the entrance pupil; None is fully open.
        focus_distance: Depth z in focus, mm; may be infinite.
        focusing: "sharpest" places the sensor at the minimum root mean square blur of a point on the axis,
            for rays of the whole aperture at the current f-number and the design wavelength; "paraxial" at
            the Gaussian image. With spherical aberration the two differ, increasingly with larger apertures.
        pupil_sampling: "effective" maps the unit disc onto the region that light passes for each sensor
            point, "exit" onto the paraxial exit pupil, regardless of other rims.

    Raises:
        LensError: The lens cannot focus at this distance, or cannot open to this f-number.
    """

    prescription: Prescription
    f_number: float | None = None
    focus_distance: float = math.inf
    focusing: Literal["sharpest", "paraxial"] = "sharpest"
    pupil_sampling: Literal["effective", "exit"] = "effective"

    def __post_init__(self) -> None:
        name = self.prescription.name
        if not self.open_paraxial.cardinal.focal_length > 0:
            raise LensError(f"{name}: need a focal length above 0, got {self.focal_length:g} mm")
        f_number = number_of(self.f_number)
        if self.f_number is not None and not self.min_f_number <= _F_NUMBER_TOLERANCE * f_number < math.inf:
            raise LensError(
                f"{name}: f-number: expected {self.min_f_number:.3g} or more, got {self.f_number}",
                parameter="f_number",
            )
        try:
            _ = self.thick
        except LensError as error:
            raise LensError(f"{name}: {error}", error.parameter) from error
        if self.focus_distance <= self.front_vertex:
            raise LensError(
                f"{name}: cannot focus at {self.focus_distance:g} mm from its entrance pupil: "
                f"the front of the lens is {self.front_vertex:.4g} mm away",
                parameter="focus_distance",
            )

    @cached_property
    def open_paraxial(self) -> ParaxialLens:
        """Gaussian optics of the fully open lens at the design wavelength."""
        return paraxial_lens(self.prescription.trace_surfaces(self.prescription.design_wavelength))

    @property
    def focal_length(self) -> float:
        """Effective focal length, mm."""
        return float(self.open_paraxial.cardinal.focal_length)

    @property
    def min_f_number(self) -> float:
        """F-number of the fully open lens."""
        return float(self.focal_length / abs(self.open_paraxial.entrance.radius) / 2)

    @cached_property
    def working_f_number(self) -> float:
        """1 / (2 sin u') of the widest cone of real rays that reaches the centre of the sensor.

        It includes spherical aberration of the pupil, the other rims, and the extension of the lens;
        :attr:`ThickLens.f_number` ignores all of these. The lower bound in air is 0.5.
        """
        low, high = 0.0, 1.0
        for _ in range(4):
            sine = np.linspace(low, high, 257)[:-1]
            zeros = np.zeros_like(sine)
            direction = (sine, zeros, -np.sqrt(1 - sine * sine))
            start = (zeros, zeros, zeros + self.sensor_position)
            passes = trace(
                [replace(surface, inner_radius=0.0) for surface in self.centred.surfaces],
                Beam(position=start, direction=direction, fill=zeros, stop_fill=zeros),
                backwards=True,
            ).passes
            last = len(sine) - 1 if passes.all() else int(np.argmin(passes)) - 1
            if last < 0:
                raise LensError(f"{self.prescription.name}: no ray from the middle of the sensor passes")
            low, high = float(sine[last]), float(sine[last]) + (high - low) / 256
        return 1 / (low + high)

    @cached_property
    def stop_radius(self) -> float:
        """Radius of the iris, mm."""
        largest = next(row.semi_diameter for row in self.prescription.surfaces if row.stop)
        return largest if self.f_number is None else min(1.0, self.min_f_number / self.f_number) * largest

    @cached_property
    def surfaces(self) -> tuple[Surface, ...]:
        """Surfaces at the design wavelength, with the iris as set."""
        return self.prescription.trace_surfaces(self.prescription.design_wavelength, self.stop_radius)

    @cached_property
    def centred(self) -> "PrescriptionLens":
        """Lens with all surfaces centred on the axis; the lens itself if they are."""
        if self.prescription.centred:
            return self
        return replace(self, prescription=self.prescription.with_surfaces_centred())

    @cached_property
    def paraxial(self) -> ParaxialLens:
        """Gaussian optics at the design wavelength."""
        return paraxial_lens(self.surfaces)

    @cached_property
    def thick(self) -> ThickLens:
        """Ideal lens with the same focal length, focus and pupils."""
        cardinal, entrance = self.paraxial.cardinal, self.paraxial.entrance
        return ThickLens(
            focal_length=self.focal_length,
            f_number=self.focal_length / abs(entrance.radius) / 2,
            focus_distance=self.focus_distance,
            principal_depth=entrance.position - cardinal.front_principal,
            principal_gap=cardinal.rear_principal - cardinal.front_principal,
        )

    @property
    def front_vertex(self) -> float:
        """Depth z of the vertex of the first surface, mm."""
        return float(self.paraxial.entrance.position)

    @property
    def sensor_position(self) -> float:
        """Position ``t`` of the sensor, mm behind the first surface; it increases for near focus."""
        return self.gaussian_focus + self.focus_shift

    @property
    def gaussian_focus(self) -> float:
        """Position ``t`` of the Gaussian image of the focus distance, mm behind the first surface."""
        return float(self.paraxial.cardinal.rear_principal + self.thick.image_distance)

    @cached_property
    def focus_shift(self) -> float:
        """Distance of the sensor behind :attr:`gaussian_focus`, mm; below 0 for undercorrected lenses."""
        if self.focusing == "paraxial":
            return 0.0
        return focus_shift(
            self.centred.surfaces, self.paraxial.entrance, self.focus_distance, self.gaussian_focus
        )

    @property
    def sensor_distance(self) -> float:
        """Distance from lens to sensor of the thin lens with the same picture and blur, mm.

        As :attr:`ThickLens.sensor_distance`, at the actual position of the sensor.
        """
        thick = self.thick
        return thick.sensor_distance + self.focus_shift * (1 + thick.principal_depth / thick.focal_length)

    @cached_property
    def effective_pupil(self) -> EffectivePupil:
        """Effective pupil of each sensor point, computed on first use."""
        exit_pupil = self.paraxial.exit
        distance = self.sensor_position - exit_pupil.position
        radius = _FIELD_RESERVE * self.prescription.image_radius
        return find_effective_pupil(self.surfaces, exit_pupil, distance, radius)

    def coc_radius(self, disparity: Array) -> Array:
        """Return the paraxial signed blur radius on the sensor, mm; 0 in focus; disparity in 1/mm."""
        return coc_radius(disparity, 1 / self.focus_distance, self.thick.pupil_radius, self.sensor_distance)

    def image_of(self, points: Array) -> tuple[Array, Array]:
        """Return the Gaussian image of points (..., 3), mm: xy (..., 2), and mm behind the sensor (...,)."""
        xy, behind = self.thick.image_of(points)
        return xy, behind - self.focus_shift

    def sample_rays(
        self,
        sensor_xy: Array,
        pupil_uv: Array,
        wavelength: Array | None = None,
        sensor_offset: Array | None = None,
    ) -> Rays:
        """Return rays from sensor points through the pupil, as :class:`LensModel`, by tracing the glass.

        Weights are 1 for rays that pass and 0 for others, times the sampled area over that of the exit pupil,
        times cos^4 of the angle at the sensor; their mean over the disc is the irradiance relative to that of
        a small pupil on the axis. Only the cosine contributes to the gradient of weights; edges of the pupil
        do not.

        Source:
            Kolb, Mitchell and Hanrahan, "A realistic camera model for computer graphics", SIGGRAPH 1995.
        """
        beam, relative_area = self.aim(sensor_xy, pupil_uv, sensor_offset)
        weight = relative_area * beam.direction[2] ** 4
        beam = self.transfer(beam, wavelength)
        xp = array_namespace(weight)
        (x, y), (dx, dy, dt) = beam.at(self.paraxial.entrance.position), beam.direction
        return Rays(
            origin=xp.stack([x, y], -1),
            slope=xp.stack([-dx / dt, -dy / dt], -1),
            weight=weight * beam.passes,
        )

    def aim(
        self, sensor_xy: Array, pupil_uv: Array, sensor_offset: Array | None
    ) -> tuple[Beam, Array | float]:
        """Return rays from the sensor into the exit pupil, and the sampled area relative to its area."""
        exit_pupil = self.paraxial.exit
        place = self.sensor_position + (0.0 if sensor_offset is None else sensor_offset)
        upright = math.copysign(1.0, exit_pupil.radius * self.paraxial.entrance.radius)
        pupil_uv = upright * pupil_uv
        relative_area: Array | float = 1.0
        if self.pupil_sampling == "effective":
            x, y, area = self.effective_pupil.aim(sensor_xy, place - exit_pupil.position, pupil_uv)
            relative_area = area / exit_pupil.radius**2
        else:
            radius = abs(exit_pupil.radius)
            x, y = radius * pupil_uv[..., 0], radius * pupil_uv[..., 1]
        start = (sensor_xy[..., 0], sensor_xy[..., 1], place)
        return beam_between(start, (x, y, exit_pupil.position)), relative_area

    def transfer(self, beam: Beam, wavelength: Array | None = None) -> Beam:
        """Trace rays from the sensor through the lens."""
        return trace(self.surfaces_at(wavelength), beam, backwards=True)

    def surfaces_at(self, wavelength: Array | None) -> tuple[Surface, ...]:
        """Return the surfaces at a wavelength, nm, or at one per ray; None is the design wavelength."""
        if wavelength is None:
            return self.surfaces
        return self.prescription.trace_surfaces(wavelength, self.stop_radius)

    def trace_to_sensor(self, rays: Rays, wavelength: Array | None = None) -> tuple[Array, Array]:
        """Trace light from the scene through the lens to the sensor, opposite to :meth:`sample_rays`.

        Args:
            rays: Rays in front of the lens; their weights are ignored.
            wavelength: Wavelength, nm, a number or (...,); None is the design wavelength.

        Returns:
            Intersections with the sensor plane, mm, (..., 2), and True for rays that reach it, (...,).
        """
        pupil, start = self.paraxial.entrance.position, -self.focal_length
        place = rays.origin + (pupil - start) * rays.slope
        end = place - rays.slope
        beam = beam_between((place[..., 0], place[..., 1], start), (end[..., 0], end[..., 1], start + 1.0))
        beam = trace(self.surfaces_at(wavelength), beam)
        return array_namespace(place).stack(beam.at(self.sensor_position), -1), beam.passes

    fastest = earlier_name("PrescriptionLens", "fastest")
