"""Light through a pupil and through glass: ``python -m benchmarks.experiments.theses.lens_light``.

Thesis 000, (3.11): the form factor of the pupil and the cos^4 law against the integral over the pupil, at
the corner of a full frame. Thesis 001, 2.2.5: light that the glass of catalog lenses absorbs. ``--figures
DIR`` writes both as JSON files.
"""

import math

import numpy as np

from benchmarks.experiments.theses.bokehlab import report
from bokehnet.lenses.aberrations.glass_absorption import absorbed_rays, glass_paths
from bokehnet.lenses.catalog import load_lens
from bokehnet.optics.vignette import disc_form_factor, irradiance_cos4

_COMMAND = "python -m benchmarks.experiments.theses.lens_light --figures docs/figures"

# Exit pupil to sensor, and the corner of a full frame, mm.
_DISTANCE, _CORNER = 50.0, 21.63
_LENSES = ("biconvex", "cooke_triplet", "petzval", "telephoto", "double_gauss", "retrofocus")
# Sensor point beside the axis, mm; internal transmittance of 10 mm of glass.
_FIELD, _TRANSMITTANCE, _RAYS = 15.0, 0.99, 1000


def _integral(field: float, radius: float, steps: int = 800) -> float:
    """Return the integral of cos cos / (pi r^2) over a pupil of a radius, by the midpoint rule."""
    rho = (np.arange(steps) + 0.5)[:, None] * radius / steps
    angle = (np.arange(steps) + 0.5) * 2 * math.pi / steps
    square = (rho * np.cos(angle) - field) ** 2 + (rho * np.sin(angle)) ** 2 + _DISTANCE**2
    area = rho * (radius / steps) * (2 * math.pi / steps)
    return float((_DISTANCE**2 / square**2 * area).sum() / math.pi)


def form_factor() -> dict[str, dict[str, float]]:
    """Return the errors of both formulas against the integral, per cent, by f-number."""
    rows = {}
    for f_number in (0.7, 1.0, 1.4, 2.0, 4.0, 8.0):
        radius = _DISTANCE / (2 * f_number)
        row = {}
        for place, field in (("axis", 0.0), ("corner", _CORNER)):
            exact = _integral(field, radius)
            for name, law in (("cos4", irradiance_cos4), ("form", disc_form_factor)):
                row[f"{name}_{place}"] = abs(100 * (float(law(field, _DISTANCE, radius)) / exact - 1))
        rows[f"f/{f_number:g}"] = row
    return rows


def absorption() -> dict[str, dict[str, float]]:
    """Return lengths in glass, mm, and light lost in it, per cent, on the axis and beside it, by lens."""
    rows = {}
    order = np.arange(_RAYS)
    radius, angle = np.sqrt((order + 0.5) / _RAYS), order * math.pi * (3 - math.sqrt(5))
    uv = np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)  # golden spiral
    for name in _LENSES:
        lens = load_lens(name)
        row = {}
        for place, field in (("axis", 0.0), ("side", _FIELD)):
            rays = lens.sample_rays(np.tile([field, 0.0], (len(uv), 1)), uv)
            path, passes = glass_paths(lens, rays)
            kept = absorbed_rays(lens, rays, _TRANSMITTANCE).weight[passes].sum()
            row[f"path_{place}"] = float(path[passes].mean())
            row[f"lost_{place}"] = 100 * float(1 - kept / rays.weight[passes].sum())
        rows[name] = row
    return rows


_MEASUREMENTS = {
    "marsicano_form_factor": (
        form_factor,
        f"exit pupil {_DISTANCE:g} mm from the sensor, corner at {_CORNER:g} mm; "
        "error in per cent of the integral over the pupil",
        {
            "cos4_axis": ("cos⁴, axis", ".2f"),
            "cos4_corner": ("cos⁴, corner", ".2f"),
            "form_axis": ("form factor, axis", ".4f"),
            "form_corner": ("form factor, corner", ".4f"),
        },
    ),
    "bokehlab_absorption": (
        absorption,
        f"lenses of the catalog, wide open, glass of internal transmittance {_TRANSMITTANCE:g} over 10 mm; "
        f"on the axis and at {_FIELD:g} mm",
        {
            "path_axis": ("mm of glass, axis", ".1f"),
            "path_side": ("mm of glass, side", ".1f"),
            "lost_axis": ("light lost, axis, %", ".2f"),
            "lost_side": ("light lost, side, %", ".2f"),
        },
    ),
}


def main() -> None:
    """Entry of the command line."""
    report(_MEASUREMENTS, _COMMAND, __doc__)


if __name__ == "__main__":
    main()
