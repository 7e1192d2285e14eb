"""Performance curves of a lens: ray fans, MTF, and focus over zones, wavelengths and the field.

The lens has focus and iris as set; lengths are in mm. Fields are fractions of the image radius.
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

# Half-width of sampled pupils, pupil radii; real pupils are wider than paraxial ones, and rims clip the rest.
_HALF_WIDTH = 1.5
# Distance of neighbouring rays from the chief ray, pupil radii.
_PARAXIAL_ZONE = 0.02


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FieldRays:
    """Rays of one point in focus, on the sensor.

    Attributes:
        pupil: Intersections with the entrance pupil relative to the chief ray, pupil radii, (N, 2); x is
            along the field.
        place: Intersections with the sensor relative to the chief ray, mm, (N, 2), x away from the axis.
        slope: Lateral displacement per mm towards the sensor, less that of the chief ray, (N, 2).
        passes: True for unobstructed rays, (N,).
    """

    pupil: np.ndarray
    place: np.ndarray
    slope: np.ndarray
    passes: np.ndarray


def field_rays(
    lens: PrescriptionLens, field: float, pupil: np.ndarray, wavelength: float | None = None
) -> FieldRays:
    """Trace rays of the point whose chief ray meets the sensor at the relative image height ``field``.

    Args:
        lens: Lens to trace.
        field: Fraction of the image radius.
        pupil: Points of the entrance pupil, as in :class:`FieldRays`.
        wavelength: Wavelength, nm; None is the design wavelength, which the chief ray always has.
    """
    middle = chief_rays(lens, np.array([field * lens.prescription.image_radius, 0.0]))
    origin = middle.origin - abs(lens.paraxial.entrance.radius) * pupil
    # All rays pass the point in focus; picture coordinates are turned relative to those of the sensor.
    slope = middle.slope - (origin - middle.origin) / lens.focus_distance
    place, sensor_slope, passes = _arrive(lens, origin, slope, wavelength)
    reference, chief_slope, _ = _arrive(lens, middle.origin, middle.slope, None)
    return FieldRays(pupil=pupil, place=place - reference, slope=sensor_slope - chief_slope, passes=passes)


def _arrive(
    lens: PrescriptionLens, origin: np.ndarray, slope: np.ndarray, wavelength: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position on the sensor and slope of rays, in picture orientation, and True for passing rays."""
    pupil = lens.paraxial.entrance.position
    first = min(0.0, pupil) - 1.0  # in front of the glass
    far, near = (origin + (pupil - t) * slope for t in (first - 1.0, first))
    start, end = ((at[..., 0], at[..., 1], t) for at, t in ((far, first - 1.0), (near, first)))
    beam = trace(lens.surfaces_at(wavelength), beam_between(start, end))
    dx, dy, dt = beam.direction
    place = -np.stack(beam.at(lens.sensor_position), -1)
    return place, -np.stack([dx / dt, dy / dt], -1), beam.passes


def ray_fan(
    lens: PrescriptionLens, field: float, wavelength: float | None = None, count: int = 61
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pupil positions (count,), and transverse aberrations along the field and across it, mm.

    The first is that of the tangential fan along the field, the second that of the sagittal fan
    across it; NaN for clipped rays.
    """
    steps = np.linspace(-_HALF_WIDTH, _HALF_WIDTH, count)
    fans = []
    for axis in (0, 1):
        pupil = np.zeros((count, 2))
        pupil[:, axis] = steps
        rays = field_rays(lens, field, pupil, wavelength)
        fans.append(np.where(rays.passes, rays.place[:, axis], np.nan))
    return steps, fans[0], fans[1]


def geometric_mtf(
    lens: PrescriptionLens, field: float, frequencies: np.ndarray, wavelength: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the geometric MTF (F,) of lines across the field (tangential) and along it (sagittal).

    Args:
        lens: Lens to trace.
        field: Fraction of the image radius.
        frequencies: Spatial frequencies, line pairs per mm, (F,).
        wavelength: Wavelength, nm; None is the design wavelength.
    """
    pupil = _HALF_WIDTH * disc_from_square(np.stack([halton(6000, 2), halton(6000, 3)], -1))
    rays = field_rays(lens, field, pupil, wavelength)
    place = rays.place[rays.passes]
    waves = np.exp(2j * np.pi * frequencies[:, None, None] * place)
    tangential, sagittal = np.abs(waves.mean(1)).T
    return tangential, sagittal


def spherical_focus(lens: PrescriptionLens, zones: np.ndarray, wavelength: float | None = None) -> np.ndarray:
    """Return the axis crossings of rays through zones of the entrance pupil, fractions of its radius (Z,).

    In mm behind the Gaussian focus of the design wavelength; NaN for clipped rays.
    """
    crossing, passes = _crossing(lens, zones, wavelength)
    return np.where(passes, crossing, np.nan)


def _crossing(
    lens: PrescriptionLens, zones: np.ndarray, wavelength: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the axis crossings of rays, as :func:`spherical_focus`, and True for unobstructed rays."""
    rays = field_rays(lens, 0.0, np.stack([zones, 0 * zones], -1), wavelength)
    return -rays.place[:, 0] / rays.slope[:, 0] + lens.focus_shift, rays.passes


def chromatic_focus(lens: PrescriptionLens, wavelengths: np.ndarray) -> np.ndarray:
    """Return the paraxial focus of wavelengths, mm behind that of the design wavelength, (W,).

    Ignores central obstructions, which do not change the focus.
    """
    zone = np.array([_PARAXIAL_ZONE])
    focus = np.array([_crossing(lens, zone, float(wavelength))[0][0] for wavelength in wavelengths])
    return np.asarray(focus - _crossing(lens, zone)[0][0])


def field_curvature(lens: PrescriptionLens, fields: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the tangential and the sagittal focus near the chief ray, mm behind that on the axis, (S,).

    Ignores central obstructions.
    """
    foci = []
    for field in fields:
        pair = []
        for axis in (0, 1):
            pupil = np.zeros((2, 2))
            pupil[:, axis] = (-_PARAXIAL_ZONE, _PARAXIAL_ZONE)
            rays = field_rays(lens, float(field), pupil)
            place, slope = np.diff(rays.place[:, axis])[0], np.diff(rays.slope[:, axis])[0]
            pair.append(-place / slope)
        foci.append(pair)
    axis_focus = float(_crossing(lens, np.array([_PARAXIAL_ZONE]))[0][0]) - lens.focus_shift
    tangential, sagittal = (np.array(foci) - axis_focus).T
    return tangential, sagittal


def airy_mtf(lens: PrescriptionLens, frequencies: np.ndarray, wavelength: float = D_LINE) -> np.ndarray:
    """Return the diffraction-limited MTF of an ideal lens of this working f-number, (F,).

    Source:
        Goodman, "Introduction to Fourier optics", 2005, 6.4.
    """
    cut = 1e6 / (wavelength * lens.working_f_number)
    relative = np.clip(frequencies / cut, 0, 1)
    return np.asarray(2 / np.pi * (np.arccos(relative) - relative * np.sqrt(1 - relative * relative)))
