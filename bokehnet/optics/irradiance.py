"""How much light a pupil of even radiance sends to a point of the sensor, over pi times that radiance."""

from bokehnet.checks import Array

__all__ = ["disc_form_factor", "irradiance_cos4"]


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


def disc_form_factor(field: Array, distance: Array, pupil_radius: Array) -> Array:
    """Irradiance, exact for pupils of any size; arguments as in :func:`irradiance_cos4`.

    With S = a^2 + Z^2 + r^2 and q = sqrt(S^2 - 4 r^2 a^2) the form factor ``(1 - (S - 2 r^2) / q) / 2`` loses
    all digits for small pupils. Because q^2 - (S - 2 r^2)^2 = 4 r^2 Z^2, it is
    ``2 r^2 Z^2 / (q (q + S - 2 r^2))``.

    Source:
        Moon and Spencer, "The photic field", 1981, on the form factor of a disc parallel to a patch.
    """
    r2, z2 = pupil_radius * pupil_radius, distance * distance
    total = field * field + z2 + r2
    root = (total * total - 4 * r2 * field * field) ** 0.5
    return 2 * r2 * z2 / (root * (root + total - 2 * r2))
