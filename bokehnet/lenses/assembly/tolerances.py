"""One copy of a lens: its elements stand a little beside where the design has them, as put together.

An element is what is held by one rim: a single lens, a cemented group, a mirror. Each is moved across the
axis and turned about its middle, and the air in front of the next one is a little longer or shorter. The
iris is what they are moved against, and stays.

Draws of a seed do not depend on the limits: a slider from 0 to 1 moves one copy away from the design.
"""

import dataclasses
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bokehnet.checks import check_at_least
from bokehnet.errors import LensError
from bokehnet.lenses.prescription_file import Prescription
from bokehnet.lenses.surface_trace import rotated

__all__ = ["Tolerances", "assembled", "elements"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Tolerances:
    """How far elements stand off at most; every place within is as likely. The defaults are ours.

    Attributes:
        decentre: Of the middle of an element from the axis, mm.
        tilt: Of its axis, degrees.
        spacing: Of each gap of air, longer or shorter, mm.

    Raises:
        ParameterError: One is below 0 or not finite.
    """

    decentre: float = 0.02
    tilt: float = 0.02
    spacing: float = 0.02

    def __post_init__(self) -> None:
        for name in ("decentre", "tilt", "spacing"):
            check_at_least(name, getattr(self, name), 0)

    def __mul__(self, strength: float) -> "Tolerances":
        """The same, so many times as large: the slider."""
        return Tolerances(
            decentre=strength * self.decentre, tilt=strength * self.tilt, spacing=strength * self.spacing
        )


def elements(prescription: Prescription) -> list[tuple[int, ...]]:
    """Rows of each element, from the scene to the sensor; the stop and planes without glass are in none."""
    found: list[tuple[int, ...]] = []
    open_rows: list[int] = []
    for number, row in enumerate(prescription.surfaces):
        glass = row.medium() is not None
        if not row.stop and (open_rows or glass or row.mirror):
            open_rows.append(number)
        if open_rows and not glass:
            found.append(tuple(open_rows))
            open_rows = []
    return found


def assembled(prescription: Prescription, tolerances: Tolerances, seed: int = 0) -> Prescription:
    """Return one copy of a lens; the same for the same seed, and the design itself for limits of 0.

    Args:
        prescription: As designed, every surface on the axis.
        tolerances: Limits.
        seed: Which copy, from 0 up.

    Raises:
        LensError: The lens is such a copy already.
    """
    if not prescription.centred:
        raise LensError(f"{prescription.name}: elements stand off their places already: take the design")
    check_at_least("seed", seed, 0)
    held = elements(prescription)
    rng = np.random.default_rng(seed)
    around = rng.random((len(held), 2, 2))
    # Even over discs: decentre and tilt of each element.
    radius, angle = np.sqrt(around[..., 0]), 2 * np.pi * around[..., 1]
    moves = radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    gaps = rng.uniform(-1, 1, len(held))
    rows = list(prescription.surfaces)
    for members, move in zip(held, moves, strict=True):
        places = np.cumsum([0.0, *(rows[number].thickness for number in members[:-1])])
        middle = 0.5 * float(places[-1])
        tilt = tolerances.tilt * move[1]
        turn = (math.radians(tilt[0]), math.radians(tilt[1]))
        for number, place in zip(members, places, strict=True):
            # Vertices go round the middle of the element.
            x, y, t = rotated((0.0, 0.0, float(place) - middle), turn)
            shift = tolerances.decentre * move[0] + (x, y)
            rows[number] = dataclasses.replace(
                rows[number],
                shift=(float(shift[0]), float(shift[1]), t - (float(place) - middle)),
                tilt=(float(tilt[0]), float(tilt[1])),
            )
    longer = [0.0] * len(rows)
    for (first, second), gap in zip(pairwise(held), gaps, strict=False):
        # The longest part of the way to the next element, which a stop may part.
        way = range(first[-1], second[0])
        widest = max(way, key=lambda number: rows[number].thickness)
        if rows[widest].medium() is None:
            longer[widest] = max(tolerances.spacing * float(gap), -rows[widest].thickness)
    rows = [
        row if not more else dataclasses.replace(row, thickness=row.thickness + more)
        for row, more in zip(rows, longer, strict=True)
    ]
    floating = tuple(
        dataclasses.replace(
            told, thicknesses=tuple(t + more for t, more in zip(told.thicknesses, longer, strict=True))
        )
        for told in prescription.floating
    )
    return dataclasses.replace(prescription, surfaces=tuple(rows), floating=floating)
