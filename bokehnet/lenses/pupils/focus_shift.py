"""Focus shift: distance from the paraxial focus to the sharpest focus of a lens with spherical aberration.

Rays through different zones of the aperture cross the axis at different distances. A photographer, or a
contrast autofocus, focuses at the working aperture and minimizes the total blur.
"""

from collections.abc import Sequence

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.surface_trace import Surface, beam_between, trace
from bokehnet.optics.paraxial import Pupil

__all__ = ["focus_shift"]

# Number of zones of equal area of the entrance pupil, and their outer radius over the paraxial radius; real
# pupils can be larger than paraxial ones.
_ZONES, _MAX_RADIUS = 2048, 1.5


def focus_shift(
    surfaces: Sequence[Surface], entrance: Pupil, focus_distance: float, gaussian_focus: float
) -> float:
    """Return the signed distance from the Gaussian focus to the least axial blur, mm, positive behind.

    Rays from a point at the focus distance, uniform over the entrance pupil, cross a plane at t behind
    the Gaussian focus at heights ``x + m t``; ``t = -sum(x m) / sum(m m)`` minimizes the sum of their
    squares.

    Args:
        surfaces: Surfaces of the lens, with the iris as set.
        entrance: Entrance pupil.
        focus_distance: Distance from the entrance pupil to the point, mm; may be infinite.
        gaussian_focus: Position of its Gaussian image, mm behind the first surface.

    Raises:
        LensError: No ray passes.

    Source:
        Welford, "Aberrations of optical systems", 1986, 6.3: two thirds of the way to the focus of the rim
        for primary spherical aberration; the sums include all orders.
    """
    height = _MAX_RADIUS * abs(entrance.radius) * np.sqrt((np.arange(_ZONES) + 0.5) / _ZONES)
    slope = -height / focus_distance
    zeros = np.zeros_like(height)
    first = min(surfaces[0].vertex, entrance.position) - 1.0  # in front of the glass
    start = height + (entrance.position - first) * slope
    beam = trace(surfaces, beam_between((start + slope, zeros, first - 1.0), (start, zeros, first)))
    passes = beam.passes
    if not passes.any():
        raise LensError("no ray passes from the point in focus")
    (x, _), (dx, _, dt) = beam.at(gaussian_focus), beam.direction
    x, m = x[passes], (dx / dt)[passes]
    return -float((x * m).sum() / (m * m).sum())
