"""The lens ray transfer function: what a lens does to rays, known from a table of traced ones.

A ray behind the lens is given by where it crosses two planes: r in the plane of the sensor focused at
infinity, p in the exit pupil. A ray in front is its place in the entrance pupil and its slope. Because the
lens is symmetric about its axis and in every plane through it, both are ``a r + b p`` with scalars a and b
that depend on the invariants r.r, r.p and p.p alone: the map of four numbers to four shrinks to functions
of three. There is no pole, no angle and no root to take. Gaussian optics is a and b constant, and each order
of aberrations is one degree more, so the table holds polynomials through some thousand traced rays. (Nodes
in (|r|, p) with linear interpolation were tried first: 70,000 of them are less exact, and slower to read.)
The heights at those rims that clip are polynomials of the same three numbers, so that vignetting stays
sharp. The iris is kept apart: one table serves every f-number, every focus and any tilt of the sensor.
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

# Traced rays per wavelength, and wavelengths of a dispersive table with its range, nm.
_RAYS = 6000
_SHORTEST, _LONGEST, _WAVELENGTHS = 400.0, 700.0, 7
# Sensor points are learned up to this share of the picture's radius, rays up to this height at the rims.
_FIELD_RESERVE, _FILL_RESERVE = 1.2, 1.05
# A rim is told of when it is the one that clips, in this range of heights over semi-diameter.
_NEAR_RIM = (0.9, 1.1)


@dataclass(frozen=True, kw_only=True, eq=False, slots=True)
class TransferTable:
    """Coefficients (outputs, monomials) and the units of the invariants, mm.

    Outputs: a and b of the place, a and b of the slope, squared height over semi-diameter at the
    iris, and the same at each rim that clips.
    """

    coefficients: np.ndarray
    sensor: float
    sensor_radius: float
    pupil_radius: float


@dataclass(frozen=True, kw_only=True)
class TransferLens(PrescriptionLens):
    """A prescription whose rays are looked up; everything else is that of :class:`PrescriptionLens`.

    Attributes:
        degree: Of the polynomials in the invariants; 4 covers aberrations up to the ninth order.
        dispersive: Whether the table holds wavelengths from 400 to 700 nm; without, all rays are those of the
            design wavelength.
        stored: A table that was made before of the same prescription, degree and wavelengths.
    """

    degree: int = 4
    dispersive: bool = False
    stored: TransferTable | None = None

    @property
    def table(self) -> TransferTable:
        """The table; made once for lenses that differ in iris and focus only."""
        if self.stored is not None:
            return self.stored
        return _make_table(self.prescription, self.degree, self.dispersive)

    def transfer(self, beam: Beam, wavelength: Array | None = None) -> Beam:
        """Look up rays that come from the sensor.

        Returns:
            Rays in the entrance pupil; their direction is not of unit length.

        Raises:
            LensError: A wavelength is asked for and the table is not dispersive.
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
        found = (coefficients @ terms.reshape(len(terms), -1)).reshape(-1, *x.shape)
        a, b, c, d, iris = found[0], found[1], found[2], found[3], found[4]
        xp = array_namespace(x)
        # Polynomials know nothing of rays far outside of those that they were made from.
        known = (variables[0] <= 1) & (variables[2] <= 1)
        fill = xp.where(known, xp.ones_like(x), 4 * xp.ones_like(x))
        for rim in found[5:]:
            fill = xp.maximum(fill, xp.where(rim > 1, rim, xp.ones_like(x)))
        open_radius = next(row.semi_diameter for row in self.prescription.surfaces if row.stop)
        return Beam(
            position=(a * x + b * u, a * y + b * v, self.paraxial.entrance.position),
            direction=(c * x + d * u, c * y + d * v, xp.ones_like(x)),
            fill=fill,
            stop_fill=iris * (open_radius / self.stop_radius) ** 2,
        )


def _colour_coordinate(wavelength: Array) -> Array:
    """Inverse square of the wavelength, 0 to 1 over the table's range; indices are nearly linear in it."""
    low, high = _LONGEST**-2, _SHORTEST**-2
    return (1 / (wavelength * wavelength) - low) / (high - low)


def _monomials(variables: Sequence[Array], degree: int) -> Array:
    """All products of up to ``degree`` variables, (products, ...), each made from an earlier one."""
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
            f"{prescription.name}: elements stand off the axis, which no invariants of rays can tell"
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
        wavelengths = list(np.linspace(_LONGEST**-2, _SHORTEST**-2, _WAVELENGTHS) ** -0.5)
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
    near = (rims.max(0) > _NEAR_RIM[0]) & (rims.max(0) < _NEAR_RIM[1]) & (fills[iris] < 1)
    clipping = np.unique(rims[:, near].argmax(0))
    used = fills.max(0) < _FILL_RESERVE
    r, p = np.tile(r, len(wavelengths)), np.tile(p, len(wavelengths))
    pairs = np.concatenate([np.concatenate([r[i] * joined, p[i] * joined])[:, used] for i in range(2)], -1)
    rows = []
    for wanted in (places, slopes):
        values = np.concatenate(wanted, -1)[:, used].reshape(-1)
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
    """Trace rays from the sensor; height over semi-diameter at each surface, (surfaces, rays)."""
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
