"""Fit of an aberration map to traced rays of a prescription.

Aperture coordinates are points of the stop, so that the iris clips at |a| = 1, transformed to uniform
irradiance (:mod:`bokehnet.lenses.aberrations.uniform_irradiance_pupil`). The aberrations are fitted by least
squares over the rays that pass.

A picture taken through the lens stopped far down shows each point at the position of its chief ray. Renderers
receive such a picture, including its distortion; the map then uses the coordinates of that picture: the
transverse aberration of the chief ray is excluded, and the remainder is scaled by the local stretch of the
picture. With ``distortion=True`` the map uses the coordinates of the ideal picture instead, and includes
the distortion.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.aberrations.uniform_irradiance_pupil import (
    UniformIrradiancePupil,
    fit_uniform_irradiance_pupil,
)
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import StopRays, chief_rays, stop_rays
from bokehnet.optics.aberrations.aberration_map import TERMS, AberrationMap, rim_passes

__all__ = ["WAVELENGTHS", "aberration_misfit", "fit_aberration_map"]

# Fitted wavelengths in addition to the design wavelength, nm; denser in the blue, where dispersion is
# largest.
WAVELENGTHS = (400.0, 422.0, 447.0, 480.0, 530.0, 640.0, 700.0)

# Number of fields, the last one in half-diagonals, and number of rays along each side of the pupil.
_FIELDS, _MAX_FIELD, _SIDE = 17, 1.1, 40
# Size of the grid of rays relative to the effective pupil, and relative height up to which rays are fitted.
_AIM_RESERVE, _HEIGHT_RESERVE = 1.08, 1.03
# Field radius of the effective pupil of a lens, in image radii.
_PUPIL_FIELD = 1.2
# Number of powers of the squared field that describe the chief rays.
_POWERS = 7

# Range of relative heights of rays near a rim, and minimum number of such rays for a fit.
_RIM_HEIGHTS = (0.95, 1.05)
_MIN_RAYS = 12
_MAX_ITERATIONS = 30
# Half-width of the range of relative heights at central obstructions, where rays are fewer.
_INNER_HALF_WIDTH = 0.15
# Minimum fraction of the light that a rim must block to be kept.
_MIN_BLOCKED = 1e-3


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Frame:
    """Lengths that convert rays to aberrations, and the picture of the chief rays.

    Attributes:
        half_diagonal: Half-diagonal of the picture, mm.
        picture: Millimetres in the picture per unit of slope.
        focus: Inverse focus distance, 1/mm.
        pupil_radius: Radius of the entrance pupil, mm.
        aperture_coordinates: Mapping from points of the stop to aperture coordinates.
        chief_position: Coefficients, of ascending powers, of the position in the ideal picture of the chief
            ray of p, ``p chief_position(p.p)``; None keeps the ideal picture.
        chief_entry: Coefficients of its intersection with the entrance pupil, in ``-pupil_radius``.
    """

    half_diagonal: float
    picture: float
    focus: float
    pupil_radius: float
    aperture_coordinates: UniformIrradiancePupil
    chief_position: np.ndarray | None
    chief_entry: np.ndarray | None

    def aberrations(self, rays: StopRays, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return transverse aberration E and coordinates A of rays from field positions h, each (..., 2)."""
        transverse_aberration = field - self.picture / self.half_diagonal * (
            rays.slope + self.focus * rays.origin
        )
        coordinates = -rays.origin / self.pupil_radius
        if self.chief_position is None or self.chief_entry is None:
            return transverse_aberration, coordinates
        square = (field * field).sum(-1)
        chief_position, chief_entry = (
            np.polynomial.polynomial.polyval(square, row) for row in (self.chief_position, self.chief_entry)
        )
        along = np.polynomial.polynomial.polyval(square, (2 * np.arange(_POWERS) + 1) * self.chief_position)
        transverse_aberration, coordinates = (
            transverse_aberration - field * (1 - chief_position)[..., None],
            coordinates - field * chief_entry[..., None],
        )
        # The radial part of the vectors is scaled by the radial stretch of the picture, the tangential part
        # by the tangential stretch: the inverse of the derivatives of ``p chief_position(p.p)``.
        unit = field / np.where(square > 0, square, 1)[..., None] ** 0.5

        def stretch(vector: np.ndarray) -> np.ndarray:
            radial = (vector * unit).sum(-1)[..., None] * unit
            return np.asarray(
                vector / chief_position[..., None] + radial * (1 / along - 1 / chief_position)[..., None]
            )

        return stretch(transverse_aberration), stretch(coordinates)


