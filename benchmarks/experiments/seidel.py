"""Where third-order theory stops being true: ``python -m benchmarks.experiments.seidel``.

For every lens of the catalog, at several f-numbers and field positions: the size of a spot in the plane of
focus by third-order theory over that of the spot traced through the prescription. Size is the rms distance
from the centroid, at the design wavelength. Spots of which rims other than the stop cut a part are marked,
because theory knows the stop alone. ``--sheet FILE`` draws lights through the sliders in its place, and
``--lamps FILE`` renders those of ``bokehnet demo`` through some.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np

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

# Times the f-number of the open lens, and shares of the way to the corner.
STOPS = (1, 1.4, 2, 2.8, 4, 8)
FIELDS = (0, 0.1, 0.25, 0.5, 0.75, 1)
COUNT = 40000
# Focus, in focal lengths.
FOCUS = 30.0
# Rays are aimed at more than the pupil, because its image wanders and grows off the axis.
WIDER = 1.5

# Sliders of the sheet with their strength in percent; its defocus in half-diagonals; the size of its cells.
SHOWN = {"spherical": 3, "coma": 8, "astigmatism": 4, "field_curvature": 4}
DEFOCUS = (-0.06, 0.0, 0.06)
WIDTH, HEIGHT = 240, 160

# Sliders of the lamps.
LAMPS = ({}, {"spherical": 1.5}, {"spherical": -2}, {"astigmatism": 3}, {"coma": 8}, {"field_curvature": 4})


def pupil_points() -> np.ndarray:
    """Points evenly spread over the unit disc, (COUNT, 2)."""
    points: np.ndarray = disc_from_square(np.stack([halton(COUNT, 2), halton(COUNT, 3)], -1))
    return points


def open_rims(lens: PrescriptionLens) -> PrescriptionLens:
    """Return the lens with glass as wide as rays can meet it; the stop alone cuts."""
    surfaces = tuple(
        row if row.stop else dataclasses.replace(row, semi_diameter=np.inf)
        for row in lens.prescription.surfaces
    )
    prescription = dataclasses.replace(lens.prescription, surfaces=surfaces)
    return dataclasses.replace(lens, prescription=prescription)


def traced_spot(lens: PrescriptionLens, field: float, defocus: float = 0.0) -> np.ndarray:
    """Trace the light of a point to the sensor.

    Args:
        lens: The lens.
        field: Where the point is, share of the way to the corner, to the right.
        defocus: Its signed blur radius by Gaussian optics, half-diagonals.

    Returns:
        Where rays arrive, half-diagonals, (N, 2), right and down.
    """
    corner, picture = lens.prescription.image_radius, lens.sensor_distance
    radius = abs(lens.paraxial.entrance.radius)
    nearness = 1 / lens.focus_distance + defocus * corner / (radius * picture)
    origin = WIDER * radius * pupil_points()
    slope = np.array([field * corner / picture, 0.0]) - nearness * origin
    arrives, passes = lens.trace_to_sensor(Rays(origin=origin, slope=slope))
    spot: np.ndarray = -arrives[passes] / corner
    return spot


def arrive(
    aberration_map: AberrationMap, pupil: np.ndarray, place: np.ndarray, defocus: float = 0.0
) -> np.ndarray:
    """The same by an aberration map, for aperture coordinates (N, 2) and the place (2,)."""
    arrives = np.broadcast_to(place, pupil.shape)
    for _ in range(3):
        transverse_aberration, run, _ = aberration_map(pupil, arrives)
        arrives = place + defocus * run + transverse_aberration
    return arrives


def size(points: np.ndarray) -> float:
    """Rms distance from the centroid."""
    return float(((points - points.mean(0)) ** 2).sum(-1).mean() ** 0.5)


def compare(name: str, stop: float, field: float) -> tuple[float, float]:
    """Ratio of sizes, theory over traced, and the share of light that rims other than the stop cut."""
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
    """Draw a grid of lights that all have one defocus, (HEIGHT, WIDTH); a plain disc of the sheet is grey."""
    half_diagonal = 0.5 * np.hypot(WIDTH, HEIGHT)
    pupil, picture = pupil_points(), np.zeros((HEIGHT, WIDTH))
    for y in (-0.75, 0.0, 0.75):
        for x in (-0.8, -0.4, 0.0, 0.4, 0.8):
            place = np.array([x * WIDTH, y * HEIGHT]) / (2 * half_diagonal)
            arrives = arrive(aberration_map, pupil, place, defocus)
            column, row = (arrives * half_diagonal + (WIDTH / 2, HEIGHT / 2)).T
            picture += np.histogram2d(row, column, (HEIGHT, WIDTH), ((0, HEIGHT), (0, WIDTH)))[0]
    full = COUNT / (np.pi * (half_diagonal * max(DEFOCUS)) ** 2)
    return 0.2 * picture / full


def sheet() -> np.ndarray:
    """A row for each slider, first above 0, then below: behind focus, in focus, in front of focus."""
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
    """Render the lamps of the demo, focused on the leaves, a picture for each of ``LAMPS``, two abreast."""
    image = read_image(ASSETS / "demo.png")
    disparity = read_disparity(ASSETS / "demo_disparity.png")
    cells = []
    for sliders in LAMPS:
        renderer = BokehRenderer(
            "rays", lens_response=LensResponse(aberration_map=AberrationSliders(**sliders).aberration_map())
        )
        found = renderer.render(
            image,
            disparity=disparity,
            blur=BLUR,
            focus=DEMO_FOCUS["near"],
            highlights=Highlights(threshold=0.5),
        )
        cells.append(found.bokeh[:250, :480])
    return np.vstack([np.hstack(cells[i : i + 2]) for i in range(0, len(cells), 2)])


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sheet", type=Path, help="picture to draw in place of the table")
    parser.add_argument("--lamps", type=Path, help="likewise")
    arguments = parser.parse_args()
    if arguments.sheet is not None:
        write_image(arguments.sheet, sheet())
    if arguments.lamps is not None:
        write_image(arguments.lamps, lamps())
    if arguments.sheet is None and arguments.lamps is None:
        print_table()


if __name__ == "__main__":
    main()
