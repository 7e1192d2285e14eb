"""Wavefront of a lens: optical path difference to a reference sphere about the image of the chief ray.

Optical path lengths from the point in focus to the sphere through the centre of the
exit pupil. The lens has focus and iris as set.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.lenses.surface_trace import beam_between, trace
from bokehnet.optics.aberrations.zernike import zernike

__all__ = ["Wavefront", "trace_wavefront", "wave_mtf", "wave_psf", "zernike_fit"]

# Half-side of the grid, radii of the entrance pupil; real pupils are wider than paraxial ones.
_HALF_WIDTH = 1.25
_NEWTON_ITERATIONS = 3

# Iterations with the slope of the whole pupil, which is steeper or flatter at its edge, and the largest
# accepted difference of a direction cosine.
_PUPIL_ITERATIONS = 8
_COSINE_TOLERANCE = 1e-4


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Wavefront:
    """Wavefront of one point of the field on a grid over the entrance pupil.

    Attributes:
        pupil: Intersections of rays with the entrance pupil relative to the chief ray, pupil radii, (N, N,
            2); x is along the field, in picture orientation.
        waves: Advance of the light relative to the sphere, wavelengths, (N, N).
        passes: True for unobstructed rays, (N, N).
        cosines: Direction cosines of rays along the two lateral axes at the sensor, (N, N, 2).
        wavelength: Wavelength, nm.
    """

    pupil: np.ndarray
    waves: np.ndarray
    passes: np.ndarray
    cosines: np.ndarray
    wavelength: float

    @property
    def rms(self) -> float:
        """Root mean square deviation over the passing rays, wavelengths, without mean and tilt."""
        points = self.pupil[self.passes]
        basis = np.concatenate([np.ones((len(points), 1)), points], -1)
        waves = self.waves[self.passes]
        residual = waves - basis @ np.linalg.lstsq(basis, waves, rcond=None)[0]
        return float(np.sqrt(np.mean(residual**2)))


def trace_wavefront(
    lens: PrescriptionLens, field: float, wavelength: float | None = None, count: int = 129
) -> Wavefront:
    """Return the traced wavefront of the point whose chief ray meets the sensor at ``field``.

    Args:
        lens: Lens to trace.
        field: Relative image height, a fraction of the image radius.
        wavelength: Wavelength, nm; None is the design wavelength, which chief ray and sphere always use.
        count: Number of rays along each side of the grid.

    Raises:
        LensError: The chief ray does not reach this image height.

    Source:
        Welford, "Aberrations of optical systems", 1986, 7.2.
    """
    middle = chief_rays(lens, np.array([field * lens.prescription.image_radius, 0.0]))
    steps = np.linspace(-_HALF_WIDTH, _HALF_WIDTH, count)
    pupil = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1)
    chief = np.zeros((1, 2))
    reference = _paths(lens, middle.origin, middle.slope, chief, None, None)
    sensor = reference[1]
    chief_path = _paths(lens, middle.origin, middle.slope, chief, wavelength, sensor)[0]
    path, _, cosines, passes = _paths(lens, middle.origin, middle.slope, pupil, wavelength, sensor)
    if not (np.isfinite(chief_path).all() and np.isfinite(path[passes]).all()):
        name = lens.prescription.name
        raise LensError(f"{name}: no ray through the middle of the stop reaches {field:g} of its picture")
    length = lens.prescription.design_wavelength if wavelength is None else wavelength
    return Wavefront(
        pupil=pupil,
        waves=(chief_path - path) / (1e-6 * length),
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
    """Return path lengths to the sphere, mm, the first position on the sensor, cosines, and passing rays.

    Rays start at the point in focus whose chief ray has the given origin and slope in the entrance pupil.

    Args:
        lens: Lens to trace.
        origin: Intersection of the chief ray with the entrance pupil, mm.
        slope: Slope of the chief ray.
        pupil: Points of the entrance pupil relative to the chief ray, pupil radii, (..., 2).
        wavelength: Wavelength, nm; None is the design wavelength.
        centre: Centre of the sphere on the sensor, mm; None is the position of the first ray.
    """
    entrance = lens.paraxial.entrance
    own_origin = origin - abs(entrance.radius) * pupil
    own_slope = slope - (own_origin - origin) / lens.focus_distance
    first = min(0.0, entrance.position) - 1.0
    far, near = (own_origin + (entrance.position - t) * own_slope for t in (first - 1.0, first))
    beam = beam_between((far[..., 0], far[..., 1], first - 1.0), (near[..., 0], near[..., 1], first))
    if np.isinf(lens.focus_distance):  # a plane wave, from a plane through the centre of the pupil
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
        intersection = (x, y, 2 * surface.vertex - t if surface.mirror else t)
        lengths = ((b - a) * d for a, b, d in zip(beam.position, intersection, beam.direction, strict=True))
        path = path + surface.before * sum(lengths)
        beam = passed
    place = np.stack(beam.at(lens.sensor_position), -1)
    if centre is None:
        centre = place.reshape(-1, 2)[0]
    exit_position = lens.paraxial.exit.position
    to_sensor = lens.sensor_position - exit_position
    square = float(centre @ centre) + to_sensor**2
    to_centre = (
        centre[0] - beam.position[0],
        centre[1] - beam.position[1],
        lens.sensor_position - beam.position[2],
    )
    along = sum(a * d for a, d in zip(to_centre, beam.direction, strict=True))
    inside = along**2 - sum(a * a for a in to_centre) + square
    path = path + along - np.sign(to_sensor) * np.sqrt(np.maximum(inside, 0))
    cosines = -np.stack(beam.direction[:2], -1)
    return path, place.reshape(-1, 2)[0], cosines, np.asarray(beam.passes & (inside > 0))


def _direction(slope: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the unit vector x, y, t of a ray towards the sensor, for a slope in the scene."""
    length = np.sqrt(1 + (slope**2).sum(-1))
    return -slope[..., 0] / length, -slope[..., 1] / length, 1 / length


