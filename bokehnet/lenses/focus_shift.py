"""Where a lens with spherical aberration is sharpest: not where Gaussian optics focuses it.

Rays through the zones of the opening cross the axis at different places. A photographer, or a camera that
measures sharpness, focuses at the working aperture and settles where the whole blur is least.
"""

from collections.abc import Sequence

import numpy as np

from bokehnet.errors import LensError
from bokehnet.lenses.surface_trace import Surface, beam_between, trace
from bokehnet.optics.paraxial import Pupil

__all__ = ["focus_shift"]

# Zones of the entrance pupil, even in area, up to this share of its paraxial radius: real ones are larger.
_ZONES, _WIDEST = 2048, 1.5


def focus_shift(
    surfaces: Sequence[Surface], entrance: Pupil, focus_distance: float, gaussian_focus: float
) -> float:
    """Return how far behind the Gaussian focus the blur of a point on the axis is least, mm.

    Rays that a point in the focus distance sends evenly into the entrance pupil cross a plane at t behind
    the Gaussian focus at heights ``x + m t``; ``t = -sum(x m) / sum(m m)`` makes their squares least.

    Args:
        surfaces: The lens, its iris as it is set.
        entrance: Its entrance pupil.
        focus_distance: From there to the point, mm; may be infinite.
        gaussian_focus: Place of its Gaussian image, mm behind the first surface.

    Raises:
        LensError: No ray passes.

    Source:
        Welford, "Aberrations of optical systems", 1986, 6.3: two thirds of the way to the focus of the rim
        for primary spherical aberration; the sums take every order.
    """
    height = _WIDEST * abs(entrance.radius) * np.sqrt((np.arange(_ZONES) + 0.5) / _ZONES)
    slope = -height / focus_distance
    nothing = np.zeros_like(height)
    first = min(surfaces[0].vertex, entrance.position) - 1.0  # in front of the glass
    start = height + (entrance.position - first) * slope
    beam = trace(surfaces, beam_between((start + slope, nothing, first - 1.0), (start, nothing, first)))
    passes = beam.passes
    if not passes.any():
        raise LensError("no ray passes from the point in focus")
    (x, _), (dx, _, dt) = beam.at(gaussian_focus), beam.direction
    x, m = x[passes], (dx / dt)[passes]
    return -float((x * m).sum() / (m * m).sum())
