"""Curves that tell a lens: ray fans, MTF, focus over zones, wavelengths and the field.

All for the lens as it is focused and stopped down, lengths in mm. Points of the field are at shares of the
radius of its picture.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.lenses.surface_trace import beam_between, trace
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.spectral.glass import D_LINE

__all__ = [
    "FieldRays",
    "airy_mtf",
    "chromatic_focus",
    "field_curvature",
    "field_rays",
    "geometric_mtf",
    "ray_fan",
    "spherical_focus",
]

# Real pupils are wider than Gaussian optics has them; rays beyond the rim do not pass.
_WIDEST = 1.5
# How near to the middle ray its neighbours pass, in radii of the pupil.
_NEAR = 0.02


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FieldRays:
    """Rays of one point in focus, on the sensor.

    Attributes:
        pupil: Where they cross the entrance pupil, from where the middle ray does, in its radii, (N, 2); x is
            along the field.
        place: Where they meet the sensor, from where the middle ray does, mm, (N, 2), away from the axis.
        slope: Lateral travel per mm towards the sensor, less that of the middle ray, (N, 2).
        passes: Which nothing stops, (N,).
    """

    pupil: np.ndarray
    place: np.ndarray
    slope: np.ndarray
    passes: np.ndarray


def field_rays(
    lens: PrescriptionLens, share: float, pupil: np.ndarray, wavelength: float | None = None
) -> FieldRays:
    """Trace rays of the point whose middle ray meets the sensor at a share of the picture's radius.

    Args:
        lens: The lens.
        share: Of the radius.
        pupil: As in :class:`FieldRays`.
        wavelength: Nanometres; None is the design wavelength, which the middle ray has always.
    """
    middle = chief_rays(lens, np.array([share * lens.prescription.image_radius, 0.0]))
    origin = middle.origin - abs(lens.paraxial.entrance.radius) * pupil
    # All run through the point in focus; picture coordinates are turned against those of the sensor.
    slope = middle.slope - (origin - middle.origin) / lens.focus_distance
    place, travel, passes = _arrive(lens, origin, slope, wavelength)
    reference, straight, _ = _arrive(lens, middle.origin, middle.slope, None)
    return FieldRays(pupil=pupil, place=place - reference, slope=travel - straight, passes=passes)


def _arrive(
    lens: PrescriptionLens, origin: np.ndarray, slope: np.ndarray, wavelength: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Place on the sensor and slope of rays, as the picture has them, and which pass."""
    pupil = lens.paraxial.entrance.position
    first = min(0.0, pupil) - 1.0  # in front of the glass
    far, near = (origin + (pupil - t) * slope for t in (first - 1.0, first))
    start, end = ((at[..., 0], at[..., 1], t) for at, t in ((far, first - 1.0), (near, first)))
    beam = trace(lens.surfaces_at(wavelength), beam_between(start, end))
    dx, dy, dt = beam.direction
    place = -np.stack(beam.at(lens.sensor_position), -1)
    return place, -np.stack([dx / dt, dy / dt], -1), beam.passes


def ray_fan(
    lens: PrescriptionLens, share: float, wavelength: float | None = None, count: int = 61
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places in the pupil (count,), and how far rays miss along the field and across it, mm.

    Of rays in the plane of the field (tangential fan, its miss along the field) and across it (sagittal fan,
    its miss across); NaN where nothing passes.
    """
    steps = np.linspace(-_WIDEST, _WIDEST, count)
    found = []
    for axis in (0, 1):
        pupil = np.zeros((count, 2))
        pupil[:, axis] = steps
        rays = field_rays(lens, share, pupil, wavelength)
        found.append(np.where(rays.passes, rays.place[:, axis], np.nan))
    return steps, found[0], found[1]


def geometric_mtf(
    lens: PrescriptionLens, share: float, frequencies: np.ndarray, wavelength: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return contrast (F,) of lines across the field (tangential) and along it (sagittal), by rays alone.

    Args:
        lens: The lens.
        share: Of the picture's radius.
        frequencies: Line pairs per mm, (F,).
        wavelength: Nanometres; None is the design wavelength.
    """
    pupil = _WIDEST * disc_from_square(np.stack([halton(6000, 2), halton(6000, 3)], -1))
    rays = field_rays(lens, share, pupil, wavelength)
    place = rays.place[rays.passes]
    waves = np.exp(2j * np.pi * frequencies[:, None, None] * place)
    tangential, sagittal = np.abs(waves.mean(1)).T
    return tangential, sagittal


def spherical_focus(lens: PrescriptionLens, zones: np.ndarray, wavelength: float | None = None) -> np.ndarray:
    """Return where rays through zones of the entrance pupil, shares of its radius (Z,), cross the axis.

    Millimetres behind the Gaussian focus of the design wavelength; NaN where nothing passes.
    """
    crossing, passes = _crossing(lens, zones, wavelength)
    return np.where(passes, crossing, np.nan)


def _crossing(
    lens: PrescriptionLens, zones: np.ndarray, wavelength: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays cross the axis, as :func:`spherical_focus` has it, and which nothing stops."""
    rays = field_rays(lens, 0.0, np.stack([zones, 0 * zones], -1), wavelength)
    return -rays.place[:, 0] / rays.slope[:, 0] + lens.focus_shift, rays.passes


def chromatic_focus(lens: PrescriptionLens, wavelengths: np.ndarray) -> np.ndarray:
    """Return the focus of rays near the axis, mm behind that of the design wavelength, (W,).

    A dark middle, such as a mirror's hole, is looked through: it changes no focus.
    """
    zone = np.array([_NEAR])
    found = np.array([_crossing(lens, zone, float(wavelength))[0][0] for wavelength in wavelengths])
    return np.asarray(found - _crossing(lens, zone)[0][0])


def field_curvature(lens: PrescriptionLens, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the tangential and the sagittal focus near the middle ray, mm behind that on the axis, (S,).

    Of rays near it whether or not a dark middle stops them.
    """
    found = []
    for share in shares:
        pair = []
        for axis in (0, 1):
            pupil = np.zeros((2, 2))
            pupil[:, axis] = (-_NEAR, _NEAR)
            rays = field_rays(lens, float(share), pupil)
            place, slope = np.diff(rays.place[:, axis])[0], np.diff(rays.slope[:, axis])[0]
            pair.append(-place / slope)
        found.append(pair)
    axis_focus = float(_crossing(lens, np.array([_NEAR]))[0][0]) - lens.focus_shift
    tangential, sagittal = (np.array(found) - axis_focus).T
    return tangential, sagittal


def airy_mtf(lens: PrescriptionLens, frequencies: np.ndarray, wavelength: float = D_LINE) -> np.ndarray:
    """Return the contrast that diffraction leaves of a perfect lens of this working f-number, (F,).

    Source:
        Goodman, "Introduction to Fourier optics", 2005, 6.4.
    """
    cut = 1e6 / (wavelength * lens.working_f_number)
    share = np.clip(frequencies / cut, 0, 1)
    return np.asarray(2 / np.pi * (np.arccos(share) - share * np.sqrt(1 - share * share)))
