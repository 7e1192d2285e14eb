"""Random copies of a lens within manufacturing tolerances: decentred and tilted elements, changed gaps.

An element is a rigid part in one mount: a single lens, a cemented group, a mirror. Each is shifted
across the axis and tilted about its centre, and the air gap behind it is changed. The
iris is the reference and stays fixed.

Random draws of a seed do not depend on the limits: a slider from 0 to 1 moves one copy away from the design.
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

__all__ = ["Tolerances", "assemble_copy", "elements"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Tolerances:
    """Largest errors of elements, uniformly distributed. The defaults are our own.

    Attributes:
        decentre: Distance of the centre of an element from the axis, mm.
        tilt: Tilt of its axis, degrees.
        spacing: Change of each air gap, mm.

    Raises:
        ParameterError: A tolerance is below 0 or not finite.
    """

    decentre: float = 0.02
    tilt: float = 0.02
    spacing: float = 0.02

    def __post_init__(self) -> None:
        for name in ("decentre", "tilt", "spacing"):
            check_at_least(name, getattr(self, name), 0)

    def __mul__(self, strength: float) -> "Tolerances":
        """Return the tolerances multiplied by ``strength``."""
        return Tolerances(
            decentre=strength * self.decentre, tilt=strength * self.tilt, spacing=strength * self.spacing
        )


def elements(prescription: Prescription) -> list[tuple[int, ...]]:
    """Return the rows of each element, from the scene to the sensor, without stop and dummy planes."""
    groups: list[tuple[int, ...]] = []
    open_rows: list[int] = []
    for number, row in enumerate(prescription.surfaces):
        glass = row.medium() is not None
        if not row.stop and (open_rows or glass or row.mirror):
            open_rows.append(number)
        if open_rows and not glass:
            groups.append(tuple(open_rows))
            open_rows = []
    return groups


def assemble_copy(prescription: Prescription, tolerances: Tolerances, seed: int = 0) -> Prescription:
    """Return one copy of a lens, determined by the seed; limits of 0 return the design itself.

    Args:
        prescription: Design, with every surface on the axis.
        tolerances: Limits.
        seed: Seed of the copy, >= 0.

    Raises:
        LensError: The lens is not a design but a copy already.
    """
    if not prescription.centred:
        raise LensError(
            f"{prescription.name}: expected a centred design, found a copy with decentred elements; "
            f"pass the design"
        )
    check_at_least("seed", seed, 0)
    groups = elements(prescription)
    rng = np.random.default_rng(seed)
    random_polar = rng.random((len(groups), 2, 2))
    # Uniform over discs: decentre and tilt of each element.
    radius, angle = np.sqrt(random_polar[..., 0]), 2 * np.pi * random_polar[..., 1]
    moves = radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    gaps = rng.uniform(-1, 1, len(groups))
    rows = list(prescription.surfaces)
    for members, move in zip(groups, moves, strict=True):
        places = np.cumsum([0.0, *(rows[number].thickness for number in members[:-1])])
        middle = 0.5 * float(places[-1])
        tilt = tolerances.tilt * move[1]
        rotation = (math.radians(tilt[0]), math.radians(tilt[1]))
        for number, place in zip(members, places, strict=True):
            # Vertices rotate about the centre of the element.
            x, y, t = rotated((0.0, 0.0, float(place) - middle), rotation)
            shift = tolerances.decentre * move[0] + (x, y)
            rows[number] = dataclasses.replace(
                rows[number],
                shift=(float(shift[0]), float(shift[1]), t - (float(place) - middle)),
                tilt=(float(tilt[0]), float(tilt[1])),
            )
    changes = [0.0] * len(rows)
    for (first, second), gap in zip(pairwise(groups), gaps, strict=False):
        # The longest gap before the next element; a stop may divide it.
        gap_rows = range(first[-1], second[0])
        widest = max(gap_rows, key=lambda number: rows[number].thickness)
        if rows[widest].medium() is None:
            changes[widest] = max(tolerances.spacing * float(gap), -rows[widest].thickness)
    rows = [
        row if not change else dataclasses.replace(row, thickness=row.thickness + change)
        for row, change in zip(rows, changes, strict=True)
    ]
    floating = tuple(
        dataclasses.replace(
            row, thicknesses=tuple(t + change for t, change in zip(row.thicknesses, changes, strict=True))
        )
        for row in prescription.floating
    )
    return dataclasses.replace(prescription, surfaces=tuple(rows), floating=floating)
