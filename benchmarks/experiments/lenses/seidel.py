"""Limits of third-order theory: ``python -m benchmarks.experiments.lenses.seidel``.

Prints for every catalog lens, at several f-numbers and field positions, the size of a spot in the plane of
focus by third-order theory relative to the spot traced through the prescription. Size is the rms distance
from the centroid, at the design wavelength. Spots that rims other than the stop clip are marked, because the
theory includes only the stop. ``--sheet FILE`` instead draws lights with the sliders, and ``--lamps FILE``
renders the lamps of ``bokehnet demo`` with some of them.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from bokehnet.engines.options import RenderOptions
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from bokehnet.lenses.base import Rays
from bokehnet.lenses.catalog import catalog_names, load_lens
from bokehnet.lenses.prescription import PrescriptionLens
from bokehnet.lenses.seidel_lens import seidel_aberration_map
from bokehnet.optics.aberrations.aberration_map import AberrationMap
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.tone import Highlights
from bokehnet.render.renderer import BokehRenderer
from bokehnet.tools.demo import ASSETS, BLUR
from bokehnet.tools.demo import FOCUS as DEMO_FOCUS

# Multiples of the f-number of the open lens, and field positions relative to the corner.
STOPS = (1, 1.4, 2, 2.8, 4, 8)
FIELDS = (0, 0.1, 0.25, 0.5, 0.75, 1)
COUNT = 40000
# Focus distance in focal lengths.
FOCUS = 30.0
# Factor on the pupil radius for aiming rays, because the pupil moves and grows off the axis.
AIM_FACTOR = 1.5

# Sliders of the sheet with their strength in percent; its defocus in half-diagonals; the size of its cells.
SHOWN = {"spherical": 3, "coma": 8, "astigmatism": 4, "field_curvature": 4}
DEFOCUS = (-0.06, 0.0, 0.06)
WIDTH, HEIGHT = 240, 160

# Sliders of the lamps.
LAMPS = ({}, {"spherical": 1.5}, {"spherical": -2}, {"astigmatism": 3}, {"coma": 8}, {"field_curvature": 4})


def pupil_points() -> np.ndarray:
    """Return points evenly distributed over the unit disc, (COUNT, 2)."""
    points: np.ndarray = disc_from_square(np.stack([halton(COUNT, 2), halton(COUNT, 3)], -1))
    return points


def open_rims(lens: PrescriptionLens) -> PrescriptionLens:
    """Return the lens with unlimited glass diameters; only the stop clips."""
    surfaces = tuple(
        row if row.stop else dataclasses.replace(row, semi_diameter=np.inf)
        for row in lens.prescription.surfaces
    )
    prescription = dataclasses.replace(lens.prescription, surfaces=surfaces)
    return dataclasses.replace(lens, prescription=prescription)


def traced_spot(lens: PrescriptionLens, field: float, defocus: float = 0.0) -> np.ndarray:
    """Trace the light of a point to the sensor.

    Args:
        lens: Lens to trace.
        field: Field position of the point relative to the corner, to the right.
        defocus: Its paraxial signed blur radius, half-diagonals.

    Returns:
        Positions of the rays on the sensor, half-diagonals, (N, 2), right and down.
    """
    corner, picture = lens.prescription.image_radius, lens.sensor_distance
    radius = abs(lens.paraxial.entrance.radius)
    nearness = 1 / lens.focus_distance + defocus * corner / (radius * picture)
    origin = AIM_FACTOR * radius * pupil_points()
    slope = np.array([field * corner / picture, 0.0]) - nearness * origin
    arrival, passes = lens.trace_to_sensor(Rays(origin=origin, slope=slope))
    spot: np.ndarray = -arrival[passes] / corner
    return spot


def arrive(
    aberration_map: AberrationMap, pupil: np.ndarray, position: np.ndarray, defocus: float = 0.0
) -> np.ndarray:
    """Return the positions by an aberration map, for pupil coordinates (N, 2) and the field position (2,)."""
    arrival = np.broadcast_to(position, pupil.shape)
    for _ in range(3):
        transverse_aberration, run, _ = aberration_map(pupil, arrival)
        arrival = position + defocus * run + transverse_aberration
    return arrival


def size(points: np.ndarray) -> float:
    """Return the rms distance from the centroid."""
    return float(((points - points.mean(0)) ** 2).sum(-1).mean() ** 0.5)


def compare(name: str, stop: float, field: float) -> tuple[float, float]:
    """Return the ratio of sizes, theory over traced, and the fraction of light that other rims clip."""
    fastest = load_lens(name).min_f_number
    lens = load_lens(name, f_number=None if stop == 1 else stop * fastest, focusing="paraxial")
    lens = dataclasses.replace(lens, focus_distance=FOCUS * lens.focal_length)
    aberration_map = seidel_aberration_map(
        lens, distortion=True, wavelengths=[lens.prescription.design_wavelength]
    )
    uncut, passing = traced_spot(open_rims(lens), field), traced_spot(lens, field)
    theory = arrive(aberration_map, pupil_points(), np.array([field, 0.0]))
    return size(theory) / size(uncut), 1 - len(passing) / len(uncut)


def print_table() -> None:
    """Print the ratios of all lenses, Markdown."""
    heads = " | ".join(
        "middle" if field == 0 else "corner" if field == 1 else f"{field:g}" for field in FIELDS
    )
    print(f"| lens | f-number | {heads} |\n|---|---|{'---|' * len(FIELDS)}")
    for name in catalog_names(mirrors=False):
        for stop in STOPS:
            cells = []
            for field in FIELDS:
                ratio, cut = compare(name, stop, field)
                cells.append(f"{ratio:.2f}{'*' if cut > 0.01 else ''}")
            print(f"| {name} | f/{stop * load_lens(name).min_f_number:.1f} | {' | '.join(cells)} |")


def lights(aberration_map: AberrationMap, defocus: float) -> np.ndarray:
    """Draw a grid of lights of one defocus, (HEIGHT, WIDTH); a plain disc of the sheet is grey."""
    half_diagonal = 0.5 * np.hypot(WIDTH, HEIGHT)
    pupil, picture = pupil_points(), np.zeros((HEIGHT, WIDTH))
    for y in (-0.75, 0.0, 0.75):
        for x in (-0.8, -0.4, 0.0, 0.4, 0.8):
            position = np.array([x * WIDTH, y * HEIGHT]) / (2 * half_diagonal)
            arrival = arrive(aberration_map, pupil, position, defocus)
            column, row = (arrival * half_diagonal + (WIDTH / 2, HEIGHT / 2)).T
            picture += np.histogram2d(row, column, (HEIGHT, WIDTH), ((0, HEIGHT), (0, WIDTH)))[0]
    full = COUNT / (np.pi * (half_diagonal * max(DEFOCUS)) ** 2)
    return 0.2 * picture / full


def sheet() -> np.ndarray:
    """Return a sheet with two rows per slider, positive and negative: behind, in, in front of focus."""
    rows = []
    for name, strength in SHOWN.items():
        cells = [
            np.pad(
                lights(AberrationSliders(**{name: sign * strength}).aberration_map(), defocus),
                1,
                constant_values=0.1,
            )
            for sign in (1, -1)
            for defocus in DEFOCUS
        ]
        rows.append(np.hstack(cells))
    return np.repeat(np.vstack(rows)[..., None], 3, axis=-1)


def lamps() -> np.ndarray:
    """Render the lamps of the demo, focused on the leaves, a picture per entry of ``LAMPS``."""
    image = read_image(ASSETS / "demo.png")
    disparity = read_disparity(ASSETS / "demo_disparity.png")
    cells = []
    for sliders in LAMPS:
        renderer = BokehRenderer(
            "rays", lens_response=LensResponse(aberration_map=AberrationSliders(**sliders).aberration_map())
        )
        result = renderer.render_arrays(
            image,
            disparity=disparity,
            blur=BLUR,
            focus=DEMO_FOCUS["near"],
            options=RenderOptions(highlights=Highlights(threshold=0.5)),
        )
        cells.append(result.bokeh[:250, :480])
    return np.vstack([np.hstack(cells[i : i + 2]) for i in range(0, len(cells), 2)])


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--sheet", type=Path, help="write a picture of lights to this file instead of the table"
    )
    parser.add_argument(
        "--lamps", type=Path, help="write the lamps of the demo to this file instead of the table"
    )
    arguments = parser.parse_args()
    if arguments.sheet is not None:
        write_image(arguments.sheet, sheet())
    if arguments.lamps is not None:
        write_image(arguments.lamps, lamps())
    if arguments.sheet is None and arguments.lamps is None:
        print_table()


if __name__ == "__main__":
    main()
