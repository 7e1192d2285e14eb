"""Which cat's-eye slider comes nearest to the barrel of a lens, and how near.

Both are discs that move over the pupil with the field. A barrel has several, in front of the stop and behind
it, each with a size of its own; the slider has one, as large as the pupil, that moves outwards. Two equal
discs that move to both sides leave the same lens-shaped opening as one that moves twice as far, but about the
middle of the pupil: the slider's blur discs have the shape of the barrel's, and lie beside them.
"""

from collections.abc import Sequence

import numpy as np

from bokehnet.optics.aberrations.aberration_map import rim_passes
from bokehnet.optics.sampling import disc_from_square, halton

__all__ = ["nearest_cats_eye"]

_LARGEST, _STEPS = 1.5, 301
_RAYS, _FIELDS = 4096, 16


def nearest_cats_eye(vignetting_apertures: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the slider with the light of the barrel over the field, and how much of the shapes differs.

    The slider is the one that cuts as much of the pupil as the barrel does, in the mean over the area of the
    picture. What differs are parts that one of both openings has alone, laid on each other by their middles,
    over what the barrel leaves open.

    Args:
        vignetting_apertures: Pairs (shift, radius) of
            :class:`bokehnet.optics.aberrations.aberration_map.AberrationMap`.
    """
    pupil = disc_from_square(np.stack([halton(_RAYS, 2), halton(_RAYS, 3)], -1))
    field = np.sqrt((np.arange(_FIELDS) + 0.5) / _FIELDS)  # even in area
    sliders = np.linspace(0, _LARGEST, _STEPS)
    left = np.array([np.mean([_open(pupil, h, [(slider, 1.0)]).mean() for h in field]) for slider in sliders])
    wanted = float(np.mean([_open(pupil, h, vignetting_apertures).mean() for h in field]))
    best = float(np.interp(-wanted, -left, sliders))
    apart, whole = 0.0, 0.0
    for h in field:
        both = []
        for discs in (vignetting_apertures, [(best, 1.0)]):
            middle = pupil[_open(pupil, h, discs)].mean(0) if _open(pupil, h, discs).any() else 0.0
            both.append(_open(pupil + middle, h, discs))
        apart, whole = apart + float((both[0] != both[1]).sum()), whole + float(both[0].sum())
    return best, apart / max(whole, 1.0)


def _open(pupil: np.ndarray, field: float, discs: Sequence[tuple[float, float]]) -> np.ndarray:
    """Which points (N, 2) lie in the unit disc and in all discs of a field along the first axis."""
    passes = (pupil**2).sum(-1) <= 1
    for shift, radius in discs:
        passes &= rim_passes(pupil, np.array([field, 0.0]), shift, radius)
    return np.asarray(passes)
