"""Irradiance at a sensor point from a small pupil of uniform radiance."""

from bokehnet.checks import Array

__all__ = ["irradiance_cos4"]


def irradiance_cos4(field: Array, distance: Array, pupil_radius: Array) -> Array:
    """Return the irradiance by the cos^4 law, for pupils that are small compared with their distance.

    Args:
        field: Distance of the sensor point from the axis, mm.
        distance: Distance from the exit pupil to the sensor, mm.
        pupil_radius: Radius of the exit pupil, mm.

    Returns:
        ``(R / D)^2 cos^4``, the irradiance divided by pi times the radiance.
    """
    square = distance * distance
    return pupil_radius**2 * square / (field * field + square) ** 2
