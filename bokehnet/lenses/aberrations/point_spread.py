"""Point-spread functions: traced through the glass, and of the aberration map that stands for it.

Both are pictures of one point of the scene, around the place where the lens stopped far down shows it.
"""

from collections.abc import Callable

import numpy as np

from bokehnet.checks import check_above, check_at_least, check_number
from bokehnet.errors import LensError, ShapeError
from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["aberration_psf", "correlation", "psf_reach", "traced_psf"]

# Half-side of the square in the entrance pupil that is searched for light, in its radii, and rays along it.
_SEARCH, _COARSE = 3.0, 96
# Rounds of the search for where light arrives; each leaves the gradient of the transverse aberration, a few
# per cent.
_ROUNDS = 5
# How near to the middle of the stop its ray passes, in radii, and heights of rays that found no surface.
_CENTRED, _LOST = 1e-3, 1e5
# Steps of the gradients of pencils, in half-diagonals.
_STEP = 1e-4


def traced_psf(
    lens: PrescriptionLens,
    *,
    depth: float,
    field: tuple[float, float],
    wavelengths: np.ndarray,
    colors: np.ndarray,
    pitch: float,
    size: int,
    half_diagonal: float | None = None,
    rays: int = 40_000,
) -> np.ndarray:
    """Send light of a point through the lens and collect it on the sensor.

    Args:
        lens: The lens.
        depth: Of the point, mm from the entrance pupil.
        field: Its place h in the picture of the lens stopped far down, corner at 1, right and down.
        wavelengths: Nanometres, (L,).
        colors: What each carries of the channels, (L, C).
        pitch: Distance between two cells, mm.
        size: Cells along each side; the place of the point is the middle.
        half_diagonal: Of the picture, mm; None is the radius that the lens is made for.
        rays: Of each wavelength; not all of them pass.

    Returns:
        Light in each cell, (size, size, C); all channels together sum to ``C``, but for what falls outside.

    Raises:
        LensError: No light gets through.
        ParameterError: A number is out of range.
        ShapeError: Wavelengths and colours do not fit together.
    """
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    middle = radius * np.asarray(field, float)
    origin, slope = _scene_ray(lens, middle)
    point = origin + depth * slope
    low, high = _open_part(lens, point, depth)
    _check(size, rays, wavelengths, colors)
    check_above("pitch", pitch, 0, "mm")
    collected = _Cells(size, colors)
    for number, wavelength in enumerate(wavelengths):
        start = 1 + number * rays
        pupil = low + (high - low) * np.stack([halton(rays, 2, start), halton(rays, 3, start)], -1)
        slopes = (point - pupil) / depth
        reached, passes = lens.trace_to_sensor(Rays(origin=pupil, slope=slopes), float(wavelength))
        # A small patch that faces the lens sends cos^4 into equal areas of the pupil's plane.
        light = passes / (1 + (slopes**2).sum(-1)) ** 2
        collected.add((-reached - middle) / pitch, light, number)
    return collected.normalised()


def aberration_psf(
    aberration_map: AberrationMap,
    *,
    defocus: float,
    field: tuple[float, float],
    wavelengths: np.ndarray,
    colors: np.ndarray,
    pitch: float,
    size: int,
    rays: int = 40_000,
) -> np.ndarray:
    """Send light of a point along the rays of a map; evenly spread over the pupil.

    Lengths are in half-diagonals of the picture: ``defocus`` (signed, + in front of focus) and ``pitch``.
    Other arguments, result and errors are those of :func:`traced_psf`. The light of the aperture coordinate
    a arrives at the p with ``p = q + defocus A(a, p) + E(a, p)``, found by fixed-point iteration; where
    pencils of neighbouring pixels converge there is more of it.
    """
    _check(size, rays, wavelengths, colors)
    check_above("pitch", pitch, 0, "half-diagonals")
    check_number("defocus", defocus)
    place = np.asarray(field, float)
    collected = _Cells(size, colors)
    for number, wavelength in enumerate(wavelengths):
        start = 1 + number * rays
        pupil = disc_from_square(np.stack([halton(rays, 2, start), halton(rays, 3, start)], -1))

        def away(at: np.ndarray, pupil: np.ndarray = pupil, nm: float = float(wavelength)) -> np.ndarray:
            transverse_aberration, bent, _ = aberration_map(pupil, at, nm)
            return np.asarray(defocus * bent + transverse_aberration)

        at = np.broadcast_to(place, pupil.shape)
        for _ in range(_ROUNDS):
            at = place + away(at)
        light = aberration_map(pupil, at, float(wavelength))[2] / _crowding(away, at)
        collected.add((at - place) / pitch, light, number)
    return collected.normalised()


