"""From a prescription to its aberration map, by tracing rays.

Aperture coordinates are places in the stop, so that the iris cuts at |a| = 1, made even
(:mod:`bokehnet.lenses.aberrations.uniform_irradiance_pupil`). What rays miss by is fitted by least squares
over the rays that pass.

A picture taken through the lens stopped far down shows each thing where the ray through the middle of the
stop has it. Such a picture is what renderers are given, distortion and all; the map then is in the
coordinates of that picture: the transverse aberration of the middle ray is left out, and what remains is
stretched as the picture is. With ``distortion=True`` it is in those of the perfect picture instead, and holds
everything.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.aberrations.uniform_irradiance_pupil import (
    UniformIrradiancePupil,
    fit_uniform_irradiance_pupil,
)
from bokehnet.lenses.aberrations.vignetting_apertures import fit_vignetting_apertures
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import StopRays, chief_rays, stop_rays
from bokehnet.optics.aberrations.aberration_map import TERMS, AberrationMap

__all__ = ["WAVELENGTHS", "aberration_misfit", "fit_aberration_map"]

# Nanometres; the design wavelength joins them. Indices bend most in the blue.
WAVELENGTHS = (400.0, 422.0, 447.0, 480.0, 530.0, 640.0, 700.0)

# Fields from the middle to a little beyond the corner, and rays along each side of the pupil.
_FIELDS, _FARTHEST, _SIDE = 17, 1.1, 40
# Rays are aimed a little beyond what passes, and count a little beyond the rims.
_AIM_RESERVE, _RESERVE = 1.08, 1.03
# How far from the axis the effective pupil of a lens is known, in radii of its picture.
_KNOWN = 1.2
# Powers of the squared field that describe the middle rays.
_POWERS = 7


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Frame:
    """Lengths that turn rays into misses, and the picture of the middle rays.

    Attributes:
        half_diagonal: Of the picture, mm.
        picture: Millimetres in the picture per unit of slope.
        focus: Inverse focus distance, 1/mm.
        pupil_radius: Of the entrance pupil, mm.
        even: Aperture coordinates.
        seen: The place of the perfect picture that the middle ray of p shows is ``p seen(p.p)``, coefficients
            of rising powers; None keeps the perfect picture.
        entry: The same for where it crosses the entrance pupil, in ``-pupil_radius``.
    """

    half_diagonal: float
    picture: float
    focus: float
    pupil_radius: float
    even: UniformIrradiancePupil
    seen: np.ndarray | None
    entry: np.ndarray | None

    def lines(self, rays: StopRays, field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transverse aberration E and coordinates A of rays from field positions h, each (..., 2)."""
        transverse_aberration = field - self.picture / self.half_diagonal * (
            rays.slope + self.focus * rays.origin
        )
        bent = -rays.origin / self.pupil_radius
        if self.seen is None or self.entry is None:
            return transverse_aberration, bent
        square = (field * field).sum(-1)
        seen, entry = (np.polynomial.polynomial.polyval(square, row) for row in (self.seen, self.entry))
        along = np.polynomial.polynomial.polyval(square, (2 * np.arange(_POWERS) + 1) * self.seen)
        transverse_aberration, bent = (
            transverse_aberration - field * (1 - seen)[..., None],
            bent - field * entry[..., None],
        )
        # Of the vectors the part along the field stretches as the picture does along it, the rest as it
        # does across: by the inverse of the derivatives of ``p seen(p.p)``.
        unit = field / np.where(square > 0, square, 1)[..., None] ** 0.5

        def stretch(vector: np.ndarray) -> np.ndarray:
            radial = (vector * unit).sum(-1)[..., None] * unit
            return np.asarray(vector / seen[..., None] + radial * (1 / along - 1 / seen)[..., None])

        return stretch(transverse_aberration), stretch(bent)


