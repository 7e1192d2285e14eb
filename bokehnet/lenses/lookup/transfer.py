"""Lens ray transfer function: ray mapping of a lens, fitted to traced rays.

A ray behind the lens is given by its intersections with two planes: r in the plane of the sensor focused at
infinity, p in the exit pupil. A ray in front is its position in the entrance pupil and its slope. Because the
lens is symmetric about its axis and in every plane through it, both are ``a r + b p`` with scalars a and b
that depend on the invariants r.r, r.p and p.p alone: the map of four numbers to four reduces to functions
of three. There is no pole, no angle and no root. Gaussian optics is a and b constant, and each order
of aberrations is one degree more, so the table contains polynomials fitted to some thousand traced rays.
(Nodes in (|r|, p) with linear interpolation were tried first: 70,000 of them are less exact, and slower to
read.) The heights at clipping rims are polynomials of the same three numbers, so that vignetting stays
sharp. The iris is separate: one table serves every f-number, every focus and any tilt of the sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bokehnet.checks import Array, array_namespace, constant_like
from bokehnet.errors import LensError
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.prescription_file import Prescription
from bokehnet.lenses.surface_trace import Beam, Surface, beam_between, trace

__all__ = ["TransferLens", "TransferTable"]

# Number of traced rays per wavelength; range, nm, and number of wavelengths of a dispersive table.
_RAYS = 6000
_MIN_WAVELENGTH, _MAX_WAVELENGTH, _WAVELENGTHS = 400.0, 700.0, 7
# Range of the fit: sensor radius over image radius, and relative height of rays at the rims.
_FIELD_RESERVE, _FILL_RESERVE = 1.2, 1.05
# Range of relative heights in which the clipping rims are determined.
_RIM_HEIGHTS = (0.9, 1.1)


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class TransferTable:
    """Coefficients (outputs, monomials), and units of the invariants, mm.

    Outputs: a and b of the position, a and b of the slope, squared height over semi-diameter at the
    iris, and the same at each clipping rim.
    """

    coefficients: np.ndarray
    sensor: float
    sensor_radius: float
    pupil_radius: float


@dataclass(frozen=True, kw_only=True)
class TransferLens(PrescriptionLens):
    """Prescription with rays by table lookup; everything else is that of :class:`PrescriptionLens`.

    Attributes:
        degree: Degree of the polynomials in the invariants; 4 covers aberrations up to the ninth order.
        dispersive: True if the table covers wavelengths from 400 to 700 nm; otherwise all rays have the
            design wavelength.
        stored: Precomputed table of the same prescription, degree and wavelengths; None computes it.
    """

    degree: int = 4
    dispersive: bool = False
    stored: TransferTable | None = None

    @property
    def table(self) -> TransferTable:
        """Table, shared by lenses that differ in iris and focus only."""
        if self.stored is not None:
            return self.stored
        return _make_table(self.prescription, self.degree, self.dispersive)

    def transfer(self, beam: Beam, wavelength: Array | None = None) -> Beam:
        """Look up rays from the sensor.

        Returns:
            Rays in the entrance pupil; their direction is not a unit vector.

        Raises:
            LensError: ``wavelength`` is set and the table is not dispersive.
        """
        if wavelength is not None and not self.dispersive:
            design = self.prescription.design_wavelength
            raise LensError(f"the table holds {design:g} nm only: make the lens with dispersive=True")
        table = self.table
        (x, y), (u, v) = beam.at(table.sensor), beam.at(self.paraxial.exit.position)
        x, y = x / table.sensor_radius, y / table.sensor_radius
        u, v = u / table.pupil_radius, v / table.pupil_radius
        variables = [x * x + y * y, x * u + y * v, u * u + v * v]
        if self.dispersive:
            colour = self.prescription.design_wavelength if wavelength is None else wavelength
            variables.append(_colour_coordinate(colour) + 0 * x)
        terms = _monomials(variables, self.degree)
        coefficients = constant_like(table.coefficients, terms)
        outputs = (coefficients @ terms.reshape(len(terms), -1)).reshape(-1, *x.shape)
        a, b, c, d, iris = outputs[0], outputs[1], outputs[2], outputs[3], outputs[4]
        xp = array_namespace(x)
        # Polynomials are invalid for rays far outside the fitted range.
        in_range = (variables[0] <= 1) & (variables[2] <= 1)
        fill = xp.where(in_range, xp.ones_like(x), 4 * xp.ones_like(x))
        for rim in outputs[5:]:
            fill = xp.maximum(fill, xp.where(rim > 1, rim, xp.ones_like(x)))
        open_radius = next(row.semi_diameter for row in self.prescription.surfaces if row.stop)
        return Beam(
            position=(a * x + b * u, a * y + b * v, self.paraxial.entrance.position),
            direction=(c * x + d * u, c * y + d * v, xp.ones_like(x)),
            fill=fill,
            stop_fill=iris * (open_radius / self.stop_radius) ** 2,
        )


def _colour_coordinate(wavelength: Array) -> Array:
    """Return the inverse square of the wavelength, 0 to 1 in the range; indices are nearly linear in it."""
    low, high = _MAX_WAVELENGTH**-2, _MIN_WAVELENGTH**-2
    return (1 / (wavelength * wavelength) - low) / (high - low)


def _monomials(variables: Sequence[Array], degree: int) -> Array:
    """Return all products of up to ``degree`` variables, (products, ...), each from an earlier one."""
    xp = array_namespace(variables[0])
    level = [(xp.ones_like(variables[0]), 0)]
    terms = [level[0][0]]
    for _ in range(degree):
        level = [(term * variables[k], k) for term, first in level for k in range(first, len(variables))]
        terms += [term for term, _ in level]
    return xp.stack(terms)


@lru_cache(maxsize=8)
def _make_table(prescription: Prescription, degree: int, dispersive: bool) -> TransferTable:
    if not prescription.centred:
        raise LensError(
            f"{prescription.name}: expected elements centred on the axis, found decentred ones, which "
            f"invariants of rays cannot describe"
        )
    lens = PrescriptionLens(prescription=prescription)
    ellipses = lens.effective_pupil.ellipses
    pupil_radius = 1.1 * float((np.abs(ellipses[:, 0]) + ellipses[:, 1:].max(axis=1)).max())
    sensor_radius = _FIELD_RESERVE * prescription.image_radius
    rng = np.random.default_rng(0)
    r = np.stack([sensor_radius * rng.random(_RAYS) ** 0.5, np.zeros(_RAYS)])
    radius, angle = pupil_radius * rng.random(_RAYS) ** 0.5, 2 * np.pi * rng.random(_RAYS)
    p = np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    aimed = beam_between((*r, lens.sensor_position), (*p, lens.paraxial.exit.position))
    r, p = r / sensor_radius, p / pupil_radius
    invariants = [(r * r).sum(0), (r * p).sum(0), (p * p).sum(0)]
    wavelengths = [prescription.design_wavelength]
    if dispersive:
        wavelengths = list(np.linspace(_MAX_WAVELENGTH**-2, _MIN_WAVELENGTH**-2, _WAVELENGTHS) ** -0.5)
    terms, places, slopes, heights = [], [], [], []
    for wavelength in wavelengths:
        beam, fills = _trace_heights(prescription.trace_surfaces(wavelength), aimed)
        dx, dy, dt = beam.direction
        colour = [np.full(_RAYS, _colour_coordinate(wavelength))] if dispersive else []
        terms.append(_monomials(invariants + colour, degree))
        places.append(np.stack(beam.at(lens.paraxial.entrance.position)))
        slopes.append(np.stack([dx / dt, dy / dt]))
        heights.append(fills)
    joined = np.concatenate(terms, -1)
    fills = np.concatenate(heights, -1)
    iris = next(i for i, row in enumerate(prescription.surfaces) if row.stop)
    rims = np.delete(fills, iris, axis=0)
    near = (rims.max(0) > _RIM_HEIGHTS[0]) & (rims.max(0) < _RIM_HEIGHTS[1]) & (fills[iris] < 1)
    clipping = np.unique(rims[:, near].argmax(0))
    used = fills.max(0) < _FILL_RESERVE
    r, p = np.tile(r, len(wavelengths)), np.tile(p, len(wavelengths))
    pairs = np.concatenate([np.concatenate([r[i] * joined, p[i] * joined])[:, used] for i in range(2)], -1)
    rows = []
    for targets in (places, slopes):
        values = np.concatenate(targets, -1)[:, used].reshape(-1)
        rows += np.split(np.linalg.lstsq(pairs.T, values, rcond=None)[0], 2)
    for fill in (fills[iris], *rims[clipping]):
        rows.append(np.linalg.lstsq(joined[:, used].T, fill[used] ** 2, rcond=None)[0])
    return TransferTable(
        coefficients=np.stack(rows),
        sensor=lens.sensor_position,
        sensor_radius=sensor_radius,
        pupil_radius=pupil_radius,
    )


def _trace_heights(surfaces: Sequence[Surface], beam: Beam) -> tuple[Beam, np.ndarray]:
    """Trace rays from the sensor; also return heights over semi-diameters, (surfaces, rays)."""
    fills = []
    for surface in reversed(surfaces):
        clear = Beam(
            position=beam.position,
            direction=beam.direction,
            fill=0 * beam.fill,
            stop_fill=0 * beam.fill,
        )
        beam = trace([surface], clear, backwards=True)
        fills.append(np.maximum(beam.fill, beam.stop_fill))
    return beam, np.stack(fills[::-1])
