"""Point spread functions: traced through the glass, and computed from an aberration map.

Both are images of one point of the scene, relative to its position in the picture of the lens stopped far
down.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import check_above, check_at_least, check_number
from bokehnet.errors import LensError, ShapeError
from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["PsfGrid", "aberration_psf", "correlation", "psf_radius", "traced_psf"]

# Half-side of the searched square in the entrance pupil, pupil radii, and number of rays along it.
_SEARCH_RADII, _COARSE = 3.0, 96
# Fixed-point iterations for the arrival of light; each reduces the error to a few per cent, the gradient of
# the transverse aberration.
_ITERATIONS = 5
# Tolerance of chief rays at the stop, in radii, and relative height of rays that missed a surface.
_STOP_TOLERANCE, _LOST = 1e-3, 1e5
# Step of finite differences, half-diagonals.
_STEP = 1e-4


@dataclass(frozen=True, kw_only=True, slots=True)
class PsfGrid:
    """Square cells around a point and its wavelengths, which sample a point spread function.

    Attributes:
        pitch: Distance between two cells, in the unit of the function.
        size: Number of cells along each side; the position of the point is the centre.
        wavelengths: Wavelengths, nm, (L,).
        colors: Weight of each wavelength in the channels, (L, C).
        rays: Number of rays per wavelength, including clipped ones.

    Raises:
        ParameterError: A number is out of range.
        ShapeError: Wavelengths and colours have different lengths.

    Examples:
        >>> PsfGrid(pitch=0.01, size=32, wavelengths=np.array([550.0]), colors=np.ones((1, 3))).rays
        40000
    """

    pitch: float
    size: int
    wavelengths: np.ndarray
    colors: np.ndarray
    rays: int = 40_000

    def __post_init__(self) -> None:
        check_above("pitch", self.pitch, 0)
        check_at_least("size", self.size, 1)
        check_at_least("rays", self.rays, 1)
        colors, count = self.colors, len(self.wavelengths)
        if np.ndim(colors) != 2 or len(colors) != count or count == 0:
            raise ShapeError(
                f"colors: expected a row for each of {count} wavelengths, got shape {np.shape(colors)}"
            )

    def sequence(self, number: int) -> np.ndarray:
        """Return the sample points of a wavelength in the unit square, (rays, 2)."""
        start = 1 + number * self.rays
        return np.stack([halton(self.rays, 2, start), halton(self.rays, 3, start)], -1)


def traced_psf(
    lens: PrescriptionLens,
    grid: PsfGrid,
    *,
    depth: float,
    field: tuple[float, float],
    half_diagonal: float | None = None,
) -> np.ndarray:
    """Return the image of a point on the sensor, traced through the lens.

    Args:
        lens: Lens to trace.
        grid: Cells, their pitch in mm, and wavelengths.
        depth: Depth of the point, mm from the entrance pupil.
        field: Position h of the point in the picture of the lens stopped far down, corner at 1, right and
            down.
        half_diagonal: Half-diagonal of the picture, mm; None is the image radius of the lens.

    Returns:
        Light in each cell, (size, size, C); the sum over all channels is ``C``, less the light outside.

    Raises:
        LensError: No light passes the lens.
    """
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    middle = radius * np.asarray(field, float)
    origin, slope = _scene_ray(lens, middle)
    point = origin + depth * slope
    low, high = _pupil_bounds(lens, point, depth)
    collected = _Cells(grid.size, grid.colors)
    for number, wavelength in enumerate(grid.wavelengths):
        pupil = low + (high - low) * grid.sequence(number)
        slopes = (point - pupil) / depth
        arrival, passes = lens.trace_to_sensor(Rays(origin=pupil, slope=slopes), float(wavelength))
        # A small patch that faces the lens sends cos^4 into equal areas of the plane of the pupil.
        light = passes / (1 + (slopes**2).sum(-1)) ** 2
        collected.add((-arrival - middle) / grid.pitch, light, number)
    return collected.normalised()


def aberration_psf(
    aberration_map: AberrationMap, grid: PsfGrid, *, defocus: float, field: tuple[float, float]
) -> np.ndarray:
    """Return the image of a point by the rays of an aberration map, uniform over the pupil.

    Lengths are in half-diagonals of the picture: ``defocus`` (signed, + in front of focus) and the pitch.
    Other arguments, result and errors are those of :func:`traced_psf`. The light of the aperture coordinate
    a arrives at the p with ``p = q + defocus A(a, p) + E(a, p)``, solved by fixed-point iteration; it is
    weighted by the convergence of the pencils of neighbouring pixels.
    """
    check_number("defocus", defocus)
    place = np.asarray(field, float)
    collected = _Cells(grid.size, grid.colors)
    for number, wavelength in enumerate(grid.wavelengths):
        pupil = disc_from_square(grid.sequence(number))

        def displacement(
            at: np.ndarray, pupil: np.ndarray = pupil, nm: float = float(wavelength)
        ) -> np.ndarray:
            transverse_aberration, coordinates, _ = aberration_map(pupil, at, nm)
            return np.asarray(defocus * coordinates + transverse_aberration)

        at = np.broadcast_to(place, pupil.shape)
        for _ in range(_ITERATIONS):
            at = place + displacement(at)
        light = aberration_map(pupil, at, float(wavelength))[2] / _area_ratio(displacement, at)
        collected.add((at - place) / grid.pitch, light, number)
    return collected.normalised()


def _area_ratio(displacement: Callable[[np.ndarray], np.ndarray], at: np.ndarray) -> np.ndarray:
    """Return the area covered by pencils of neighbouring pixels, over that of the pixels, (N,)."""
    right, down = (
        np.eye(2)[axis]
        - (displacement(at + _STEP * np.eye(2)[axis]) - displacement(at - _STEP * np.eye(2)[axis]))
        / (2 * _STEP)
        for axis in range(2)
    )
    area = right[..., 0] * down[..., 1] - right[..., 1] * down[..., 0]
    return np.maximum(np.abs(area), 1e-6)


def psf_radius(
    lens: PrescriptionLens, depth: float, field: tuple[float, float], half_diagonal: float | None = None
) -> float:
    """Return the half-width of the image of a point at the design wavelength, mm, with 98 % of its light."""
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    middle = radius * np.asarray(field, float)
    origin, slope = _scene_ray(lens, middle)
    point = origin + depth * slope
    low, high = _pupil_bounds(lens, point, depth)
    pupil = low + (high - low) * np.stack([halton(4096, 2), halton(4096, 3)], -1)
    arrival, passes = lens.trace_to_sensor(Rays(origin=pupil, slope=(point - pupil) / depth))
    return float(np.quantile(np.abs(-arrival - middle)[passes].max(axis=-1), 0.98))


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    """Return the normalized correlation of two images of one shape, without shift; 1 if proportional."""
    size = float((first**2).sum() * (second**2).sum()) ** 0.5
    return float((first * second).sum()) / size if size > 0 else 0.0


def _scene_ray(lens: PrescriptionLens, middle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return origin and slope of the chief ray of the position ``middle`` in the picture, mm."""
    rays = chief_rays(lens, middle)
    if not (np.abs(rays.stop).max() < _STOP_TOLERANCE and rays.heights.max() < _LOST):
        raise LensError(
            f"{lens.prescription.name}: no ray through the middle of the stop reaches "
            f"{float(np.linalg.norm(middle)):.4g} mm from the axis; choose a place nearer to it"
        )
    return rays.origin, rays.slope


