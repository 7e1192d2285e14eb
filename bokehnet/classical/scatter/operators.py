"""Scatter operator of an aperture."""

from functools import lru_cache, partial

import numpy as np

from bokehnet.classical.scatter.pyramid_levels import DISC, ScatterOperator
from bokehnet.optics.aperture import Aperture, transmission

__all__ = ["scatter_operator"]


def _variance(aperture: Aperture) -> float:
    """Return the variance of the aperture along an axis, the mean of both; 1/4 for a disc."""
    axis = (np.arange(512) + 0.5) / 256 - 1
    light = transmission(aperture, axis[None, :], axis[:, None])
    squares = axis[None, :] ** 2 + axis[:, None] ** 2
    return float((light * squares).sum() / light.sum() / 2)


@lru_cache(maxsize=8)
def scatter_operator(aperture: Aperture | None) -> ScatterOperator:
    """Return the operator for :mod:`bokehnet.classical.scatter.pyramid_levels`; None means a disc."""
    if aperture is None or aperture.is_disc:
        return DISC
    from bokehnet.classical.scatter import aperture_scatter  # numba kernels that a disc does not need

    return ScatterOperator(
        forward=partial(aperture_scatter.scatter_forward, aperture=aperture),
        backward=partial(aperture_scatter.scatter_backward, aperture=aperture),
        variance=_variance(aperture),
    )
