"""Numeric data of a lens: first order, illumination, spots, distortion, third order by surface."""

import math
from typing import Any

import numpy as np

from bokehnet.lenses.aberrations.aberration_fit import fit_aberration_map
from bokehnet.lenses.aberrations.relative_illumination import relative_illumination
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.reports.cats_eye import nearest_cats_eye
from bokehnet.lenses.reports.plot import spot
from bokehnet.lenses.seidel_lens import seidel_by_surface
from bokehnet.lenses.stop_rays import chief_rays

__all__ = ["FIELDS", "distortion", "lens_facts"]

# Reported fields, fractions of the image radius.
FIELDS = (0.0, 0.7, 1.0)


def lens_facts(lens: PrescriptionLens) -> dict[str, Any]:
    """Return numeric data of a lens with focus and iris as set; lengths in mm, angles in degrees.

    Infinite numbers are None, so that the result is valid JSON.
    """
    paraxial, design = lens.paraxial, lens.prescription
    radius = design.image_radius
    light = relative_illumination(lens, radius, steps=21)
    steps = np.linspace(0, 1, 21)
    barrel = fit_aberration_map(lens, wavelengths=()).vignetting_apertures
    slider, shape_error = nearest_cats_eye(barrel)
    fields = []
    for field in FIELDS:
        points = spot(lens, field * radius, design.design_wavelength)
        centred_points = points - points.mean(0) if len(points) else points
        fields.append(
            {
                "image_height": field * radius,
                "spot_rms": _finite(np.sqrt((centred_points**2).sum(1).mean()) if len(points) else math.nan),
                "relative_illumination": float(np.interp(field, steps, light)),
                "distortion": float(distortion(lens, np.array([field]))[0]),
            }
        )
    return {
        "name": design.name,
        "source": design.source,
        "focal_length": lens.focal_length,
        "published_focal_length": design.focal_length,
        "f_number": lens.thick.f_number,
        "working_f_number": lens.working_f_number,
        "fully_open_f_number": lens.min_f_number,
        "published_f_number": design.f_number,
        "back_focus": float(paraxial.cardinal.rear_focus - paraxial.length),
        "length": float(paraxial.length),
        "entrance_pupil": {
            "position": float(paraxial.entrance.position),
            "radius": abs(float(paraxial.entrance.radius)),
        },
        "exit_pupil": {
            "position": float(paraxial.exit.position),
            "radius": abs(float(paraxial.exit.radius)),
        },
        "half_angle": math.degrees(math.atan(radius / lens.sensor_distance)),
        "image_radius": radius,
        "wavelength": design.design_wavelength,
        "focus_distance": _finite(lens.focus_distance),
        "focus_shift": lens.focus_shift,
        "sensor_position": lens.sensor_position,
        "cats_eye": {"slider": slider, "shape_differs": shape_error},
        "fields": fields,
        "seidel": [
            {"surface": number, **{name: float(value) for name, value in sums.items()}}
            for number, sums in seidel_by_surface(lens)
        ],
    }


def distortion(lens: PrescriptionLens, field: np.ndarray) -> np.ndarray:
    """Return the relative enlargement of the picture over an ideal one at fractions of its radius, (N,).

    The enlargement is that of the chief ray; 0 at the centre.
    """
    radius = np.maximum(field, 1e-3) * lens.prescription.image_radius
    rays = chief_rays(lens, np.stack([radius, 0 * radius], -1))
    ideal_radius = lens.sensor_distance * (rays.slope + rays.origin / lens.focus_distance)[:, 0]
    return np.where(field > 1e-3, radius / ideal_radius - 1, 0.0)


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