def _pupil_bounds(lens: PrescriptionLens, point: np.ndarray, depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners, mm, of the rectangle in the entrance pupil that light of a point passes."""
    steps = np.linspace(-1, 1, _COARSE)
    pupil = _SEARCH_RADII * lens.thick.pupil_radius * np.stack(np.meshgrid(steps, steps), -1)
    _, passes = lens.trace_to_sensor(Rays(origin=pupil, slope=(point - pupil) / depth))
    if not passes.any():
        raise LensError(
            f"{lens.prescription.name}: no light of this point of the scene gets through the lens"
        )
    margin = 2 * _SEARCH_RADII * lens.thick.pupil_radius * (steps[1] - steps[0]) / 2
    return pupil[passes].min(axis=0) - margin, pupil[passes].max(axis=0) + margin


class _Cells:
    """Light in square cells around a point, (size, size, C), and the total light."""

    def __init__(self, size: int, colors: np.ndarray) -> None:
        self._size, self._colors = size, np.asarray(colors, float)
        self._light = np.zeros((size, size, self._colors.shape[1]))
        self._total = 0.0

    def add(self, place: np.ndarray, light: np.ndarray, number: int) -> None:
        """Add ``light`` (N,) of the wavelength ``number`` at positions (N, 2), in cells from the centre."""
        half = self._size / 2
        histogram, _, _ = np.histogram2d(
            place[:, 1], place[:, 0], self._size, [[-half, half], [-half, half]], weights=light
        )
        self._light += histogram[..., None] * self._colors[number]
        self._total += float(light.sum() * self._colors[number].sum())

    def normalised(self) -> np.ndarray:
        """Return the light over the total light, times the number of channels."""
        if self._total == 0:
            raise LensError("no light arrives: the rims of the lens cut all of it")
        return self._light * (self._light.shape[2] / self._total)
