"""Cat's-eye slider that best approximates the vignetting of a lens, and its error.

Both are discs that move over the pupil with the field. A lens has several rims, in front of the stop and
behind it, of different sizes; the slider has one, as large as the pupil, that moves outwards. Two equal
discs that move in opposite directions leave the same lens-shaped aperture as one that moves twice as far, but
centred on the pupil: the blur discs of the slider have the same shape, but are shifted.
"""

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from bokehnet.optics.aberrations.aberration_map import rim_passes
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["nearest_cats_eye"]

_MAX_CATS_EYE, _STEPS = 1.5, 301
_RAYS, _FIELDS = 4096, 16


def nearest_cats_eye(vignetting_apertures: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the slider with the same mean transmission as the lens, and the fraction of area that differs.

    The slider clips as much of the pupil as the rims do, in the mean over the area of the
    picture. The difference is the area that only one of both apertures passes, after alignment of their
    centroids, over the area that the rims pass.

    Args:
        vignetting_apertures: Pairs (shift, radius) of
            :class:`bokehnet.optics.aberrations.aberration_map.AberrationMap`.
    """
    pupil = disc_from_square(np.stack([halton(_RAYS, 2), halton(_RAYS, 3)], -1))
    field = np.sqrt((np.arange(_FIELDS) + 0.5) / _FIELDS)  # equal areas
    sliders = np.linspace(0, _MAX_CATS_EYE, _STEPS)

    def open_fraction(discs: Sequence[tuple[float, float]]) -> float:
        return float(np.mean([_open(pupil, h, discs).mean() for h in field]))

    def closed_by(slider: float) -> float:
        return -open_fraction([(slider, 1.0)])

    target = -open_fraction(vignetting_apertures)
    above = max(1, min(bisect_left(sliders, target, key=closed_by), _STEPS - 1))
    nearest = sliders[above - 1 : above + 1]
    best = float(np.interp(target, [closed_by(slider) for slider in nearest], nearest))
    different_area, total_area = 0.0, 0.0
    for h in field:
        apertures = []
        for discs in (vignetting_apertures, [(best, 1.0)]):
            middle = pupil[_open(pupil, h, discs)].mean(0) if _open(pupil, h, discs).any() else 0.0
            apertures.append(_open(pupil + middle, h, discs))
        different_area, total_area = (
            different_area + float((apertures[0] != apertures[1]).sum()),
            total_area + float(apertures[0].sum()),
        )
    return best, different_area / max(total_area, 1.0)


def _open(pupil: np.ndarray, field: float, discs: Sequence[tuple[float, float]]) -> np.ndarray:
    """Return True for points (N, 2) in the unit disc and in all discs, at a field along the first axis."""
    passes = (pupil**2).sum(-1) <= 1
    for shift, radius in discs:
        passes &= rim_passes(pupil, np.array([field, 0.0]), shift, radius)
    return np.asarray(passes)
