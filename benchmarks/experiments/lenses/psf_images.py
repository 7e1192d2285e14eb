"""Accuracy and cost of the discs of lights: ``python -m benchmarks.experiments.lenses.psf_images``.

Lights are in front of a black wall. The truth is, for single lights, the transmission summed over many points
in each pixel; with a lens, individually traced rays; for merged lights, their pixels drawn individually; and
for clipped discs, rays that end at the screen. PSNR is of linear light, with the level of the disc as peak.
"""

import argparse
from functools import partial
from typing import Any

import numpy as np

from benchmarks.measurement import median_seconds
from bokehnet.classical.highlights.lights import add_lights, separate_lights
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.defocus_bins import occupied_bins, perfect_lens_reach
from bokehnet.io.image import write_image
from bokehnet.optics.aberrations.aberration_map import DESIGN_WAVELENGTH, AberrationMap, term
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aperture import Aperture, transmission

RADII = (3, 10, 30, 100, 300)
SHAPES = {
    "disc": Aperture(),
    "6 blades": Aperture(blades=6, curvature=0.3, rotation=10),
    "ring, bright rim": Aperture(obstruction=0.4, spherical_profile=0.5),
    "onion, grain": Aperture(onion=0.5, grain=0.3),
}


def point(x: float, y: float, defocus: float) -> np.ndarray:
    """Return one light of energy 1."""
    return np.array([[x, y, defocus, 1.0, 1.0, 1.0, 1.0, 1.0]])


def draw(
    lights: np.ndarray, side: int, aperture: Aperture, *, front: np.ndarray | None = None, **options: Any
) -> np.ndarray:
    """Draw lights into a black square; ``front`` is the defocus (H, W) of occluders in front."""
    depths = np.full((side, side), -5000, np.float32) if front is None else front.astype(np.float32)
    cells = np.stack([depths, np.ones_like(depths)], -1)[:, :, None]
    result = np.zeros((side, side, 3), np.float32)
    slices = occupied_bins(cells, lambda defocus: 2 * perfect_lens_reach(defocus) + 0.2 * side)
    add_lights(lights, cells, np.ones((side, side), bool), slices, aperture, result, **options)
    return result


def supersampled(
    x: float, y: float, defocus: float, side: int, aperture: Aperture, samples: int
) -> np.ndarray:
    """Return the fraction of the light on each pixel, from samples^2 points per pixel."""
    inside = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros((side, side))
    u = (np.add.outer(np.arange(side), inside).ravel() - x) / defocus
    for row in range(side):
        v = (row + inside - y) / defocus
        light = transmission(aperture, u[None, :], v[:, None], 1 if defocus > 0 else -1)
        total[row] = light.sum(0).reshape(side, samples).sum(1)
    return np.asarray(total / total.sum())


def traced(
    x: float, y: float, defocus: float, side: int, lens_response: LensResponse, *, edge: float = 1e9
) -> np.ndarray:
    """Return the picture of a light from 2000^2 jittered rays, blocked right of ``edge`` in focus."""
    count = 2000
    rng = np.random.default_rng(0)
    grid = np.stack(np.meshgrid(np.arange(count), np.arange(count)), -1).reshape(-1, 2)
    pupil = (grid + rng.random(grid.shape)) * (2 / count) - 1
    pupil = pupil[(pupil**2).sum(1) <= 1]
    half_diagonal, light = side / 2**0.5, np.array([x, y])
    position, transverse_aberration = light + defocus * pupil, np.zeros_like(pupil)
    for _ in range(6):
        transverse_aberration, run, _ = lens_response.aberration_map(
            pupil, (position - (side - 1) / 2) / half_diagonal, DESIGN_WAVELENGTH
        )
        position = light + defocus * run + half_diagonal * transverse_aberration
    pixel = np.floor(position + 0.5).astype(int)
    visible = (
        (pixel >= 0).all(1)
        & (pixel < side).all(1)
        & ((position - half_diagonal * transverse_aberration)[:, 0] < edge)
    )
    counts = np.bincount(pixel[visible, 1] * side + pixel[visible, 0], minlength=side * side)
    return counts.reshape(side, side) / len(pupil)


