"""Loss from mixed pixels in filtered depth, and gain of their repair.

Run ``python -m benchmarks.experiments.edges.mixed_depth``.

Draws a scene with sky, a ground plane, discs and thin poles at four times the resolution; its downsampled
rendering is the truth. PSNR is that of the clipped sRGB picture.
"""

import argparse

import numpy as np

from bokehnet.depth_repair.mixed_pixels import mixed_pixel_fraction, repair_mixed
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.render.renderer import BokehRenderer

HEIGHT, WIDTH, FINE = 180, 240, 4
BLUR = 14.0
FOCUS = (0.0, 0.5, 1.0)
SKY_DISTANCE = 1e4  # the nearest disc is at about 1


def draw(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Return colours (H, W, 3) and disparity (H, W) of the scene at the fine resolution."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: HEIGHT * FINE, : WIDTH * FINE] / FINE
    ground = 0.05 + 0.6 * (y - 100) / 80
    surfaces = [(np.full(y.shape, True), 0.0), (y > 100, ground)]
    for _ in range(9):
        u, v, radius = rng.uniform(0, WIDTH), rng.uniform(20, 150), rng.uniform(8, 30)
        surfaces.append(((x - u) ** 2 + (y - v) ** 2 < radius**2, rng.uniform(0.25, 1)))
    for width in (0.6, 1.2, 2.5, 4.0):
        u, slant = rng.uniform(20, WIDTH - 20), rng.uniform(-0.3, 0.3)
        surfaces.append((np.abs(x - u - slant * (y - 90)) < width / 2, rng.uniform(0.5, 1)))
    colours, disparity = np.zeros((*y.shape, 3)), np.zeros(y.shape)
    for covered, value in surfaces:
        base, frequency = rng.uniform(0.1, 0.9, 3), rng.uniform(0.05, 0.5, 2)
        light = 0.7 + 0.3 * np.sin(2 * frequency[0] * x + 3 * frequency[1] * y)
        colours[covered] = (base * light[..., None])[covered]
        disparity[covered] = np.broadcast_to(value, y.shape)[covered]
    return colours, disparity


def shrink(values: np.ndarray) -> np.ndarray:
    """Return the average over each pixel."""
    return values.reshape(HEIGHT, FINE, WIDTH, FINE, *values.shape[2:]).mean((1, 3))


def widen(values: np.ndarray) -> np.ndarray:
    """Return the average over three pixels, as wide filters do."""
    for axis in (0, 1):
        padded = np.pad(values, [(int(a == axis), int(a == axis)) for a in (0, 1)], "edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 3, axis)
        values = windows @ np.array([0.25, 0.5, 0.25])
    return values


def maps(disparity: np.ndarray) -> dict[str, tuple[np.ndarray, str]]:
    """Return the maps by description, and the filtered quantity of each."""
    depth = 1 / np.maximum(disparity, 1 / SKY_DISTANCE)
    centre = FINE // 2
    return {
        "at pixel centres": (disparity[centre::FINE, centre::FINE], "disparity"),
        "depth over the pixel": (1 / shrink(depth), "depth"),
        "depth over three pixels": (1 / widen(shrink(depth)), "depth"),
        "disparity over the pixel": (shrink(disparity), "disparity"),
        "disparity over three pixels": (widen(shrink(disparity)), "disparity"),
    }


def psnr(picture: np.ndarray, truth: np.ndarray) -> float:
    """Return the PSNR of the clipped sRGB pictures, dB."""
    shown = [linear_to_srgb(np.clip(values, 0, 1)) for values in (picture, truth)]
    return float(-10 * np.log10(np.mean((shown[0] - shown[1]) ** 2)))


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engine", default="rays")
    renderer = BokehRenderer(parser.parse_args().engine)
    colours, disparity = draw()
    image = shrink(colours).astype(np.float32)

    def render(picture: np.ndarray, values: np.ndarray, focus: float, scale: float = 1) -> np.ndarray:
        defocus = (scale * BLUR * (values - focus)).astype(np.float32)
        return renderer.render_arrays(np.asarray(picture, np.float32), defocus).bokeh

    truths = [shrink(render(colours, disparity, focus, FINE)) for focus in FOCUS]
    print("| map | mixed | " + " | ".join(f"focus {focus:g}" for focus in FOCUS) + " | repaired: same |")
    for name, (values, filtered) in maps(disparity).items():
        stored = values.astype(np.float32)
        repaired = repair_mixed(stored, filtered=filtered)
        scores = [
            [
                psnr(render(image, map_values, focus), truth)
                for focus, truth in zip(FOCUS, truths, strict=True)
            ]
            for map_values in (stored, repaired)
        ]
        cells = [" / ".join(f"{score:.2f}" for score in row) for row in scores]
        print(f"| {name} | {mixed_pixel_fraction(stored, filtered=filtered):.3f} | {cells[0]} | {cells[1]} |")


if __name__ == "__main__":
    main()
