"""An oracle for light from a pupil: exact where the package takes the pupil to be small."""


def disc_form_factor(field, distance, pupil_radius):
    """Irradiance, exact for pupils of any size; arguments as of ``irradiance_cos4``.

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
