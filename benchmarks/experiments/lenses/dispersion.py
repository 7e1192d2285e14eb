"""Colour fringes: pictures, cost, noise, and comparison with traced glass.

Run ``python -m benchmarks.experiments.lenses.dispersion``.

Renders three pictures with the rays: a tilted black and white chart from in front of focus on the left to
    behind focus on the right, a night scene with lamps, and the scene of ``bokehnet demo``. Prints the cost
    of fringes relative to a lens without, in alternation, and the difference of two seeds; the ray-traced
    lateral colour of the catalog lenses compared with the two sliders; and the noise of wavelength sampling.
"""

import argparse
import statistics
from collections.abc import Callable
from pathlib import Path

import numpy as np

import bokehnet
from benchmarks.measurement import time_in_turns
from bokehnet.classical.rays_renderer import rays
from bokehnet.io.maps import read_disparity
from bokehnet.lenses import PrescriptionLens, catalog_names
from bokehnet.lenses.catalog import find_prescription
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration, achromat_curve, glass_curve
from bokehnet.optics.aberrations.field_maps import make_field_map
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from bokehnet.tools.contact_sheet import contact_sheet
from bokehnet.tools.demo import ASSETS, BLUR, FOCUS

RECIPROCAL = make_field_map("inversion,reciprocal")
SECTORS = make_field_map("square,angular:2")
EQUALISER = (4.0, 0.2, 0.2, 4.0, 0.2, 0.2, 4.0)

CHARACTERS = {
    "no fringes": None,
    "rgb": LensResponse(
        chromatic_aberration=ChromaticAberration(axial=2, lateral=2),
        wavelength_sampling=WavelengthSampling(dispersion="rgb"),
    ),
    "continuous": LensResponse(chromatic_aberration=ChromaticAberration(axial=2, lateral=2)),
    "achromat": LensResponse(
        chromatic_aberration=ChromaticAberration(axial=2, lateral=2, curve=achromat_curve())
    ),
    "1 / (1 - t)": LensResponse(
        chromatic_aberration=ChromaticAberration(
            axial=1, lateral=0.7, axial_map=RECIPROCAL, lateral_map=RECIPROCAL
        )
    ),
    "t^2 cos 2 theta": LensResponse(
        chromatic_aberration=ChromaticAberration(axial=2, lateral=5, axial_map=SECTORS, lateral_map=SECTORS)
    ),
    "equaliser": LensResponse(
        chromatic_aberration=ChromaticAberration(axial=2, lateral=2),
        wavelength_sampling=WavelengthSampling(equaliser=EQUALISER),
    ),
}

Scene = tuple[np.ndarray, np.ndarray]


