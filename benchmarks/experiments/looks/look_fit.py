"""Looks fitted to rendered photographs with known looks: error of each parameter relative to its range.

python -m benchmarks.experiments.looks.look_fit [--count 20]

Every truth is a photograph of defocused lamps rendered by the scatter engine, each colour with its own blur
and image scale, with noise and JPEG compression of quality 92.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.image import read_image, write_image
from bokehnet.lenses.fit.discs import find_discs
from bokehnet.lenses.fit.fit import LookFit, fit_look
from bokehnet.optics.aberrations.chromatic_aberration import glass_curve
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

WIDTH, HEIGHT = 720, 480
HALF = 0.5 * np.hypot(WIDTH, HEIGHT)
GREY = np.array([0.2126, 0.7152, 0.0722])
# Ranges to which errors refer; that of a rotation is the angle between blades.
RANGES = {
    "curvature": 1.0,
    "spherical_profile": 2.0,
    "obstruction": 0.95,
    "cats_eye": 1.5,
    "axial": 2.0,
    "lateral": 2.0,
}


def random_look(rng: np.random.Generator) -> dict[str, float]:
    """Return a random look with visible blades, and a dark core with probability 1/4."""
    blades = int(rng.choice([0, 5, 6, 7, 8, 9]))
    return {
        "blades": blades,
        "curvature": float(rng.uniform(0, 0.6)) if blades else 0.0,
        "rotation": float(rng.uniform(-180, 180) / blades) if blades else 0.0,
        "spherical_profile": float(rng.uniform(-0.6, 0.6)),
        "obstruction": float(rng.uniform(0.2, 0.5)) if rng.random() < 0.25 else 0.0,
        "cats_eye": float(rng.uniform(0, 1)),
        "axial": float(rng.uniform(-0.6, 0.6)),
        "lateral": float(rng.uniform(-0.6, 0.6)),
    }


def photograph(look: dict[str, float], rng: np.random.Generator, folder: Path) -> np.ndarray:
    """Return a photograph of lamps at night with this look, as stored by a camera."""
    shape = {name: look[name] for name in look if name not in ("axial", "lateral")}
    aperture = Aperture(**shape)  # type: ignore[arg-type]
    sampled, _ = WavelengthSampling(dispersion="rgb").at((np.arange(3) + 0.5) / 3)
    curve = glass_curve("N-BK7")(sampled)
    positions = [
        (80 + 140 * i + rng.uniform(-20, 20), 85 + 155 * j + rng.uniform(-20, 20))
        for i in range(5)
        for j in range(3)
    ]
    selected = [positions[i] for i in rng.permutation(len(positions))[:9]]
    radius = rng.uniform(24, 36)
    colors = rng.uniform(0.3, 0.85, (len(selected), 3))
    image = np.full((HEIGHT, WIDTH, 3), 0.02)
    for channel, strength in enumerate(curve):
        lamps = np.zeros((HEIGHT, WIDTH, 1), np.float32)
        channel_radius = radius + look["axial"] / 100 * strength * HALF
        for (x, y), color in zip(selected, colors, strict=True):
            middle = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
            px, py = np.array([x, y]) + look["lateral"] / 100 * strength * (np.array([x, y]) - middle)
            left, top = int(px), int(py)
            for dy in (0, 1):
                for dx in (0, 1):
                    weight = abs(1 - dx - (px - left)) * abs(1 - dy - (py - top))
                    lamps[top + dy, left + dx] += weight * color[channel] * np.pi * radius**2 * 0.75
        defocus = np.full((HEIGHT, WIDTH), -channel_radius, np.float32)
        spread = scatter(np.repeat(lamps, 3, -1), defocus, aperture=aperture)
        image[..., channel] += spread[..., 0]
    image += rng.normal(size=image.shape) * np.sqrt(2e-6 + 4e-4 * np.maximum(image, 0))
    path = folder / "lamps.jpg"
    write_image(path, np.clip(image, 0, 1).astype(np.float32), quality=92)
    return read_image(path)


def errors(look: dict[str, float], fit: LookFit) -> dict[str, float]:
    """Return errors relative to the ranges; a wrong number of blades counts as 1."""
    relative = {
        name: abs(getattr(fit.look, name) - look[name]) / value_range
        for name, value_range in RANGES.items()
        if not (name == "curvature" and not look["blades"])
    }
    blades = int(look["blades"])
    relative["blades"] = float(fit.look.blades != blades)
    if blades:
        period = 360 / blades
        relative["rotation"] = (
            abs((fit.look.rotation - look["rotation"] + period / 2) % period - period / 2) / period
        )
    return relative


def main() -> None:
    """Print the error of each parameter over random truths."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    table: dict[str, list[float]] = {}
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.first, options.first + options.count):
            rng = np.random.default_rng(seed)
            look = random_look(rng)
            image = photograph(look, rng, Path(folder))
            start = time.process_time()
            discs = find_discs(image @ GREY)
            fit = fit_look(image, discs)
            seconds.append(time.process_time() - start)
            look_errors = errors(look, fit)
            for name, error in look_errors.items():
                table.setdefault(name, []).append(error)
            if options.verbose:
                print(
                    seed,
                    len(discs),
                    f"{fit.residual:.4f}",
                    {n: round(e, 3) for n, e in look_errors.items()},
                    flush=True,
                )
    print("parameter | truths | median error, % of range | largest | within 5 %")
    print("---|---|---|---|---")
    for name, values in table.items():
        row = 100 * np.array(values)
        print(f"{name} | {len(row)} | {np.median(row):.2f} | {row.max():.2f} | {(row <= 5).sum()}")
    print(f"CPU seconds per photograph, median: {np.median(seconds):.1f}")


if __name__ == "__main__":
    main()
