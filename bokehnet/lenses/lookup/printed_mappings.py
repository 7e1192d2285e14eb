"""Mappings of object depth and wavelength to a profile texture as printed, for comparison.

The texture is traced for one object distance and many image distances. Another object, or another wavelength,
takes the row whose circle of confusion by the thin lens has the same size. Our mapping,
:func:`bokehnet.lenses.lookup.profile_texture.profile_row`, uses principal planes, pupils and traced focus
shifts instead.

Source: Jeong, "Efficient and expressive rendering for real-time defocus blur and bokeh", dissertation, (5.5)
to (5.9), first in Jeong, Baek, Seok, Lee and Lee, "Real-time dynamic bokeh rendering with efficient look-up
table sampling", IEEE Transactions on Visualization and Computer Graphics 2022. (5.8) lacks a constant, see
``docs/method/theses_formulas.md``.
"""

from collections.abc import Sequence

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.surface_trace import Surface

__all__ = ["circle_of_confusion", "equivalent_focus", "image_distance", "printed_row"]


def image_distance(distance: float, focal_length: float) -> float:
    """Return the image distance u(d) of the thin lens (5.5), mm."""
    return distance * focal_length / (distance - focal_length)


def circle_of_confusion(distance: float, focus: float, focal_length: float, lens_radius: float) -> float:
    """Return the radius of the disc on the sensor (5.7), mm; below 0 in front of focus, as printed.

    With a focal length at a wavelength it is (5.8).
    """
    return lens_radius * focal_length / (focus - focal_length) * (distance - focus) / distance


def equivalent_focus(
    distance: float,
    focus: float,
    reference_distance: float,
    focal_length: float,
    lens_radius: float,
    focal_length_at: float | None = None,
) -> float:
    """Return the focus at which the recorded object has the disc of another one: (5.6), or (5.9).

    With c the disc of the other object, ``E F (d_r - d) = c d_r (d - F)`` is linear in the focus d.

    Args:
        distance: Distance of the other object, mm.
        focus: Distance in focus, mm.
        reference_distance: Distance of the recorded object, mm.
        focal_length: Focal length at the recorded wavelength, mm.
        lens_radius: Radius of the lens E, mm.
        focal_length_at: Focal length at the wavelength of the other object; default: the recorded one.
    """
    radius = circle_of_confusion(distance, focus, focal_length_at or focal_length, lens_radius)
    return focal_length * (lens_radius + radius) / (radius + lens_radius * focal_length / reference_distance)


def printed_row(lens: PrescriptionLens, depth: float, wavelength: float, sharpest: float) -> float:
    """Return the plane of a profile texture, mm, of a depth (mm) and a wavelength (nm) by (5.6) to (5.9).

    The recorded object is in focus.

    Args:
        lens: Lens of the texture, focused at a finite distance.
        depth: Depth of the object, mm.
        wavelength: Wavelength, nm.
        sharpest: Plane of the texture that shows the object in focus, mm.
    """
    focal, focus = lens.focal_length, lens.focus_distance
    # (5.8) with its constant: the power of the glass surfaces in contact.
    focal_at = focal * _power_in_contact(lens.surfaces) / _power_in_contact(lens.surfaces_at(wavelength))
    equivalent = equivalent_focus(
        depth, focus, focus, focal, float(lens.thick.pupil_radius), focal_length_at=focal_at
    )
    return sharpest + image_distance(equivalent, focal) - image_distance(focus, focal)


def _power_in_contact(surfaces: Sequence[Surface]) -> float:
    glass = [surface for surface in surfaces if not surface.stop]
    return sum(float(each.curvature) * (float(each.behind) - float(each.before)) for each in glass)