def _crowding(away: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Area that pencils of neighbouring pixels cover in the picture, over that of the pixels, (N,)."""
    right, down = (
        np.eye(2)[axis]
        - (away(at + _STEP * np.eye(2)[axis]) - away(at - _STEP * np.eye(2)[axis])) / (2 * _STEP)
        for axis in range(2)
    )
    area = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
    return np.maximum(np.abs(area), 1e-6)


def psf_reach(
    lens: PrescriptionLens, depth: float, field: tuple[float, float], half_diagonal: float | None = None
) -> float:
    """How far from its middle the light of a point falls at the design wavelength, mm; all but 2 % of it."""
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    middle = radius * np.asarray(field, float)
    origin, slope = _scene_ray(lens, middle)
    point = origin + depth * slope
    low, high = _open_part(lens, point, depth)
    pupil = low + (high - low) * np.stack([halton(4096, 2), halton(4096, 3)], -1)
    reached, passes = lens.trace_to_sensor(Rays(origin=pupil, slope=(point - pupil) / depth))
    return float(np.quantile(np.abs(-reached - middle)[passes].max(axis=-1), 0.98))


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """Normalised cross-correlation of two pictures of one shape: their cosine; 1 for the same shape."""
    size = float((first**2).sum() * (second**2).sum()) ** 0.5
    return float((first * second).sum()) / size if size > 0 else 0.0


def _scene_ray(lens: PrescriptionLens, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin and slope of the ray that shows the picture's place ``middle``, mm, in the stopped-down lens."""
    rays = chief_rays(lens, middle)
    if not (np.abs(rays.stop).max() < _CENTRED and rays.heights.max() < _LOST):
        raise LensError(
            f"{lens.prescription.name}: no ray through the middle of the stop reaches "
            f"{float(np.linalg.norm(middle)):.4g} mm from the axis; choose a place nearer to it"
        )
    return rays.origin, rays.slope


def _open_part(lens: PrescriptionLens, point: np.ndarray, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners, mm, of the rectangle in the entrance pupil's plane through which light of a point passes."""
    steps = np.linspace(-1, 1, _COARSE)
    pupil = _SEARCH * lens.thick.pupil_radius * np.stack(np.meshgrid(steps, steps), -1)
    _, passes = lens.trace_to_sensor(Rays(origin=pupil, slope=(point - pupil) / depth))
    if not passes.any():
        raise LensError(
            f"{lens.prescription.name}: no light of this point of the scene gets through the lens"
        )
    margin = 2 * _SEARCH * lens.thick.pupil_radius * (steps[1] - steps[0]) / 2
    return pupil[passes].min(axis=0) - margin, pupil[passes].max(axis=0) + margin


def _check(size: int, rays: int, wavelengths: np.ndarray, colors: np.ndarray) -> None:
    check_at_least("size", size, 1)
    check_at_least("rays", rays, 1)
    if np.ndim(colors) != 2 or len(colors) != len(wavelengths) or len(wavelengths) == 0:
        raise ShapeError(
            f"colors: expected a row for each of {len(wavelengths)} wavelengths, got shape {np.shape(colors)}"
        )


class _Cells:
    """Light in square cells around a point, (size, size, C), and all that came."""

    def __init__(self, size: int, colors: np.ndarray) -> None:
        self._size, self._colors = size, np.asarray(colors, float)
        self._light = np.zeros((size, size, self._colors.shape[1]))
        self._came = 0.0

    def add(self, place: np.ndarray, light: np.ndarray, number: int) -> None:
        """Collect ``light`` (N,) of the wavelength ``number`` at places (N, 2), in cells from the middle."""
        half = self._size / 2
        seen, _, _ = np.histogram2d(
            place[:, 1], place[:, 0], self._size, [[-half, half], [-half, half]], weights=light
        )
        self._light += seen[..., None] * self._colors[number]
        self._came += float(light.sum() * self._colors[number].sum())

    def normalised(self) -> np.ndarray:
        """Light over all that came, times the channels."""
        if self._came == 0:
            raise LensError("no light arrives: the rims of the lens cut all of it")
        return self._light * (self._light.shape[2] / self._came)
