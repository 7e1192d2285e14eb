"""Noise and cost of the rays on photograph 21: ``python -m benchmarks.experiments.looks.grain [SECTION...]``.

seeds: agreement of two seeds after tone mapping, at two blurs, compared with a fixed number of rays per
    pixel, and the ratio of processor times, in alternation. radii: processor seconds by maximum radius, on
    the enlarged photograph. pan: the window of a crop moves by whole pixels per frame; prints the part of the
    noise that stays in place.
SHARED holds ``real/21.jpg`` with its disparity ``21.png``.
"""

import argparse
import functools
import math
import os
import statistics
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import bokehnet.classical.rays_renderer as rays_renderer
from bokehnet.arrays.resample import resample
from bokehnet.classical.layered.march.defocus_bins import TILE
from bokehnet.classical.layered.march.ray_marching import march
from bokehnet.classical.layered.march.sample_counts import FirstPass
from bokehnet.classical.rays_renderer import rays
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.io.image import read_image, write_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.coc import defocus_from_disparity

FOCUS = 0.35
FRAMES, STEP = 8, 3  # of the pan; pixels per frame


def photograph(shared: Path, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Return picture 21, (H, W, 3), and its defocus in pixels, (H, W)."""
    disparity = read_disparity(shared / "real/21.png")
    return read_image(shared / "real/21.jpg"), defocus_from_disparity(disparity, blur, FOCUS)


def displayed(image: np.ndarray) -> np.ndarray:
    """Return the displayed picture, 0 to 1."""
    return np.asarray(linear_to_srgb(np.clip(image, 0, 1)), np.float64)


def decibel(first: np.ndarray, second: np.ndarray) -> float:
    """Return the peak signal-to-noise ratio of pictures from 0 to 1, dB."""
    return -10 * math.log10(np.mean((first - second) ** 2))


@contextmanager
def fixed_ray_counts() -> Iterator[None]:
    """Send the nominal number of rays from every pixel inside this context."""

    def nominal(first_pass: FirstPass) -> np.ndarray:
        rows, columns = (-(-n // TILE) for n in first_pass.rays_mask.shape)
        return np.full((rows, columns), first_pass.nominal_rays)

    original = rays_renderer.march
    rays_renderer.march = functools.partial(march, sample_counts=nominal)  # type: ignore[assignment]
    try:
        yield
    finally:
        rays_renderer.march = original


def processor_seconds(image: np.ndarray, defocus: np.ndarray) -> float:
    """Return the processor seconds of all threads for one picture."""
    before = os.times()
    rays(image, defocus)
    after = os.times()
    return after.user + after.system - before.user - before.system


def print_seeds(shared: Path, rounds: int) -> None:
    """Print agreement and times at blurs 60 and 90."""
    print("== seeds: two seeds of photograph 21; processor seconds, medians")
    for blur in (60, 90):
        image, defocus = photograph(shared, blur)
        pair = [displayed(rays(image, defocus, seed=seed)) for seed in (0, 1)]
        with fixed_ray_counts():
            plain = [displayed(rays(image, defocus, seed=seed)) for seed in (0, 1)]
        rows = []
        for _ in range(rounds):
            varied = processor_seconds(image, defocus)
            with fixed_ray_counts():
                rows.append((varied, processor_seconds(image, defocus)))
        ratio = statistics.median(varied / fixed for varied, fixed in rows)
        print(
            f"blur {blur}: {decibel(*pair):.1f} dB in {statistics.median(row[0] for row in rows):.2f} s; "
            f"64 rays for each: {decibel(*plain):.1f} dB; ratio of times {ratio:.2f}",
            flush=True,
        )


def print_radii(shared: Path, megapixels: float, radii: list[float]) -> None:
    """Print times by maximum radius."""
    image, defocus = photograph(shared, 1.0)
    scale = math.sqrt(megapixels * 1e6 / defocus.size)
    height, width = (round(scale * side) for side in defocus.shape)
    image, defocus = resample(image, height, width), resample(defocus, height, width)
    rays(image[:64, :64].copy(), np.ones((64, 64), np.float32))
    print(f"== radii: photograph 21 at {width}x{height}, processor seconds of the rays and all around them")
    for radius in radii:
        scaled = (defocus * (radius / np.abs(defocus).max())).astype(np.float32)
        seconds = processor_seconds(image, scaled)
        print(f"radius {radius:5.0f} px: {seconds:7.1f} s, {1e3 * seconds / radius:6.1f} ms a pixel of it")


def print_pan(shared: Path, blur: float, sheet: Path | None) -> None:
    """Print the part of the noise that stays at its screen position while the picture moves.

    The truth is the mean of many seeds. The static part is the mean of the noise over the frames, minus the
    expected mean of independent noise.
    """
    image, defocus = photograph(shared, blur)
    rows = slice(500, 900)
    columns = [slice(200 + STEP * frame, 680 + STEP * frame) for frame in range(FRAMES)]
    truth = np.mean([displayed(rays(image, defocus, seed=seed)) for seed in range(100, 116)], axis=0)
    inner = np.s_[100:-100, 100:-100]  # excludes the influence of the crop's border
    noise, crops = [], []
    for window in columns:
        frame = displayed(rays(image[rows, window].copy(), defocus[rows, window].copy()))
        noise.append((frame - truth[rows, window])[inner])
        crops.append(frame[inner])
    stack = 255 * np.array(noise)
    total = math.sqrt(np.mean(stack**2))
    static = math.sqrt(max(np.mean(stack.mean(0) ** 2) - np.mean(stack.var(0, ddof=1)) / FRAMES, 0.0))
    print(f"== pan: {FRAMES} frames, {STEP} px each, blur {blur:g}")
    print(f"noise {total:.2f}/255 rms, of which {static:.2f}/255 stays on the screen")
    if sheet is not None:
        halves = crops[: FRAMES // 2], crops[FRAMES // 2 :]
        light = srgb_to_linear(np.concatenate([np.concatenate(half, axis=1) for half in halves]).clip(0, 1))
        write_image(sheet, np.asarray(light, np.float32))


def main() -> None:
    """Entry of the command line."""
    sections = ("seeds", "radii", "pan")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", default=sections, help=", ".join(sections))
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--megapixels", type=float, default=6, help="size for the section radii")
    parser.add_argument("--radii", type=float, nargs="*", default=[60, 120, 240], help="pixels")
    parser.add_argument("--blur", type=float, default=60, help="blur for the section pan")
    parser.add_argument("--sheet", type=Path, help="write the frames of the pan in two rows to this file")
    arguments = parser.parse_args()
    for section in arguments.sections:
        if section == "seeds":
            print_seeds(arguments.shared, arguments.rounds)
        elif section == "radii":
            print_radii(arguments.shared, arguments.megapixels, arguments.radii)
        elif section == "pan":
            print_pan(arguments.shared, arguments.blur, arguments.sheet)
        else:
            parser.error(f"unknown section {section}; expected {', '.join(sections)}")


if __name__ == "__main__":
    main()
