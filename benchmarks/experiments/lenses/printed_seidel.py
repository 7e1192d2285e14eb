"""Equations for Seidel bokeh as printed and as corrected.

Run ``python -m benchmarks.experiments.lenses.printed_seidel``.

The equations are those of Marsicano, "Rendering real time depth of field effects", 2023, 3.10, after Asberg
2020 and
Born and Wolf, "Principles of optics", 1999, ch. 5: the system matrix (3.22 to 3.25), the unit of the
aberration vector (3.34) and Seidel's sums (3.36 to 3.41). Catalog lenses are focused at 30 focal lengths;
coefficients are in percent of the half-diagonal of the picture.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from bokehnet.lenses.catalog import catalog_names, load_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.seidel_lens import reduce_lens
from bokehnet.lenses.surface_trace import Surface

__all__ = ["born_and_wolf", "focal_length", "in_half_diagonals", "main"]

FOCUS = 30.0


def focal_length(surfaces: Sequence[Surface], transfer_sign: float = 1.0) -> float:
    """Return the focal length by the system matrix of (n u, y); the printed transfer has the sign -1."""
    system, position, index = np.eye(2), surfaces[0].vertex, 1.0
    for surface in surfaces:
        gap = transfer_sign * (surface.vertex - position) / index
        power = (surface.behind - surface.before) * surface.curvature
        system = np.array([[1, -power], [0, 1]]) @ np.array([[1, 0], [gap, 1]]) @ system
        position, index = surface.vertex, surface.behind
    return -1 / float(system[0, 1])


def born_and_wolf(lens: PrescriptionLens, *, braces: bool = True) -> dict[str, float]:
    """Return Seidel's sums B to F by (3.36) to (3.41), mm.

    Args:
        lens: Lens with spherical surfaces only.
        braces: True if the factor 1/2 applies to both terms of D and E; as printed it applies to the first.
    """
    surfaces = [surface for surface in lens.surfaces if not surface.stop]
    pupil = lens.paraxial.entrance.position - surfaces[0].vertex
    s, t, before = pupil - lens.focus_distance, pupil, 1.0
    h, k = s / (t - s), t * (t - s) / s
    half = 0.5 if braces else 1.0
    sums = dict.fromkeys("BCDEF", 0.0)
    for i, surface in enumerate(surfaces):
        after, curvature = surface.behind, surface.curvature
        abbe = before * (curvature - 1 / s)
        s_image = after / (after * curvature - abbe)
        t_image = after / (after * curvature - before * (curvature - 1 / t))
        step = 1 / (after * s_image) - 1 / (before * s)
        squares = 1 / after**2 - 1 / before**2
        product = h * h * k * abbe
        sums["B"] += 0.5 * h**4 * abbe**2 * step
        sums["C"] += 0.5 * (1 + product) ** 2 * step
        sums["D"] += 0.5 * product * (2 + product) * step - half * abbe * squares
        sums["E"] += 0.5 * k * (1 + product) * (2 + product) * step - half * (1 + product) / h**2 * squares
        sums["F"] += 0.5 * h * h * abbe * (1 + product) * step
        if i + 1 < len(surfaces):
            gap = surfaces[i + 1].vertex - surface.vertex
            s, t = s_image - gap, t_image - gap
            following = s / s_image * h
            k += gap / (after * h * following)
            h, before = following, after
    return sums


def in_half_diagonals(lens: PrescriptionLens, sums: dict[str, float]) -> dict[str, float]:
    """Return sums scaled to the unit circle of the pupil, the corner of the picture and its half-diagonal.

    The printed sums refer to positions in the entrance pupil in mm and field angles from it; an aberration of
    1 in that angle is the magnification times the object distance on the sensor. The field directions are
    opposite.
    """
    corner, radius = lens.prescription.image_radius, abs(lens.paraxial.entrance.radius)
    unit = -lens.sensor_distance / corner
    angle = -1 / unit
    powers = {"B": (3, 0), "F": (2, 1), "C": (1, 2), "D": (1, 2), "E": (0, 3)}
    return {name: unit * radius**pupil * angle**field * sums[name] for name, (pupil, field) in powers.items()}


def main() -> None:
    """Entry of the command line."""
    print("| lens | f, mm | f by 3.23 | D | D as printed | E | E as printed | M' left out of 3.34 |")
    print("|---|---|---|---|---|---|---|---|")
    for name in catalog_names(mirrors=False):
        lens = load_lens(name, focusing="paraxial")
        lens = dataclasses.replace(lens, focus_distance=FOCUS * lens.focal_length)
        corrected, printed = (
            in_half_diagonals(lens, born_and_wolf(lens, braces=braces)) for braces in (True, False)
        )
        result = reduce_lens(lens, wavelengths=[lens.prescription.design_wavelength]).image
        assert math.isclose(corrected["D"], float(result.field_curvature[0]), rel_tol=1e-9)
        magnification = abs(lens.paraxial.exit.radius / lens.paraxial.entrance.radius)
        cells = [
            f"{focal_length(lens.surfaces):.2f}",
            f"{focal_length(lens.surfaces, -1.0):.2f}",
            *(
                f"{100 * value:.3f} %"
                for value in (corrected["D"], printed["D"], corrected["E"], printed["E"])
            ),
            f"{magnification:.3f}",
        ]
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
