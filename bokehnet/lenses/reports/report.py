"""Text report of a lens: cardinal points, pupils, light and depth of field."""

import dataclasses
import math

from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.pupils.paraxial_lens import traced_focal_length, traced_pupils
from bokehnet.lenses.reports.depth_of_field import depth_of_field
from bokehnet.lenses.reports.plot import sharp_radius
from bokehnet.lenses.reports.unvignetted_fraction import unvignetted_fraction

__all__ = ["describe_lens"]


def describe_lens(lens: PrescriptionLens) -> dict[str, str]:
    """Return label and text of each line of a report; positions are mm behind the first surface.

    Examples:
        >>> from bokehnet.lenses.catalog import load_lens
        >>> describe_lens(load_lens("double_gauss"))["f-number"].startswith("2")
        True
    """
    paraxial, cardinal, design = lens.paraxial, lens.paraxial.cardinal, lens.prescription
    traced = traced_focal_length(lens.surfaces, 0.05 * abs(paraxial.entrance.radius))
    pupils = {}
    for label, by_matrix, by_ray in zip(
        ("entrance pupil", "exit pupil"),
        (paraxial.entrance, paraxial.exit),
        traced_pupils(lens.surfaces, zone=0.1),
        strict=True,
    ):
        pupils[label] = (
            f"at {by_matrix.position:.3f} mm, radius {abs(by_matrix.radius):.3f} mm by imaging; "
            f"{by_ray.position:.3f}, {abs(by_ray.radius):.3f} by rays"
        )
    limit = sharp_radius(lens)
    near, far = (_metres(depth) for depth in depth_of_field(lens, limit))
    exit_only = dataclasses.replace(lens, pupil_sampling="exit")
    percentages = [
        f"{100 * unvignetted_fraction(sampled_lens, field * design.image_radius):.0f}"
        for sampled_lens in (exit_only, lens)
        for field in (0.0, 0.7, 1.0)
    ]
    return {
        "source": design.source,
        "focal length": f"{lens.focal_length:.3f} mm by matrix, {traced:.3f} mm traced; "
        f"published {design.focal_length:.4g}",
        "f-number": f"{lens.thick.f_number:.3f} paraxial, {lens.working_f_number:.3f} working; "
        f"fully open {lens.min_f_number:.3f} paraxial, published {design.f_number:.4g}",
        "principal planes": f"at {cardinal.front_principal:.3f} and {cardinal.rear_principal:.3f} mm",
        "focal points": f"at {cardinal.front_focus:.3f} and {cardinal.rear_focus:.3f} mm",
        **pupils,
        "back focal distance": f"{cardinal.rear_focus - paraxial.length:.3f} mm",
        "focus": f"{_metres(lens.focus_distance)} from the entrance pupil, "
        f"sensor at {lens.sensor_position:.3f} mm, "
        f"travel {lens.sensor_position - cardinal.rear_focus:.3f} mm",
        "depth of field": f"{near} to {far} for a blur radius of {limit:.4f} mm",
        "rays that pass": f"{'/'.join(percentages[:3])} % aimed at the exit pupil, "
        f"{'/'.join(percentages[3:])} % at the effective pupil "
        f"(centre/0.7/edge of {design.image_radius:g} mm)",
    }


def _metres(depth: float) -> str:
    return "infinity" if math.isinf(depth) else f"{depth / 1000:.4g} m"