def lens(side: int, **transverse_aberrations: float) -> LensResponse:
    """Return a lens with spherical aberration and coma in pixels at the pupil rim and the picture corner."""
    transverse_aberration = np.zeros((1, 2, 20))
    for name, row in (("spherical", 0), ("coma", 1)):
        transverse_aberration[:, row, term(1, 0, 0)] = transverse_aberrations.get(name, 0.0) / (side / 2**0.5)
    aberration_map = AberrationMap(
        wavelengths=np.array([DESIGN_WAVELENGTH]),
        transverse_aberration=transverse_aberration,
        pupil_aberration=np.zeros_like(transverse_aberration),
    )
    return LensResponse(aberration_map=aberration_map)


def compare(name: str, rendered: np.ndarray, truth: np.ndarray, level: float) -> None:
    """Print a row: PSNR, maximum error of a pixel, error of the energy, and correlation."""
    error = rendered - truth
    decibels = -20 * np.log10(max(np.sqrt((error**2).mean()) / level, 1e-12))
    largest, energy = abs(error).max() / level, rendered.sum() / truth.sum() - 1
    correlation = np.corrcoef(rendered.ravel(), truth.ravel())[0, 1]
    print(f"| {name} | {decibels:.1f} dB | {largest:.3f} | {energy:+.1e} | {correlation:.5f} |", flush=True)