def zernike_fit(front: Wavefront, count: int = 22) -> np.ndarray:
    """Return the coefficients of the wavefront by :func:`zernike`, wavelengths, (count,).

    Least squares over the rays that pass, on the disc of the paraxial entrance pupil about the chief ray.
    If rims leave only a part of the disc, these are the smallest coefficients that fit that part.
    """
    inside = front.passes & ((front.pupil**2).sum(-1) <= 1)
    basis = zernike(count, front.pupil[inside]).T
    return np.asarray(np.linalg.lstsq(basis, front.waves[inside], rcond=1e-6)[0])


def wave_mtf(front: Wavefront, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the diffraction MTF (F,) of lines across the field (tangential) and along it (sagittal).

    Args:
        front: Wavefront.
        frequencies: Spatial frequencies, line pairs per mm, (F,).

    Source:
        Hopkins, "The frequency response of a defocused optical system", 1955: the pupil function over itself,
        shifted by wavelength times frequency in cosines of the directions at the sensor.
    """
    fields, step = _fields(front)
    # Rows d(cosines)/d(pupil): (N, N, cosine, axis).
    slopes = np.stack(np.gradient(front.cosines, step, axis=(0, 1)), -1)
    area = np.abs(np.linalg.det(slopes))
    inverse = np.linalg.pinv(slopes)
    weight = front.passes * area
    curves = []
    for axis in (0, 1):
        curve = []
        for frequency in frequencies:
            shift = np.zeros(2)
            shift[axis] = 1e-6 * front.wavelength * frequency
            target = front.cosines + shift
            values = _at_cosines(fields, step, target, front.pupil, inverse, _NEWTON_ITERATIONS)
            both = weight * (values[..., 3] > 0.5)
            phase = 2 * np.pi * (values[..., 2] - front.waves)
            curve.append(abs((both * np.exp(1j * phase)).sum()) / weight.sum())
        curves.append(np.array(curve))
    return curves[0], curves[1]


def wave_psf(
    front: Wavefront,
    offsets: np.ndarray,
    defocus: float = 0.0,
    count: int = 512,
    apodisation: float = 0.0,
) -> np.ndarray:
    """Return the diffraction PSF on a square of the sensor, its sum 1.

    Args:
        front: Wavefront.
        offsets: Distances from the image of the chief ray along both axes, mm, (M,); right and down.
        defocus: Distance of the image surface behind the sensor, mm.
        count: Number of direction cosines along each axis. The wavelength, mm, over their spacing is the
            period of the result, which must be wider than PSF and offsets.
        apodisation: Factor a of a Gaussian pupil, whose amplitude is exp(-a rho^2) at rho pupil radii from
            the chief ray, as behind a smooth filter; 0 is a clear pupil.

    Returns:
        PSF (M, M); the first axis is along the field.

    Source:
        Goodman, "Introduction to Fourier optics", 3rd edition 2005, 3.10 and 6.1: plane waves with the
        directions of the rays, of equal amplitude per direction cosine, as in :func:`wave_mtf`.
    """
    passing = front.cosines[front.passes]
    low, high = passing.min(0), passing.max(0)
    axes = [np.linspace(a, b, count) for a, b in zip(low, high, strict=True)]
    target = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    columns = np.concatenate([passing, np.ones((len(passing), 1))], -1)
    affine = np.linalg.lstsq(columns, front.pupil[front.passes], rcond=None)[0]
    fields, step = _fields(front)
    fields = np.concatenate([fields, front.pupil], -1)
    start = target @ affine[:2] + affine[2]
    values = _at_cosines(fields, step, target, start, affine[:2].T, _PUPIL_ITERATIONS)
    reached = np.abs(target - values[..., :2]).max(-1) < _COSINE_TOLERANCE
    amplitude = reached & (values[..., 3] > 0.5)
    amplitude = amplitude * np.exp(-apodisation * (values[..., 4:] ** 2).sum(-1))
    length = 1e-6 * front.wavelength
    along_axis = np.sqrt(np.maximum(1 - (target**2).sum(-1), 0))
    pupil_function = amplitude * np.exp(2j * np.pi * (values[..., 2] - defocus * along_axis / length))
    first, second = (np.exp(2j * np.pi * np.outer(offsets, axis) / length) for axis in axes)
    intensity = np.abs(first @ pupil_function @ second.T) ** 2
    return np.asarray(intensity / intensity.sum())


def _fields(front: Wavefront) -> tuple[np.ndarray, float]:
    """Return cosines, waves and passing rays as channels (N, N, 4), and the step of the pupil."""
    step = float(front.pupil[1, 0, 0] - front.pupil[0, 0, 0])
    fields = np.concatenate(
        [front.cosines, front.waves[..., None], front.passes[..., None].astype(float)], -1
    )
    fields[~np.isfinite(fields)] = 0.0
    return fields, step


def _at_cosines(
    fields: np.ndarray,
    step: float,
    target: np.ndarray,
    pupil: np.ndarray,
    inverse: np.ndarray,
    iterations: int,
) -> np.ndarray:
    """Return channels (..., 4) of the rays with given direction cosines, by Newton's method in the pupil."""
    for _ in range(iterations):
        residual = target - _between(fields[..., :2], pupil, step)
        pupil = pupil + np.einsum("...ij,...j->...i", inverse, residual)
    return _between(fields, pupil, step)


def _between(values: np.ndarray, pupil: np.ndarray, step: float) -> np.ndarray:
    """Return values (N, N, C) at points of the pupil (N, N, 2), interpolated; constant beyond the edge."""
    last = len(values) - 1
    place = np.clip((pupil + _HALF_WIDTH) / step, 0, last - 1e-9)
    low = place.astype(int)
    fraction = (place - low)[..., None]
    (i, j), (s, t) = np.moveaxis(low, -1, 0), np.moveaxis(fraction, -2, 0)
    upper = values[i, j] * (1 - t) + values[i, j + 1] * t
    lower = values[i + 1, j] * (1 - t) + values[i + 1, j + 1] * t
    return np.asarray(upper * (1 - s) + lower * s)
