"""Depth of field of a lens."""

import math

from bokehnet.checks import check_above
from bokehnet.lenses.base import LensModel

__all__ = ["depth_of_field"]


def depth_of_field(lens: LensModel, largest_radius: float) -> tuple[float, float]:
    """Return the depths, mm, between which the blur radius on the sensor stays below a limit.

    Blur is linear in inverse depth, so two values determine it: the limits are the intersections with
    ``-largest_radius`` and ``largest_radius``.

    Args:
        lens: Any lens.
        largest_radius: Radius of the circle of confusion that counts as sharp, mm.

    Returns:
        Near and far limit; the far limit is infinite from the hyperfocal distance on.

    Raises:
        ParameterError: ``largest_radius`` is not a number above 0.

    Source:
        Ray, "Applied photographic optics", 2002, 22; the same limits for thin lenses.
    """
    check_above("largest_radius", largest_radius, 0, "mm")
    at_infinity = float(lens.coc_radius(0.0))
    per_disparity = float(lens.coc_radius(1.0)) - at_infinity
    near = per_disparity / (largest_radius - at_infinity)
    if at_infinity >= -largest_radius:
        return near, math.inf
    return near, per_disparity / (-largest_radius - at_infinity)
