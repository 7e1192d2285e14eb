"""Irradiance at a sensor point from a pupil of uniform radiance."""

from bokehnet.checks import Array

__all__ = ["disc_form_factor", "irradiance_cos4"]


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


def disc_form_factor(field: Array, distance: Array, pupil_radius: Array) -> Array:
    """Return the irradiance for pupils of any size; arguments and unit are those of :func:`irradiance_cos4`.

    With S = a^2 + Z^2 + r^2 and q = sqrt(S^2 - 4 r^2 a^2) the form factor ``(1 - (S - 2 r^2) / q) / 2`` loses
    all digits for small pupils. Because q^2 - (S - 2 r^2)^2 = 4 r^2 Z^2, it is
    ``2 r^2 Z^2 / (q (q + S - 2 r^2))``.

    Source:
        Moon and Spencer, "The photic field", 1981, on the form factor of a disc parallel to a patch;
        Marsicano, "Rendering real time depth of field effects", 2023, (3.11).
    """
    r2, z2 = pupil_radius * pupil_radius, distance * distance
    total = field * field + z2 + r2
    root = (total * total - 4 * r2 * field * field) ** 0.5
    return 2 * r2 * z2 / (root * (root + total - 2 * r2))