def fit_aberration_map(
    lens: PrescriptionLens,
    *,
    half_diagonal: float | None = None,
    distortion: bool = False,
    wavelengths: Sequence[float] = WAVELENGTHS,
) -> AberrationMap:
    """Return the aberration map of a lens, with focus and iris as set.

    Args:
        lens: Lens to fit; its ``pupil_sampling`` is ignored. For a copy with decentred elements
            the map is that of the centred lens, since these invariants cannot describe more;
            :func:`bokehnet.lenses.assembly.misalignment.focus_tilt` returns the tilt of its plane of focus.
        half_diagonal: Half-diagonal of the picture, mm on the sensor; None is the image radius of the lens.
        distortion: Keep the distortion of the picture and of its pupils in the map.
        wavelengths: Wavelengths in addition to the design wavelength, nm. Empty for no dispersion.

    Returns:
        The map; signed defocus in half-diagonals is ``lens.coc_radius(disparity) / half_diagonal``.

    Raises:
        LensError: The picture is larger than the image circle, its chief rays cross, or rays through
            the stop miss a surface.
    """
    lens = lens.centred
    frame, rays, field, aim = _prepare(lens, half_diagonal, distortion)
    design = lens.prescription.design_wavelength
    all_wavelengths = sorted({design, *wavelengths})
    transverse_aberration, pupil_aberration = [], []
    for wavelength in all_wavelengths:
        traced = stop_rays(lens, frame.half_diagonal * field, aim, wavelength)
        used = traced.heights.max(axis=0) < _HEIGHT_RESERVE
        pupil, at = frame.aperture_coordinates(traced.stop, field)[used], field[used]
        error, coordinates = (values[used] for values in frame.aberrations(traced, field))
        if not (np.isfinite(pupil).all() and np.isfinite(error).all() and np.isfinite(coordinates).all()):
            name = lens.prescription.name
            raise LensError(f"{name}: rays of its picture miss a surface; stop down or use a smaller field")
        terms = _monomials(pupil, at)
        transverse_aberration.append(_fit(terms, pupil, at, error))
        pupil_aberration.append(_fit(terms, pupil, at, coordinates - pupil))
    inner = (field[:, 0, 0] ** 2).sum(-1) <= 1 + 1e-9
    stop = next(i for i, row in enumerate(lens.prescription.surfaces) if row.stop)
    vignetting_apertures = _fit_vignetting_apertures(
        frame.aperture_coordinates(rays.stop, field)[inner].reshape(-1, 2),
        field[inner].reshape(-1, 2),
        rays.heights[:, inner].reshape(len(rays.heights), -1),
        stop,
        rays.inner_heights[:, inner].reshape(len(rays.inner_heights), int(inner.sum()) * _SIDE**2),
    )
    return AberrationMap(
        wavelengths=np.array(all_wavelengths),
        transverse_aberration=np.stack(transverse_aberration),
        pupil_aberration=np.stack(pupil_aberration),
        vignetting_apertures=vignetting_apertures,
    )


