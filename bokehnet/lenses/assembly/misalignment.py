"""What a copy of a lens does that its design does not: its picture moves, its focus leans, one side blurs.

Measured by rays through the glass, at the middle of the picture and around it.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.optics.sampling import ring_points

__all__ = ["Misalignment", "focus_lean", "misalignment"]

# Places around the middle, at this share of the picture's radius, and rings of rays of each.
_AROUND, _SHARE, _RINGS = 8, 0.7, 18
# Radius of the searched part of the entrance pupil, in its Gaussian one: real ones are larger.
_WIDEST = 1.5


@dataclass(frozen=True, kw_only=True, slots=True)
class Misalignment:
    """What was measured, in the orientation of the picture: right and down.

    Attributes:
        moved: How far the picture's middle is moved on the sensor, mm.
        lean: As :func:`focus_lean`.
        coma: Of a point on the axis: how far the rim's circle lies from the middle ray, mm. A centred lens
            has none there.
        spot: Root mean square blur of a point in focus in the middle, mm.
        spots: The same at 0.7 of the picture's radius: right, and on by eighths of a turn downwards.
    """

    moved: tuple[float, float]
    lean: tuple[float, float]
    coma: tuple[float, float]
    spot: float
    spots: tuple[float, ...]


def misalignment(lens: PrescriptionLens) -> Misalignment:
    """Measure a copy, as it is focused and stopped down.

    :mod:`bokehnet.lenses.assembly.tolerances` makes copies.

    Raises:
        LensError: No light of a point in focus gets through.
    """
    # Where the scene's axis is seen, by the rays through the middle of the stop.
    seen = -_middle_of_picture(lens)
    pupil, around = _spot(lens, np.zeros(2))
    spots = [_rms(_spot(lens, place)[1]) for place in _places(lens)]
    return Misalignment(
        moved=(float(seen[0]), float(seen[1])),
        lean=focus_lean(lens),
        coma=_coma(pupil, around),
        spot=_rms(around),
        spots=tuple(spots),
    )


def focus_lean(lens: PrescriptionLens) -> tuple[float, float]:
    """How the focus of a copy leans: signed blur per length of the picture, to the right and down.

    A point in the plane of focus at p from the middle of the picture has the signed blur radius ``lean . p``,
    beside what the field curvature of a centred lens gives it, which is the same on both sides. Above 0 it is
    blurred as if it were too near: the focus is farther away there. 0 for a centred lens.

    Raises:
        LensError: No light of a point in focus gets through.
    """
    if lens.prescription.centred:
        return 0.0, 0.0
    places = _places(lens)
    blur = []
    for place in places:
        pupil, around = _spot(lens, place)
        away = pupil - pupil.mean(0)
        blur.append(float((around * away).sum() / (away * away).sum()))
    # Places are even around the middle: what is the same for all of them falls out.
    lean = 2 * (np.array(blur)[:, None] * places).mean(0) / float((places[0] ** 2).sum())
    return float(lean[0]), float(lean[1])


def _places(lens: PrescriptionLens) -> np.ndarray:
    angle = 2 * np.pi * np.arange(_AROUND) / _AROUND
    radius = _SHARE * lens.prescription.image_radius
    return radius * np.stack([np.cos(angle), np.sin(angle)], -1)


def _spot(lens: PrescriptionLens, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Aperture coordinates of the rays seen at ``place``, and how far they arrive from their middle, mm."""
    middle = chief_rays(lens, place)
    disc = ring_points(_RINGS)
    away = _WIDEST * lens.thick.pupil_radius * disc
    rays = Rays(origin=middle.origin + away, slope=middle.slope - away / lens.focus_distance)
    reached, passes = lens.trace_to_sensor(rays)
    if not passes.any():
        raise LensError(f"{lens.prescription.name}: no light of a point in focus gets through")
    arrived = -reached[passes]
    return -_WIDEST * disc[passes], arrived - arrived.mean(0)


def _rms(around: np.ndarray) -> float:
    return float(np.sqrt((around**2).sum(-1).mean()))


def _coma(pupil: np.ndarray, around: np.ndarray) -> tuple[float, float]:
    """Third order is ``c (a.a) + 2 (c.a) a``; the circle of the rim lies 2 c from the middle ray."""
    square = (pupil**2).sum(-1)
    columns = []
    for axis in np.eye(2):
        along = pupil @ axis
        columns.append(square[:, None] * axis + 2 * along[:, None] * pupil)
    basis = [
        np.concatenate([np.ones(len(pupil)), np.zeros(len(pupil))]),
        np.concatenate([np.zeros(len(pupil)), np.ones(len(pupil))]),
        pupil.T.ravel(),
        (square[:, None] * pupil).T.ravel(),
        np.concatenate([pupil[:, 0], -pupil[:, 1]]),
        np.concatenate([pupil[:, 1], pupil[:, 0]]),
        *(column.T.ravel() for column in columns),
    ]
    found = np.linalg.lstsq(np.stack(basis, -1), around.T.ravel(), rcond=None)[0]
    return 2 * float(found[-2]), 2 * float(found[-1])


def _middle_of_picture(lens: PrescriptionLens) -> np.ndarray:
    """Where the ray along the scene's axis through the middle of the stop meets the sensor, mm."""
    middle = chief_rays(lens, np.zeros(2))
    # Small angles: the picture's place per unit of slope is the sensor's distance.
    seen = lens.sensor_distance * (middle.slope + middle.origin / lens.focus_distance)
    return np.asarray(seen)
