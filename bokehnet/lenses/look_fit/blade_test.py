"""Whether a picture tells blades, or whether a shape with blades only hides what else a model lacks."""

import math

import numpy as np

__all__ = ["blades_are_told"]

# Of what blades gain on a round opening, this share must be lost when they are turned by half a blade.
_SHARE = 0.5
# Deviations that the loss must lie above 0, so that of 20 shapes and turns that are tried for a round opening
# one passes in a thousand pictures: the normal distribution beyond it is 5e-5.
_SURE = 3.9


def blades_are_told(best: np.ndarray, turned: np.ndarray, gain: float, blocks: np.ndarray) -> bool:
    """Say whether blades are seen by their direction.

    A shape with blades has more to adjust than a round one, and takes up faults that have no direction: edges
    that are softer, discs that are smaller than the model has them. Turned by half a blade it takes up just
    as much of these; what blades leave in a picture, it leaves twice. So the fit is compared with itself,
    turned: what has no direction falls out.

    Args:
        best: Squared residuals of the best shape with blades, (N,).
        turned: The same turned by half the angle from blade to blade, (N,).
        gain: By how much less the best shape leaves, in sum, than the best round one.
        blocks: Which block each residual belongs to, (N,), from 0 up; pixels of one block hang together.

    Source:
        Vuong, "Likelihood ratio tests for model selection and non-nested hypotheses", Econometrica 1989, for
        the test of two models with as many parameters; sums of blocks in place of single pixels, and the
        turned shape as the other model, are ours.
    """
    lost = np.bincount(blocks, turned - best)[np.unique(blocks)]
    total, count = float(lost.sum()), len(lost)
    if count < 2 or total < _SHARE * gain:
        return False
    spread = float(lost.std(ddof=1)) * math.sqrt(count)
    return total > _SURE * spread