def aberration_misfit(
    lens: PrescriptionLens,
    aberration_map: AberrationMap,
    *,
    half_diagonal: float | None = None,
    distortion: bool = False,
    wavelength: float | None = None,
    count: int = 4000,
    seed: int = 0,
) -> tuple[float, float]:
    """Return the error of a map for random rays that pass the lens.

    Args:
        lens: Lens of the map.
        aberration_map: Map from :func:`fit_aberration_map` with the same ``half_diagonal`` and
            ``distortion``.
        half_diagonal: Half-diagonal of the picture, mm; None is the image radius of the lens.
        distortion: True if the map includes the distortion.
        wavelength: Wavelength, nm; None is the design wavelength.
        count: Number of rays.
        seed: Seed of the rays.

    Returns:
        Root mean square errors of the transverse aberration, in half-diagonals, and of the coordinates A.
    """
    frame, *_ = _prepare(lens, half_diagonal, distortion)
    rng = np.random.default_rng(seed)
    radius, angle = rng.random(count) ** 0.5, 2 * np.pi * rng.random((2, count))
    field = rng.random(count)[:, None] ** 0.5 * np.stack([np.cos(angle[0]), np.sin(angle[0])], -1)
    place = frame.half_diagonal * field
    uv = radius[:, None] * np.stack([np.cos(angle[1]), np.sin(angle[1])], -1)
    rays = stop_rays(lens, place, _aim(lens, place, uv), wavelength)
    passes = rays.passes
    at = lens.prescription.design_wavelength if wavelength is None else wavelength
    fitted = aberration_map(frame.aperture_coordinates(rays.stop, field)[passes], field[passes], at)
    traced = (values[passes] for values in frame.aberrations(rays, field))
    transverse_aberration, pupil_aberration = (
        float(((a - b) ** 2).sum(-1).mean() ** 0.5) for a, b in zip(fitted[:2], traced, strict=True)
    )
    return transverse_aberration, pupil_aberration


def _prepare(
    lens: PrescriptionLens, half_diagonal: float | None, distortion: bool
) -> tuple[_Frame, StopRays, np.ndarray, np.ndarray]:
    """Return the frame, and the grid of rays at the design wavelength with its fields and aim points."""
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    largest = _PUPIL_FIELD * lens.prescription.image_radius
    if not 0 < radius <= largest:
        raise LensError(
            f"{lens.prescription.name}: half diagonal: expected above 0 to {largest:.4g} mm, which the lens "
            f"can light, got {radius:g}; scale the lens to a longer focal length or crop the picture"
        )
    steps = np.linspace(-_AIM_RESERVE, _AIM_RESERVE, _SIDE)
    uv = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1)
    field = np.zeros((_FIELDS, _SIDE, _SIDE, 2))
    max_field = min(_MAX_FIELD, largest / radius)
    field[..., 0] = np.linspace(0, max_field, _FIELDS)[:, None, None]
    aim = _aim(lens, radius * field, np.broadcast_to(uv, field.shape))
    rays = stop_rays(lens, radius * field, aim)
    try:
        aperture_coordinates = fit_uniform_irradiance_pupil(rays, aim, field)
    except LensError as error:
        raise LensError(f"{lens.prescription.name}: {error}") from None
    frame = _Frame(
        half_diagonal=radius,
        picture=lens.sensor_distance,
        focus=1 / lens.focus_distance,
        pupil_radius=lens.thick.pupil_radius,
        aperture_coordinates=aperture_coordinates,
        chief_position=None,
        chief_entry=None,
    )
    if distortion:
        return frame, rays, field, aim
    places = np.stack([np.linspace(0.02, max_field, 64), np.zeros(64)], -1)
    offset, coordinates = frame.aberrations(chief_rays(lens, radius * places), places)
    powers = places[:, :1] ** (2 * np.arange(_POWERS) + 1)
    chief_position, chief_entry = (
        np.linalg.lstsq(powers, values[:, 0], rcond=None)[0] for values in (places - offset, coordinates)
    )
    along = np.polynomial.polynomial.polyval(places[:, 0] ** 2, (2 * np.arange(_POWERS) + 1) * chief_position)
    if along.min() <= 0:
        raise LensError(f"{lens.prescription.name}: rays through the middle of the stop cross in the picture")
    frame = _Frame(
        half_diagonal=radius,
        picture=frame.picture,
        focus=frame.focus,
        pupil_radius=frame.pupil_radius,
        aperture_coordinates=frame.aperture_coordinates,
        chief_position=chief_position,
        chief_entry=chief_entry,
    )
    return frame, rays, field, aim