def fit_aberration_map(
    lens: PrescriptionLens,
    *,
    half_diagonal: float | None = None,
    distortion: bool = False,
    wavelengths: Sequence[float] = WAVELENGTHS,
) -> AberrationMap:
    """Reduce a lens, as it is focused and stopped down, to its aberration map.

    Args:
        lens: The lens; its ``pupil_sampling`` does not matter. Of a copy whose elements stand off the axis
            this is the map with all of them on it, as no map of these invariants holds more; how its plane of
            focus leans, :func:`bokehnet.lenses.assembly.misalignment.focus_lean` tells.
        half_diagonal: Of the picture, mm on the sensor; None is the radius that the lens is made for.
        distortion: Keep the distortion of the picture and of its pupils in the map.
        wavelengths: Nanometres; the design wavelength joins them. Empty leaves dispersion out.

    Returns:
        The map; signed defocus in half-diagonals is ``lens.coc_radius(disparity) / half_diagonal``.

    Raises:
        LensError: The picture is larger than what the lens lights, its middle rays cross, or rays through
            its stop miss a surface.
    """
    lens = lens.centred
    frame, rays, field, aim = _prepare(lens, half_diagonal, distortion)
    design = lens.prescription.design_wavelength
    all_wavelengths = sorted({design, *wavelengths})
    transverse_aberration, pupil_aberration = [], []
    for wavelength in all_wavelengths:
        traced = stop_rays(lens, frame.half_diagonal * field, aim, wavelength)
        used = traced.heights.max(axis=0) < _RESERVE
        pupil, at = frame.even(traced.stop, field)[used], field[used]
        missed, bent = (values[used] for values in frame.lines(traced, field))
        if not (np.isfinite(pupil).all() and np.isfinite(missed).all() and np.isfinite(bent).all()):
            name = lens.prescription.name
            raise LensError(f"{name}: rays of its picture miss a surface; stop down or use a smaller field")
        terms = _monomials(pupil, at)
        transverse_aberration.append(_fit(terms, pupil, at, missed))
        pupil_aberration.append(_fit(terms, pupil, at, bent - pupil))
    inner = (field[:, 0, 0] ** 2).sum(-1) <= 1 + 1e-9
    stop = next(i for i, row in enumerate(lens.prescription.surfaces) if row.stop)
    vignetting_apertures = fit_vignetting_apertures(
        frame.even(rays.stop, field)[inner].reshape(-1, 2),
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
    """Compare a map with rays of random fields, directions and places in the pupil that pass the lens.

    Args:
        lens: The lens.
        aberration_map: Its map, from :func:`fit_aberration_map` with the same ``half_diagonal`` and
            ``distortion``.
        half_diagonal: Of the picture, mm; None is the radius that the lens is made for.
        distortion: Whether the map holds it.
        wavelength: Nanometres; None is the design wavelength.
        count: Rays that are sent.
        seed: Of the rays.

    Returns:
        Root mean square errors of the transverse aberration, in half-diagonals, and of the coordinates A.
    """
    frame, *_ = _prepare(lens, half_diagonal, distortion)
    rng = np.random.default_rng(seed)
    radius, turn = rng.random(count) ** 0.5, 2 * np.pi * rng.random((2, count))
    field = rng.random(count)[:, None] ** 0.5 * np.stack([np.cos(turn[0]), np.sin(turn[0])], -1)
    place = frame.half_diagonal * field
    uv = radius[:, None] * np.stack([np.cos(turn[1]), np.sin(turn[1])], -1)
    rays = stop_rays(lens, place, _aim(lens, place, uv), wavelength)
    passes = rays.passes
    at = lens.prescription.design_wavelength if wavelength is None else wavelength
    found = aberration_map(frame.even(rays.stop, field)[passes], field[passes], at)
    wanted = (values[passes] for values in frame.lines(rays, field))
    transverse_aberration, pupil_aberration = (
        float(((a - b) ** 2).sum(-1).mean() ** 0.5) for a, b in zip(found[:2], wanted, strict=True)
    )
    return transverse_aberration, pupil_aberration


def _prepare(
    lens: PrescriptionLens, half_diagonal: float | None, distortion: bool
) -> tuple[_Frame, StopRays, np.ndarray, np.ndarray]:
    """The frame, and the grid of rays at the design wavelength with its fields and aims."""
    radius = lens.prescription.image_radius if half_diagonal is None else half_diagonal
    largest = _KNOWN * lens.prescription.image_radius
    if not 0 < radius <= largest:
        raise LensError(
            f"{lens.prescription.name}: half diagonal: expected above 0 to {largest:.4g} mm, which the lens "
            f"can light, got {radius:g}; scale the lens to a longer focal length or crop the picture"
        )
    steps = np.linspace(-_AIM_RESERVE, _AIM_RESERVE, _SIDE)
    uv = np.stack(np.meshgrid(steps, steps, indexing="ij"), -1)
    field = np.zeros((_FIELDS, _SIDE, _SIDE, 2))
    farthest = min(_FARTHEST, largest / radius)
    field[..., 0] = np.linspace(0, farthest, _FIELDS)[:, None, None]
    aim = _aim(lens, radius * field, np.broadcast_to(uv, field.shape))
    rays = stop_rays(lens, radius * field, aim)
    try:
        even = fit_uniform_irradiance_pupil(rays, aim, field)
    except LensError as error:
        raise LensError(f"{lens.prescription.name}: {error}") from None
    frame = _Frame(
        half_diagonal=radius,
        picture=lens.sensor_distance,
        focus=1 / lens.focus_distance,
        pupil_radius=lens.thick.pupil_radius,
        even=even,
        seen=None,
        entry=None,
    )
    if distortion:
        return frame, rays, field, aim
    places = np.stack([np.linspace(0.02, farthest, 64), np.zeros(64)], -1)
    missed, bent = frame.lines(chief_rays(lens, radius * places), places)
    powers = places[:, :1] ** (2 * np.arange(_POWERS) + 1)
    seen, entry = (np.linalg.lstsq(powers, values[:, 0], rcond=None)[0] for values in (places - missed, bent))
    along = np.polynomial.polynomial.polyval(places[:, 0] ** 2, (2 * np.arange(_POWERS) + 1) * seen)
    if along.min() <= 0:
        raise LensError(f"{lens.prescription.name}: rays through the middle of the stop cross in the picture")
    frame = _Frame(
        half_diagonal=radius,
        picture=frame.picture,
        focus=frame.focus,
        pupil_radius=frame.pupil_radius,
        even=frame.even,
        seen=seen,
        entry=entry,
    )
    return frame, rays, field, aim


def _aim(lens: PrescriptionLens, place: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Points of the exit pupil's plane, mm, (..., 2): the unit disc on what passes, seen from ``place``."""
    distance = lens.sensor_position - lens.paraxial.exit.position
    x, y, _ = lens.effective_pupil.aim(-place, distance, uv)
    return np.stack([x, y], -1)


def _monomials(pupil: np.ndarray, field: np.ndarray) -> np.ndarray:
    """Products of the invariants, (N, terms)."""
    aa, ah, hh = (pupil**2).sum(-1), (pupil * field).sum(-1), (field**2).sum(-1)
    return np.stack([aa**i * ah**j * hh**k for i, j, k in TERMS], -1)


def _fit(terms: np.ndarray, pupil: np.ndarray, field: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Coefficients of f and g, (2, terms), with ``values = a f + h g`` for vectors (N, 2)."""
    matrix = np.concatenate(
        [
            np.concatenate([a[:, None] * terms, h[:, None] * terms], -1)
            for a, h in zip(pupil.T, field.T, strict=True)
        ]
    )
    return np.linalg.lstsq(matrix, values.T.ravel(), rcond=None)[0].reshape(2, -1)
