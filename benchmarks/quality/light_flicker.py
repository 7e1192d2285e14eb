"""Flicker of recovered light from frame to frame: ``python -m benchmarks.quality.light_flicker``.

Lamps with the halo of a stopped-down lens before a dark wall, 24 frames of 240x160 pixels stored in 8 bits.
``moving``: the lamps move by .37 pixels a frame. ``exposure``: they stand still and the exposure rises by two
stops. The true flux around each lamp is known. Flicker is the root mean square of the change from frame to
frame of the logarithm of the rendered over the true flux, percent; ``level`` is their mean ratio.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.figures import write_figures
from bokehnet.light.recovery import recover_light
from bokehnet.light.temporal import measure_frame, steady_light, steady_sums
from train.data.light_scenes import CameraCurve, decoded

_HEIGHT, _WIDTH, _FRAMES, _REACH = 160, 240, 24, 16
_STEP_PX = 0.37
_HALO_PX = 0.6  # wavelength times f-number
_WALL = 0.006
# Row, column, radius in pixels, radiance in units of white.
_LAMPS = ((40, 50, 1.0, 100.0), (40, 150, 1.5, 30.0), (110, 70, 3.0, 12.0), (120, 180, 2.0, 60.0))
_COLOR = np.array([1.0, 0.7, 0.4])

_KINDS = ("moving", "exposure")


def frames(kind: str, seed: int) -> Iterator[tuple[np.ndarray, list[tuple[int, int]]]]:
    """Yield the light of each frame (H, W, 3) and the pixels of its lamps, row and column."""
    y, x = np.mgrid[:_HEIGHT, :_WIDTH]
    for number in range(_FRAMES):
        rng = np.random.default_rng([seed, number])
        shift = _STEP_PX * number if kind == "moving" else 0.0
        gain = 2.0 ** (2 * number / (_FRAMES - 1)) if kind == "exposure" else 1.0
        light = _WALL * (1 + 0.1 * rng.standard_normal((_HEIGHT, _WIDTH, 1))) * np.ones(3)
        for row, column, radius, radiance in _LAMPS:
            distance = np.hypot(y - row, x - column - shift)
            flux = np.pi * radius**2 * radiance
            glow = flux * _HALO_PX / (np.pi**3 * np.maximum(distance, radius + 0.5) ** 3)
            light += ((np.clip(radius + 0.5 - distance, 0, 1) * radiance + glow)[..., None]) * _COLOR
        yield gain * light, [(row, round(column + shift)) for row, column, *_ in _LAMPS]


Render = Callable[[list[np.ndarray]], list[np.ndarray]]


def flicker(kind: str, seed: int, render: Render) -> tuple[float, float]:
    """Return flicker in percent and the mean ratio of rendered to true flux."""
    shot = list(frames(kind, seed))
    rendered = render([decoded(CameraCurve().store(light)) for light, _ in shot])
    ratios = []
    for (light, places), result in zip(shot, rendered, strict=True):
        around = [np.s_[r - _REACH : r + _REACH, c - _REACH : c + _REACH] for r, c in places]
        ratios.append([result[box].sum() / light[box].sum() for box in around])
    logs = np.log(ratios)
    return 100 * float(np.sqrt((np.diff(logs, axis=0) ** 2).mean())), float(np.exp(logs.mean()))


def _single(images: list[np.ndarray]) -> list[np.ndarray]:
    return [recover_light(image).image for image in images]


def _shot(images: list[np.ndarray]) -> list[np.ndarray]:
    lights = {number: measure_frame(image, None) for number, image in enumerate(images)}
    sums = steady_sums(lights, lights)
    return [
        steady_light(image, None, sums[number]).image if number in sums else image
        for number, image in enumerate(images)
    ]


_RENDERS: dict[str, Render] = {"off": lambda images: images, "each frame by itself": _single, "auto": _shot}


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="write light_flicker.json there")
    arguments = parser.parse_args()
    rows = {}
    for kind in _KINDS:
        for name, render in _RENDERS.items():
            values = [flicker(kind, seed, render) for seed in range(arguments.seeds)]
            change, level = np.mean(values, axis=0)
            rows[f"{kind}, {name}"] = {"flicker": change, "level": level}
            print(f"{kind} | {name} | flicker {change:.2f} % | level {level:.2f}", flush=True)
    if arguments.figures is not None:
        write_figures(
            arguments.figures / "light_flicker.json",
            "python -m benchmarks.quality.light_flicker --figures docs/figures",
            f"4 lamps, {_FRAMES} frames of {_WIDTH}x{_HEIGHT}, {arguments.seeds} seeds; mean of the seeds",
            {"flicker": ("flicker, %", ".2f"), "level": ("flux over true flux", ".2f")},
            rows,
        )


if __name__ == "__main__":
    main()
