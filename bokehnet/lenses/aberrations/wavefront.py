"""The wave-front of a lens: how far light is ahead of a sphere about the place of the middle ray.

Lengths of rays, times the index, from the point in focus to the sphere that runs through the middle of the
exit pupil. Of the lens as it is focused and stopped down.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.lenses.surface_trace import beam_between, trace
from bokehnet.optics.aberrations.zernike import zernike

__all__ = ["Wavefront", "trace_wavefront", "wave_mtf", "zernike_fit"]

# Half the side of the grid, radii of the entrance pupil; real pupils are wider than Gaussian optics has them.
_WIDEST = 1.25
_NEWTON_STEPS = 3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Wavefront:
    """The wave-front of one point of the field on a grid over the entrance pupil.

    Attributes:
        pupil: Where rays cross the entrance pupil, from where the middle ray does, in its radii, (N, N, 2);
            x is along the field, as the picture has it.
        waves: How far light is ahead of the sphere, wavelengths, (N, N).
        passes: Which rays nothing stops, (N, N).
        cosines: Cosines between rays and the two axes across the lens at the sensor, (N, N, 2).
        wavelength: Nanometres.
    """

    pupil: np.ndarray
    waves: np.ndarray
    passes: np.ndarray
    cosines: np.ndarray
    wavelength: float

    @property
    def rms(self) -> float:
        """Deviation of the wave-front over what passes, wavelengths, its mean and tilt left out."""
        points = self.pupil[self.passes]
        basis = np.concatenate([np.ones((len(points), 1)), points], -1)
        waves = self.waves[self.passes]
        left = waves - basis @ np.linalg.lstsq(basis, waves, rcond=None)[0]
        return float(np.sqrt(np.mean(left**2)))


def trace_wavefront(
    lens: PrescriptionLens, share: float, wavelength: float | None = None, count: int = 129
) -> Wavefront:
    """Trace the wave-front of the point whose middle ray meets the sensor at a share of the picture's radius.

    Args:
        lens: The lens.
        share: Of the radius.
        wavelength: Nanometres; None is the design wavelength, as middle ray and sphere are always.
        count: Rays along each side of the grid.

    Raises:
        LensError: The middle ray does not get there.

    Source:
        Welford, "Aberrations of optical systems", 1986, 7.2.
    """
    middle = chief_rays(lens, np.array([share * lens.prescription.image_radius, 0.0]))
    steps = np.linspace(-_WIDEST, _WIDEST, count)
    pupil = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1)
    chief = np.zeros((1, 2))
    reference = _paths(lens, middle.origin, middle.slope, chief, None, None)
    sensor = reference[1]
    used = _paths(lens, middle.origin, middle.slope, chief, wavelength, sensor)[0]
    path, _, cosines, passes = _paths(lens, middle.origin, middle.slope, pupil, wavelength, sensor)
    if not (np.isfinite(used).all() and np.isfinite(path[passes]).all()):
        name = lens.prescription.name
        raise LensError(f"{name}: no ray through the middle of the stop reaches {share:g} of its picture")
    length = lens.prescription.design_wavelength if wavelength is None else wavelength
    return Wavefront(
        pupil=pupil,
        waves=(used - path) / (1e-6 * length),
        passes=passes,
        cosines=cosines,
        wavelength=length,
    )


def _paths(
    lens: PrescriptionLens,
    origin: np.ndarray,
    slope: np.ndarray,
    pupil: np.ndarray,
    wavelength: float | None,
    centre: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lengths times index to the sphere about ``centre``, mm; place on the sensor, cosines, which pass.

    Rays of the point in focus whose middle ray is given by origin and slope in the entrance pupil. Without a
    centre the sphere is that of the first ray itself.
    """
    entrance = lens.paraxial.entrance
    own_origin = origin - abs(entrance.radius) * pupil
    own_slope = slope - (own_origin - origin) / lens.focus_distance
    first = min(0.0, entrance.position) - 1.0
    far, near = (own_origin + (entrance.position - t) * own_slope for t in (first - 1.0, first))
    beam = beam_between((far[..., 0], far[..., 1], first - 1.0), (near[..., 0], near[..., 1], first))
    if np.isinf(lens.focus_distance):  # a plane wave, from a plane through the middle of the pupil
        dx, dy, dt = (float(part.flat[0]) for part in _direction(slope))
        x, y, t = beam.position
        path = dx * (x - origin[0]) + dy * (y - origin[1]) + dt * (t - entrance.position)
    else:
        point = origin + lens.focus_distance * slope
        x, y, t = beam.position
        depth = t - (entrance.position - lens.focus_distance)
        path = np.sqrt((x - point[0]) ** 2 + (y - point[1]) ** 2 + depth**2)
    for surface in lens.surfaces_at(wavelength):
        passed = trace([surface], beam)
        x, y, t = passed.position
        met = (x, y, 2 * surface.vertex - t if surface.mirror else t)
        travel = ((b - a) * d for a, b, d in zip(beam.position, met, beam.direction, strict=True))
        path = path + surface.before * sum(travel)
        beam = passed
    place = np.stack(beam.at(lens.sensor_position), -1)
    if centre is None:
        centre = place.reshape(-1, 2)[0]
    exit_position = lens.paraxial.exit.position
    to_sensor = lens.sensor_position - exit_position
    square = float(centre @ centre) + to_sensor**2
    away = (
        centre[0] - beam.position[0],
        centre[1] - beam.position[1],
        lens.sensor_position - beam.position[2],
    )
    along = sum(a * d for a, d in zip(away, beam.direction, strict=True))
    inside = along**2 - sum(a * a for a in away) + square
    path = path + along - np.sign(to_sensor) * np.sqrt(np.maximum(inside, 0))
    cosines = -np.stack(beam.direction[:2], -1)
    return path, place.reshape(-1, 2)[0], cosines, np.asarray(beam.passes & (inside > 0))