def chart(width: int, height: int) -> Scene:
    """Return black and white bars and a star on a plane tilted from front (left) to back (right)."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    across, down = (x + 0.5) / width - 0.5, (y + 0.5 - height / 2) / width
    angle = np.arctan2(down, across)
    star = np.sin(18 * angle) > 0
    bars = (np.floor(24 * across) % 2 == 0) ^ (np.abs(down) < 0.2)
    white = np.where(np.hypot(across, down) < 0.17, star, bars)
    image = np.repeat(np.where(white, 0.8, 0.02)[..., None], 3, -1)
    return image.astype(np.float32), (-0.045 * width * across).astype(np.float32)


def night(width: int, height: int) -> Scene:
    """Return lamps far behind a railing in focus, with twigs in front."""
    rng = np.random.default_rng(7)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    image = 0.004 + 0.012 * (y / height)[..., None] * np.array([0.6, 0.7, 1.0], np.float32)
    defocus = np.full((height, width), -0.02 * width, np.float32)
    for _ in range(70):
        row, column = int(rng.uniform(0.04, 0.75) * height), int(rng.uniform(0.02, 0.98) * width)
        size = int(rng.integers(1, 3))
        color = rng.uniform(15, 60) * np.array([1.0, rng.uniform(0.75, 1), rng.uniform(0.5, 1)])
        image[row : row + size, column : column + size] = color
    spacing = width // 16
    railing = (x % spacing < spacing // 8) & (y > 0.62 * height)
    railing |= np.abs(y - 0.62 * height) < 0.008 * height
    image[railing], defocus[railing] = 0.25, 0
    for start in (0.08, 0.9):
        near = np.abs(x - start * width - 0.25 * (y - height / 2) * np.cos(9 * start)) < 0.006 * width
        image[near], defocus[near] = 0.01, 0.012 * width
    return image.astype(np.float32), defocus


def demo() -> Scene:
    """Return the scene of ``bokehnet demo`` with middle focus."""
    disparity = read_disparity(ASSETS / "demo_disparity.png")
    return bokehnet.read_image(ASSETS / "demo.png"), BLUR * (disparity - np.float32(FOCUS["middle"]))


def noise(scene: Scene, lens_response: LensResponse | None) -> float:
    """Return the standard deviation of displayed values between two seeds, 1/255."""
    shown = [
        255 * np.clip(rays(*scene, lens_response=lens_response, seed=seed), 0, 1) ** (1 / 2.2)
        for seed in (0, 1)
    ]
    return float(np.std(shown[0] - shown[1]) / np.sqrt(2))


def lateral_color(name: str, wavelengths: np.ndarray, fields: np.ndarray) -> np.ndarray:
    """Return the lateral offset of the chief rays to the design wavelength, (wavelengths, fields).

    The unit is a thousandth of the half-diagonal, a pixel of a picture of 1600 x 1200. Positive is outwards.
    """
    prescription = find_prescription(name)
    lens = PrescriptionLens(prescription=prescription, pupil_sampling="exit")

    def slope(position: np.ndarray, wavelength: float) -> np.ndarray:
        sensor = np.stack([-prescription.image_radius * position, 0 * position], -1)
        ray = lens.sample_rays(sensor, np.zeros_like(sensor), np.full(position.shape, wavelength))
        return ray.slope[..., 0]

    design = prescription.design_wavelength
    scale = 1000 * 1e-4 / slope(np.array([1e-4]), design)
    return np.array([scale * (slope(fields, design) - slope(fields, w)) for w in wavelengths])


def show_glass() -> None:
    """Print the residual of the traced lateral colour for each model."""
    wavelengths, fields = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 31), np.linspace(0.05, 1, 20)
    along = glass_curve("N-BK7")(wavelengths)
    print("\nlateral colour in thousandths of the half-diagonal, focused at infinity:")
    print(f"{'lens':<15} 400-700 nm, corner   rms   left by: polynomial   slider and map   slider")
    for name in catalog_names(mirrors=False):
        traced = lateral_color(name, wavelengths, fields)
        powers = fields[:, None] ** [1, 3, 5, 7]
        polynomial = (powers @ np.linalg.lstsq(powers, traced.T, rcond=None)[0]).T
        mapped = np.outer(along, along @ traced / (along @ along))
        slider = np.outer(along, fields)
        slider *= (slider * traced).sum() / (slider**2).sum()
        size, *residuals = (
            np.sqrt(np.mean(x**2)) for x in (traced, *(traced - y for y in (polynomial, mapped, slider)))
        )
        corner = traced[0, -1] - traced[-1, -1]
        print(
            f"{name:<15} {corner:18.3f} {size:5.3f} "
            f"{residuals[0]:20.5f} {residuals[1]:16.3f} {residuals[2]:8.3f}"
        )


def show_draws() -> None:
    """Print the noise of half-covered discs, 64 rays each, without dispersion: wavelengths only."""
    points = disc_from_square(np.stack([halton(9216, 2), halton(9216, 3)], -1)).reshape(144, 64, 2)
    angles = np.arange(24) * np.pi / 12
    covered = points @ np.stack([np.cos(angles), np.sin(angles)]) < 0
    evenly = WavelengthSampling().response(
        MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * halton(9216, 5)
    )
    draws = {
        "all white": np.ones((9216, 3)),
        "by importance": WavelengthSampling().sample(9216)[1],
        "evenly spread": evenly,
        "rgb": WavelengthSampling(dispersion="rgb").sample(9216)[1],
    }
    print("\nnoise of half-covered discs:   red   green    blue")
    for name, weights in draws.items():
        runs = weights.reshape(144, 64, 3)
        fraction = np.einsum("prc,pra->pac", runs, covered) / runs.sum(1)[:, None]
        print(f"{name:<25}", *(f"{value:7.4f}" for value in np.sqrt(np.mean((fraction - 0.5) ** 2, (0, 1)))))
    wavelengths = np.unique(WavelengthSampling(dispersion="rgb").sample(64)[0])
    print("wavelengths of rgb:", ", ".join(f"{value:.1f} nm" for value in wavelengths))


def show_cost(scenes: dict[str, Scene], rounds: int) -> None:
    """Print time and noise of each lens response."""
    for title, scene in scenes.items():
        runs: dict[str, Callable[[], np.ndarray]] = {
            name: (lambda scene=scene, lens_response=lens_response: rays(*scene, lens_response=lens_response))
            for name, lens_response in CHARACTERS.items()
        }
        for run in runs.values():
            run()  # compiles
        rows = time_in_turns(runs, rounds)
        height, width = scene[1].shape
        print(f"\n{title}, {width} x {height}:        seconds   beside none   noise, 255ths")
        for name, lens_response in CHARACTERS.items():
            seconds = statistics.median(row[name] for row in rows)
            ratio = statistics.median(row[name] / row["no fringes"] for row in rows)
            print(f"{name:<30} {seconds:8.2f} {ratio:10.2f} x {noise(scene, lens_response):12.2f}")


def show_pictures(scenes: dict[str, Scene], folder: Path) -> None:
    """Write a contact sheet of each scene."""
    folder.mkdir(parents=True, exist_ok=True)
    for title, scene in scenes.items():
        shown = [
            (name, rays(*scene, lens_response=lens_response)) for name, lens_response in CHARACTERS.items()
        ]
        shown.insert(0, ("all in focus", scene[0]))
        sheet = contact_sheet([shown[i : i + 2] for i in range(0, len(shown), 2)])
        bokehnet.write_image(folder / f"dispersion_{title}.jpg", sheet, quality=78)


def main() -> None:
    """Print tables and write sheets."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--sheets", type=Path, help="folder for sheets of pictures")
    options = parser.parse_args()
    size = options.width, options.width * 9 // 16
    scenes = {"chart": chart(*size), "night": night(*size), "demo": demo()}
    if options.sheets is not None:
        show_pictures({name: scenes[name] for name in ("chart", "night")}, options.sheets)
    show_glass()
    show_draws()
    if options.rounds > 0:
        show_cost(scenes, options.rounds)


if __name__ == "__main__":
    main()
