"""Time and light conservation of lamp effects: diffraction rings and stars, ghosts and glare.

First prints the light conservation of blurred lamps near an edge: lamps of one pixel on a near surface, 0 to
13 pixels from its edge, in front of an equally dark wall.

python -m benchmarks.experiments.looks.lamps [--sheet docs/images/light.jpg]
"""

import argparse
import time
from pathlib import Path

import numpy as np

from bokehnet.classical.rays_renderer import rays
from bokehnet.effects.diffracted_lamps import add_rings, add_stars
from bokehnet.effects.ghosts import Ghosts
from bokehnet.effects.glare import Glare
from bokehnet.effects.lamps import Lamps
from bokehnet.io.image import write_image
from bokehnet.lenses import load_lens
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.diffraction import disc_kernel, ring_kernel, star_kernel
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import DefocusMap
from bokehnet.scene.scene import make_scene
from bokehnet.settings.settings import RenderSettings

HEIGHT, WIDTH = 1080, 1920
PITCH = 36000 / WIDTH  # micrometres


def light_kept_near_edge(near: float, far: float, times: float) -> np.ndarray:
    """Return the rendered light of each lamp relative to its own light.

    Args:
        near: Defocus of the surface with the lamps, pixels.
        far: Defocus of the wall, pixels.
        times: Brightness of the lamps relative to the background.
    """
    size, spacing = (600, 200), 29
    defocus = np.where(np.arange(size[1]) < 100, near, far) * np.ones((size[0], 1))
    dark = np.full((*size, 3), 0.02, np.float32)
    rows = np.arange(20, size[0] - 20, spacing)
    lit, columns = dark.copy(), 99 - (np.arange(len(rows)) * 5 + np.arange(len(rows)) // 3) % 14
    lit[rows, columns] *= times
    ratios = []
    for seed in range(4):
        lamp_light = rays(lit, defocus, seed=seed).astype(np.float64) - rays(dark, defocus, seed=seed)
        light_per_lamp = [lamp_light[row - spacing // 2 : row + spacing // 2 + 1].sum() for row in rows]
        ratios.append(np.array(light_per_lamp) / (3 * 0.02 * (times - 1)))
    return np.concatenate(ratios)


def print_kept() -> None:
    """Print one line for each kind of lamp."""
    print("lamps beside an edge                  | light kept, mean | each, root mean square")
    print("---|---|---")
    for near, far, times in ((12, 0, 50), (12, 0, 1000), (6, -8, 150), (3.4, -3, 500)):
        kept_fraction = light_kept_near_edge(near, far, times)
        error = np.sqrt(np.mean((kept_fraction - 1) ** 2))
        description = f"radius {near}, wall {far}, {times} times as bright"
        print(f"{description:37s} | {kept_fraction.mean():.4f} | {error:.4f}", flush=True)
    print()


def main() -> None:
    """Print the tables, and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sheet", type=Path, help="write a picture of each effect to this file")
    sheet = parser.parse_args().sheet
    print_kept()
    rng = np.random.default_rng(0)
    count = 20
    row, column = rng.integers(100, HEIGHT - 100, count), rng.integers(100, WIDTH - 100, count)
    lamps = Lamps(
        row=row, column=column, light=rng.uniform(50, 500, (count, 3)), defocus=np.full(count, -40.0)
    )
    defocus = np.full((HEIGHT, WIDTH), -40.0)
    aperture = Aperture(blades=7)
    bokeh = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    one = Lamps(row=row[:1], column=column[:1], light=np.full((1, 3), 1e6), defocus=np.zeros(1))
    lens = load_lens("double_gauss", f_number=8.0, focal_length=50.0)
    effects = {
        "rings, 20 lamps, radius 40": lambda: add_rings(bokeh, lamps, defocus, aperture, 2.8 / PITCH),
        "stars, 20 lamps, f/16": lambda: add_stars(bokeh, lamps, aperture, 16 / PITCH),
        "ghosts, 1 lamp, 45 pairs": lambda: (
            bokeh + Ghosts(lens=lens, half_diagonal=20.6).light(one, HEIGHT, WIDTH)
        ),
        "glare": lambda: Glare(share=0.03).apply(bokeh, 0.5 * np.hypot(HEIGHT, WIDTH)),
    }
    print(f"{WIDTH} x {HEIGHT}           | first, CPU s | again, CPU s | light kept")
    print("---|---|---|---")
    for name, effect in effects.items():
        seconds = []
        for _ in range(3):
            start = time.process_time()
            result = effect()
            seconds.append(time.process_time() - start)
        kept_fraction = result.sum(dtype=np.float64) / bokeh.sum(dtype=np.float64)
        print(f"{name} | {seconds[0]:.2f} | {min(seconds[1:]):.2f} | {kept_fraction:.4f}")
    for kernel in (disc_kernel, ring_kernel, star_kernel):
        kernel.cache_clear()
    if sheet is not None:
        write_image(sheet, draw_sheet())


def draw_sheet() -> np.ndarray:
    """Return a picture of lamps at night with each effect, side by side."""
    size, tiles = 420, []
    image = np.full((size, size, 3), 0.003, np.float32)
    rng = np.random.default_rng(3)
    colors = np.array([[1, 0.75, 0.4], [1, 0.9, 0.8], [0.5, 0.7, 1], [1, 0.35, 0.25]])
    near = np.zeros((size, size), np.float32)
    for number in range(9):
        y, x = 60 + 150 * (number // 3) + rng.integers(-15, 15), 60 + 150 * (number % 3)
        image[y, x] = 250 * colors[number % 4]
    ghostly = np.full((size, size, 3), 0.003, np.float32)
    ghostly[90:94, 110:114] = 40000
    renderer = BokehRenderer("scatter")
    for picture, radius, settings in (
        (image * 8, -44.0, {}),
        (image * 8, -44.0, {"light": {"rings": 4, "pixel_pitch": 6}}),
        (image * 4, 0.0, {"light": {"starburst": 16, "pixel_pitch": 6}, "aperture": {"blades": 7}}),
        (image * 4, 0.0, {"light": {"starburst": 16, "pixel_pitch": 6}, "aperture": {"blades": 6}}),
        (ghostly, 0.0, None),
        (image, 0.0, {"light": {"glare": 0.2, "glare_core": 0.5}}),
    ):
        if settings is None:
            spot = Lamps(row=np.array([92]), column=np.array([112]), light=picture[92:93, 112] * 16,
                         defocus=np.zeros(1))  # fmt: skip
            lens = load_lens("double_gauss", f_number=8.0, focal_length=50.0)
            tiles.append(picture + Ghosts(lens=lens, half_diagonal=20.6).light(spot, size, size) * 3)
            continue
        scene = make_scene(picture, DefocusMap(map=near + radius))
        tiles.append(renderer.render(scene, RenderSettings().updated(settings)).bokeh)
    return np.clip(np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])]), 0, 1).astype(np.float32)


if __name__ == "__main__":
    main()