def _direction(slope: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vector x, y, t of a ray towards the sensor with a lateral travel per depth."""
    length = np.sqrt(1 + (slope**2).sum(-1))
    return -slope[..., 0] / length, -slope[..., 1] / length, 1 / length


def zernike_fit(front: Wavefront, count: int = 22) -> np.ndarray:
    """Return the coefficients of the wave-front by :func:`zernike`, wavelengths, (count,).

    Least squares over the rays that pass, on the disc of the Gaussian entrance pupil about the middle ray.
    Where rims leave a part of the disc only, these are the smallest coefficients that fit that part.
    """
    inside = front.passes & ((front.pupil**2).sum(-1) <= 1)
    basis = zernike(count, front.pupil[inside]).T
    return np.asarray(np.linalg.lstsq(basis, front.waves[inside], rcond=1e-6)[0])


def wave_mtf(front: Wavefront, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the contrast (F,) of lines across the field (tangential) and along it (sagittal), by waves.

    Args:
        front: The wave-front.
        frequencies: Line pairs per mm, (F,).

    Source:
        Hopkins, "The frequency response of a defocused optical system", 1955: the pupil function over itself,
        shifted by wavelength times frequency in cosines of the directions at the sensor.
    """
    step = float(front.pupil[1, 0, 0] - front.pupil[0, 0, 0])
    fields = np.concatenate(
        [front.cosines, front.waves[..., None], front.passes[..., None].astype(float)], -1
    )
    fields[~np.isfinite(fields)] = 0.0
    # Rows d(cosines)/d(pupil): (N, N, cosine, axis).
    slopes = np.stack(np.gradient(front.cosines, step, axis=(0, 1)), -1)
    area = np.abs(np.linalg.det(slopes))
    inverse = np.linalg.pinv(slopes)
    weight = front.passes * area
    found = []
    for axis in (0, 1):
        curve = []
        for frequency in frequencies:
            shift = np.zeros(2)
            shift[axis] = 1e-6 * front.wavelength * frequency
            wanted = front.cosines + shift
            there = front.pupil
            for _ in range(_NEWTON_STEPS):
                left = wanted - _between(fields[..., :2], there, step)
                there = there + np.einsum("...ij,...j->...i", inverse, left)
            values = _between(fields, there, step)
            both = weight * (values[..., 3] > 0.5)
            phase = 2 * np.pi * (values[..., 2] - front.waves)
            curve.append(abs((both * np.exp(1j * phase)).sum()) / weight.sum())
        found.append(np.array(curve))
    return found[0], found[1]


def _between(values: np.ndarray, pupil: np.ndarray, step: float) -> np.ndarray:
    """Values (N, N, C) at places of the pupil (N, N, 2), linear in between; as at the edge beyond it."""
    last = len(values) - 1
    place = np.clip((pupil + _WIDEST) / step, 0, last - 1e-9)
    low = place.astype(int)
    share = (place - low)[..., None]
    (i, j), (s, t) = np.moveaxis(low, -1, 0), np.moveaxis(share, -2, 0)
    upper = values[i, j] * (1 - t) + values[i, j + 1] * t
    lower = values[i + 1, j] * (1 - t) + values[i + 1, j + 1] * t
    return np.asarray(upper * (1 - s) + lower * s)