def _aim(lens: PrescriptionLens, place: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Return points in the plane of the exit pupil, mm, (..., 2): the effective pupil seen from ``place``."""
    distance = lens.sensor_position - lens.paraxial.exit.position
    x, y, _ = lens.effective_pupil.aim(-place, distance, uv)
    return np.stack([x, y], -1)


def _monomials(pupil: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Return the products of the invariants, (N, terms)."""
    aa, ah, hh = (pupil**2).sum(-1), (pupil * field).sum(-1), (field**2).sum(-1)
    return np.stack([aa**i * ah**j * hh**k for i, j, k in TERMS], -1)


def _fit(terms: np.ndarray, pupil: np.ndarray, field: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the coefficients of f and g, (2, terms), with ``values = a f + h g`` for vectors (N, 2)."""
    matrix = np.concatenate(
        [
            np.concatenate([a[:, None] * terms, h[:, None] * terms], -1)
            for a, h in zip(pupil.T, field.T, strict=True)
        ]
    )
    return np.linalg.lstsq(matrix, values.T.ravel(), rcond=None)[0].reshape(2, -1)


def _fit_vignetting_apertures(
    pupil: np.ndarray,
    field: np.ndarray,
    heights: np.ndarray,
    stop: int,
    inner_heights: np.ndarray | None = None,
) -> tuple[tuple[float, float], ...]:
    """Return discs ``|a - shift h| <= radius`` fitted to the clipping of the pupil by rims.

    Each rim that clips first at some field appears as a disc through the stop. The discs
    needed to reproduce the passing rays are kept, the most important first.

    Args:
        pupil: Coordinates a of rays, (N, 2).
        field: Field positions h, (N, 2).
        heights: Height over semi-diameter at each surface, (surfaces, N).
        stop: Index of the stop among the surfaces.
        inner_heights: Height over inner radius at central obstructions, (obstructions, N).

    Returns:
        Pairs (shift, radius); the radius of a central obstruction is negative.
    """
    inside = (pupil**2).sum(-1) <= 1
    others = np.delete(heights, stop, axis=0)
    discs = []
    for number, rim in enumerate(others):
        rest = np.delete(others, number, axis=0).max(axis=0, initial=0)
        near = inside & (rest <= 1) & (rim > _RIM_HEIGHTS[0]) & (rim < _RIM_HEIGHTS[1])
        if near.sum() >= _MIN_RAYS:
            discs.append(_fit_disc(pupil[near], field[near], rim[near]))
    target = others.max(axis=0, initial=0) <= 1
    for inner in () if inner_heights is None else inner_heights:
        near = (
            inside
            & (others.max(axis=0, initial=0) <= 1)
            & (inner > 1 - _INNER_HALF_WIDTH)
            & (inner < 1 + _INNER_HALF_WIDTH)
        )
        if near.sum() >= _MIN_RAYS:
            shift, radius = _fit_disc(pupil[near], field[near], inner[near])
            discs.append((shift, -radius))
        target &= inner >= 1
    passes = inside
    selected: list[tuple[float, float]] = []
    masks = [rim_passes(pupil, field, shift, radius) for shift, radius in discs]
    while discs:
        wrong = [(inside & ((passes & mask) != target)).sum() for mask in masks]
        best = int(np.argmin(wrong))
        if (inside & (passes != target)).sum() - wrong[best] < _MIN_BLOCKED * (inside & target).sum():
            break
        passes = passes & masks.pop(best)
        selected.append(discs.pop(best))
    return tuple(selected)


def _fit_disc(pupil: np.ndarray, field: np.ndarray, height: np.ndarray) -> tuple[float, float]:
    """Return shift and radius with ``|a - shift h| = radius height``, by the Gauss-Newton method.

    The start is the linear fit of ``(a.a - 2 shift a.h + ...) / radius^2 = height^2``.
    """
    aa, ah, hh = (pupil**2).sum(-1), (pupil * field).sum(-1), (field**2).sum(-1)
    size, middle, _ = np.linalg.lstsq(np.stack([aa, -2 * ah, hh], -1), height**2, rcond=None)[0]
    shift, radius = (middle / size, size**-0.5) if size > 0 else (0.0, 1.0)
    for _ in range(_MAX_ITERATIONS):
        offset = pupil - shift * field
        length = np.maximum((offset**2).sum(-1) ** 0.5, 1e-9)
        slopes = np.stack([-(offset * field).sum(-1) / length, -height], -1)
        step = np.linalg.lstsq(slopes, radius * height - length, rcond=None)[0]
        shift, radius = shift + step[0], max(radius + step[1], 1e-3)
    return float(shift), float(radius)
