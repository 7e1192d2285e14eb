"""How much light a small pupil of even radiance sends to a sensor point, over pi times that radiance."""

from bokehnet.checks import Array

__all__ = ["irradiance_cos4"]


def irradiance_cos4(field: Array, distance: Array, pupil_radius: Array) -> Array:
    """Irradiance by the cos^4 law, for pupils that are small against their distance.

    Args:
        field: Distance of the sensor point from the axis, mm.
        distance: From the exit pupil to the sensor, mm.
        pupil_radius: Radius of the exit pupil, mm.

    Returns:
        ``(R / D)^2 cos^4``, irradiance over pi times the radiance.
    """
    square = distance * distance
    return pupil_radius**2 * square / (field * field + square) ** 2