def lamps(kind: str, side: int) -> np.ndarray:
    """Return a tilted bright line, a window with a cross, or sparks, on black."""
    image = np.zeros((side, side, 3), np.float32)
    half = 0.04 if kind == "window" else 0.15
    low, high = int((0.5 - half) * side), int((0.5 + half) * side)
    if kind == "line":
        x = np.arange(low, high)
        image[(0.25 * side + x / 2).astype(int), x] = 80
    elif kind == "window":
        image[low:high, low:high] = 50
        image[side // 2 - 1 : side // 2 + 1, low:high] = image[low:high, side // 2 - 1 : side // 2 + 1] = 0
    else:
        rng = np.random.default_rng(1)
        count = (high - low) ** 2 // 10
        image[rng.integers(low, high, count), rng.integers(low, high, count)] = rng.uniform(
            10, 90, (count, 3)
        )
    return image


def merged(kind: str, radius: float, side: int) -> None:
    """Print the differences of merged lights, with and without their widths, from single ones."""
    image, ones = lamps(kind, side), np.ones((side, side, 1), np.float32)
    layers = Layers(colors=image[:, :, None], defocus=np.float32(radius) * ones, coverage=ones)
    rest, lights = separate_lights(layers)
    y, x = np.nonzero(image.max(-1) > rest.colors[:, :, 0].max(-1))
    light = (image - rest.colors[:, :, 0])[y, x]
    single = np.column_stack([x, y, np.full(len(x), radius), light, np.ones((len(x), 2))])
    truth = draw(single, side, Aperture())[..., 0]
    points = lights.copy()
    points[:, 6:] = 1
    for kind_of_lights, merged_lights in (("rectangles", lights), ("points", points)):
        name = f"{kind}, radius {radius:g}, {len(single)} pixels in {len(merged_lights)} {kind_of_lights}"
        compare(name, draw(merged_lights, side, Aperture())[..., 0], truth, truth.max())


def figures() -> None:
    """Print all errors."""
    print("| | PSNR | worst pixel | energy | correlation |\n|---|---|---|---|---|")
    for name, aperture in SHAPES.items():
        for radius in RADII:
            side = 2 * radius + 7
            position = side / 2 + 0.3, side / 2 - 0.2, -float(radius)
            truth = supersampled(*position, side, aperture, min(64, max(8, 3200 // radius)))
            rendered = draw(point(*position), side, aperture)[..., 0]
            compare(f"{name}, radius {radius}", rendered, truth, float(truth.max()))
    for radius in (10, 30, 100):
        side = 5 * radius
        for name, transverse_aberrations in {
            "soap bubble": {"spherical": 0.3 * radius},
            "creamy": {"spherical": -0.5 * radius},
            "coma": {"coma": 0.7 * radius},
        }.items():
            lens_response, position = (
                lens(side, **transverse_aberrations),
                (0.6 * side, 0.62 * side, -float(radius)),
            )
            level = 1 / (np.pi * radius**2)
            rendered = draw(point(*position), side, Aperture(), lens_response=lens_response)[..., 0]
            compare(f"{name}, radius {radius}", rendered, traced(*position, side, lens_response), level)
            front = np.full((side, side), -5000.0)
            front[:, int(0.63 * side) :] = 0.0
            rendered = draw(point(*position), side, Aperture(), front=front, lens_response=lens_response)[
                ..., 0
            ]
            truth = traced(*position, side, lens_response, edge=int(0.63 * side) - 0.5)
            compare(f"{name}, radius {radius}, clipped", rendered, truth, level)
    for kind in ("line", "window", "sparks"):
        for radius in (20.0, 60.0, 120.0):
            merged(kind, radius, 200)


def times() -> None:
    """Print milliseconds per light, for 40 unoccluded lights in 800 x 800 pixels."""
    side, rng = 800, np.random.default_rng(0)
    lenses = {
        "perfect": None,
        "spherical": lens(side, spherical=5.0, coma=3.0),
        "fringes": LensResponse(chromatic_aberration=ChromaticAberration(axial=1.0, lateral=0.5)),
    }
    print("| radius | " + " | ".join(lenses) + " |\n|---|" + "---|" * len(lenses))
    depths = np.full((side, side, 1), -5000, np.float32)
    cells, mask = np.stack([depths, np.ones_like(depths)], -1), np.ones((side, side), bool)
    slices, result = occupied_bins(cells), np.zeros((side, side, 3), np.float32)
    for radius in RADII[:-1]:
        lights = np.repeat(point(0, 0, radius), 40, axis=0)
        lights[:, :2] = rng.uniform(100, side - 100, (40, 2))
        row = []
        for lens_response in lenses.values():
            run = partial(
                add_lights, lights, cells, mask, slices, Aperture(), result, lens_response=lens_response
            )
            run()
            row.append(f"{1e3 * median_seconds(run, 5) / len(lights):.2f}")
        print(f"| {radius} | " + " | ".join(row) + " |", flush=True)


def sheet(path: str) -> None:
    """Write a picture of discs: apertures above, lenses below, clipped by a screen."""
    side, rows = 260, []
    looks: list[list[tuple[Aperture, LensResponse | None]]] = [
        [
            (Aperture(), None),
            (Aperture(blades=6), None),
            (Aperture(spherical_profile=0.7), None),
            (Aperture(onion=0.4), None),
            (Aperture(grain=0.5), None),
        ],
        [
            (Aperture(), lens(side, spherical=20.0)),
            (Aperture(), lens(side, spherical=-30.0)),
            (Aperture(blades=6), lens(side, coma=60.0)),
            (Aperture(cats_eye=0.9), None),
            (
                Aperture(onion=0.3, grain=0.3),
                LensResponse(chromatic_aberration=ChromaticAberration(axial=4.0, lateral=3.0)),
            ),
        ],
    ]
    lights = np.concatenate([point(100.3, 90.1, -62.0), point(175.0, 195.0, -38.0)])
    lights[1, 3:6] = 0.4, 0.3, 0.15
    front = np.full((side, side), -5000.0)
    y, x = np.mgrid[:side, :side]
    front[(x + 2 * y > 545) | (np.hypot(x - 60, y - 70) < 9)] = 0.0
    for row in looks:
        pictures = [
            draw(lights, side, aperture, lens_response=lens_response, front=front)
            for aperture, lens_response in row
        ]
        rows.append(np.concatenate(pictures, axis=1))
    write_image(path, np.clip(6000 * np.concatenate(rows), 0, 1))


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--time", action="store_true", help="print times instead of errors")
    parser.add_argument("--sheet", help="write a picture of discs to this file instead")
    arguments = parser.parse_args()
    if arguments.sheet:
        sheet(arguments.sheet)
    else:
        (times if arguments.time else figures)()


if __name__ == "__main__":
    main()
