"""File of the lens ray transfer function, and its errors relative to traced rays."""

import dataclasses
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import IO

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.lookup.lens_archive import open_archive, write_archive
from bokehnet.lenses.lookup.transfer import TransferLens, TransferTable
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["TransferError", "read_transfer", "transfer_errors", "write_transfer"]

_KIND = "lens ray transfer function 1"
_NUMBERS = ("sensor", "sensor_radius", "pupil_radius")
# Zones of reported errors, fractions of the image radius, and number of rays for each.
_ZONES, _RAYS = (0.0, 0.4, 0.7, 1.0), 8000


@dataclass(frozen=True, kw_only=True, slots=True)
class TransferError:
    """Errors of looked-up rays relative to traced ones in a zone of the picture.

    Attributes:
        zone: Fractions of the image radius, from and to.
        rms: Root mean square distance in the plane of focus, micrometres on the sensor.
        largest: Largest distance, micrometres on the sensor.
        disagreement: Fraction of rays that only one of both passes.
    """

    zone: tuple[float, float]
    rms: float
    largest: float
    disagreement: float


def write_transfer(lens: TransferLens, file: Path | IO[bytes]) -> None:
    """Write the table of a lens and its prescription, as .npz; iris and focus are not part of it."""
    table = lens.table
    numbers = {name: getattr(table, name) for name in _NUMBERS}
    write_archive(
        file,
        _KIND,
        lens.prescription,
        degree=lens.degree,
        dispersive=lens.dispersive,
        coefficients=table.coefficients,
        **numbers,
    )


def read_transfer(path: str | Path) -> TransferLens:
    """Read a file of :func:`write_transfer`: the lens fully open, focused at infinity.

    Raises:
        LensError: The file is missing or damaged, or contains other data.
    """
    problem = None
    with open_archive(path, _KIND, "lens") as (file, prescription):
        table = TransferTable(
            coefficients=np.asarray(file["coefficients"], float),
            **{name: float(file[name]) for name in _NUMBERS},
        )
        degree, dispersive = int(file["degree"]), bool(file["dispersive"])
    rows = math.comb(degree + 3 + dispersive, degree) if 0 <= degree <= 12 else 0
    shape = table.coefficients.shape
    if len(shape) != 2 or shape[0] < 5 or shape[1] != rows:
        problem = f"coefficients: expected {rows} columns for degree {degree}, got {shape}"
    if problem is None and not all(map(np.isfinite, [table.coefficients.sum(), table.sensor])):
        problem = "coefficients: expected finite numbers"
    if problem is not None:
        raise LensError(f"{path}: {problem}")
    return TransferLens(prescription=prescription, degree=degree, dispersive=dispersive, stored=table)


def transfer_errors(lens: TransferLens) -> list[TransferError]:
    """Return the errors of looked-up rays relative to traced ones at the design wavelength, by zone."""
    fields = {item.name: getattr(lens, item.name) for item in dataclasses.fields(PrescriptionLens)}
    traced = PrescriptionLens(**fields)
    square = np.stack([halton(_RAYS, base) for base in (2, 3, 5, 7)], -1)
    pupil = disc_from_square(square[:, :2])
    depth = min(lens.focus_distance, 1e5)
    errors = []
    for low, high in pairwise(_ZONES):
        radius = np.sqrt(low**2 + (high**2 - low**2) * square[:, 2]) * lens.prescription.image_radius
        angle = 2 * np.pi * square[:, 3]
        place = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
        a, b = (model.sample_rays(place, pupil) for model in (traced, lens))
        assert a.weight is not None
        assert b.weight is not None
        both = (a.weight > 0) & (b.weight > 0)
        difference = (a.origin + depth * a.slope - b.origin - depth * b.slope)[both]
        distance = 1000 * np.linalg.norm(difference, axis=-1) * traced.sensor_distance / depth
        errors.append(
            TransferError(
                zone=(low, high),
                rms=float(np.sqrt((distance**2).mean())) if len(distance) else 0.0,
                largest=float(distance.max(initial=0.0)),
                disagreement=float(((a.weight > 0) != (b.weight > 0)).mean()),
            )
        )
    return errors
