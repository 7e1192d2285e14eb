"""Effects of the misalignment of a copy of a lens: image shift, focus tilt, and asymmetric blur.

Measured by rays through the glass, at the centre of the picture and around it.
"""

from dataclasses import dataclass

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.base import Rays
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.stop_rays import chief_rays
from bokehnet.optics.sampling import ring_points

__all__ = ["Misalignment", "focus_tilt", "misalignment"]

# Number of positions around the centre, their relative image height, and number of rings of rays of each.
_POSITIONS, _IMAGE_HEIGHT, _RINGS = 8, 0.7, 18
# Radius of the sampled entrance pupil over the paraxial radius; real pupils can be larger.
_MAX_RADIUS = 1.5


@dataclass(frozen=True, kw_only=True, slots=True)
class Misalignment:
    """Measured misalignment, in the orientation of the picture: right and down.

    Attributes:
        image_shift: Shift of the picture centre on the sensor, mm.
        focus_tilt: As :func:`focus_tilt`.
        coma: Coma of a point on the axis: distance of the circle of rim rays from the chief ray, mm. 0 for a
            centred lens.
        spot: Root mean square blur of a point in focus at the centre, mm.
        spots: Root mean square blur at 0.7 of the image radius, mm: right, then in steps of an eighth of a
            turn, clockwise as seen.
    """

    image_shift: tuple[float, float]
    focus_tilt: tuple[float, float]
    coma: tuple[float, float]
    spot: float
    spots: tuple[float, ...]


def misalignment(lens: PrescriptionLens) -> Misalignment:
    """Return the misalignment of a copy, with focus and iris as set.

    :mod:`bokehnet.lenses.assembly.tolerances` makes copies.

    Raises:
        LensError: No light of a point in focus passes.
    """
    # Position of the axis of the scene in the picture, by chief rays.
    shift = -_middle_of_picture(lens)
    pupil, spot = _spot(lens, np.zeros(2))
    spots = [_rms(_spot(lens, place)[1]) for place in _places(lens)]
    return Misalignment(
        image_shift=(float(shift[0]), float(shift[1])),
        focus_tilt=focus_tilt(lens),
        coma=_coma(pupil, spot),
        spot=_rms(spot),
        spots=tuple(spots),
    )


def focus_tilt(lens: PrescriptionLens) -> tuple[float, float]:
    """Return the focus tilt of a copy: signed blur per length of the picture, to the right and down.

    A point in the plane of focus at p from the centre of the picture has the signed blur radius
    ``focus_tilt . p``, in addition to the field curvature of a centred lens, which is the same on both sides.
    Above 0 it is blurred as if it were too near: the focus is farther away. 0 for a centred lens.

    Raises:
        LensError: No light of a point in focus passes.
    """
    if lens.prescription.centred:
        return 0.0, 0.0
    places = _places(lens)
    blur = []
    for place in places:
        pupil, spot = _spot(lens, place)
        offset = pupil - pupil.mean(0)
        blur.append(float((spot * offset).sum() / (offset * offset).sum()))
    # Positions are evenly spaced around the centre: symmetric terms cancel.
    tilt = 2 * (np.array(blur)[:, None] * places).mean(0) / float((places[0] ** 2).sum())
    return float(tilt[0]), float(tilt[1])


def _places(lens: PrescriptionLens) -> np.ndarray:
    angle = 2 * np.pi * np.arange(_POSITIONS) / _POSITIONS
    radius = _IMAGE_HEIGHT * lens.prescription.image_radius
    return radius * np.stack([np.cos(angle), np.sin(angle)], -1)


def _spot(lens: PrescriptionLens, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return aperture coordinates of the rays seen at ``place``, and offsets from their centroid, mm."""
    middle = chief_rays(lens, place)
    disc = ring_points(_RINGS)
    offset = _MAX_RADIUS * lens.thick.pupil_radius * disc
    rays = Rays(origin=middle.origin + offset, slope=middle.slope - offset / lens.focus_distance)
    arrival, passes = lens.trace_to_sensor(rays)
    if not passes.any():
        raise LensError(f"{lens.prescription.name}: no light of a point in focus gets through")
    points = -arrival[passes]
    return -_MAX_RADIUS * disc[passes], points - points.mean(0)


def _rms(spot: np.ndarray) -> float:
    return float(np.sqrt((spot**2).sum(-1).mean()))


def _coma(pupil: np.ndarray, spot: np.ndarray) -> tuple[float, float]:
    """Return twice the fitted c of ``c (a.a) + 2 (c.a) a``: the offset of the circle of rim rays."""
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
    coefficients = np.linalg.lstsq(np.stack(basis, -1), spot.T.ravel(), rcond=None)[0]
    return 2 * float(coefficients[-2]), 2 * float(coefficients[-1])


def _middle_of_picture(lens: PrescriptionLens) -> np.ndarray:
    """Return the sensor position of the chief ray along the axis of the scene, mm."""
    middle = chief_rays(lens, np.zeros(2))
    # Small angles: the position in the picture per unit of slope is the sensor distance.
    return np.asarray(lens.sensor_distance * (middle.slope + middle.origin / lens.focus_distance))
