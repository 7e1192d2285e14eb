"""Time and error of rays at the scale of the blur: ``python -m benchmarks.speed.levels --photo P --map M``.

The picture is enlarged to 6 megapixels. Each row prints processor seconds of the rays and of the render, and
the difference to the full size in decibels of the sRGB picture; the last row is another draw of that.
"""

import argparse
import math
import time
from pathlib import Path
from unittest.mock import patch

import numpy as np

from bokehnet.arrays.resample import resample
from bokehnet.classical import rays_renderer
from bokehnet.classical.layered.march import resolution_levels
from bokehnet.classical.rays_renderer import rays
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_map

# Smallest blur, pixels of a level, and maximum number of levels.
_ROWS = ((4.0, 1), (4.0, 3), (6.0, 2), (6.0, 3), (8.0, 3))


def _render(image: np.ndarray, defocus: np.ndarray, seed: int) -> tuple[np.ndarray, float, float]:
    """Return the sRGB picture, and processor seconds of the rays and of the render."""
    march, seconds = rays_renderer.march_levels, [0.0]

    def timed(*arguments: object, **keywords: object) -> None:
        start = time.process_time()
        march(*arguments, **keywords)  # type: ignore[arg-type]
        seconds[0] += time.process_time() - start

    start = time.process_time()
    with patch.object(rays_renderer, "march_levels", timed):
        picture = linear_to_srgb(rays(image, defocus, seed=seed))
    return picture, seconds[0], time.process_time() - start


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--photo", type=Path, required=True, help="all-in-focus photograph")
    parser.add_argument("--map", type=Path, required=True, help="its disparity map")
    parser.add_argument("--megapixels", type=float, default=5.832, help="size of the enlarged picture")
    parser.add_argument("--blur", type=float, default=243.0, help="blur radius, pixels per unit of disparity")
    parser.add_argument("--focus", type=float, default=0.458, help="disparity in focus, 0 to 1")
    options = parser.parse_args()
    image = read_image(options.photo)
    scale = math.sqrt(options.megapixels * 1e6 / (image.shape[0] * image.shape[1]))
    height, width = (round(scale * side) for side in image.shape[:2])
    image = resample(image, height, width)
    disparity = resample(read_map(options.map), height, width)
    disparity = (disparity - disparity.min()) / (disparity.max() - disparity.min())
    defocus = (options.blur * (disparity - options.focus)).astype(np.float32)
    _render(image[:256], np.full_like(defocus[:256], -32.0), 0)  # compiles
    with patch.object(resolution_levels, "MAX_LEVELS", 0):
        full, march_seconds, seconds = _render(image, defocus, 0)
        other, _, _ = _render(image, defocus, 1)
    print(f"{width}x{height}, blur up to {np.abs(defocus).max():.0f} px")
    print(f"full size: rays {march_seconds:.1f} s, render {seconds:.1f} s")
    for radius, levels in _ROWS:
        with (
            patch.object(resolution_levels, "MIN_RADIUS_PX", radius),
            patch.object(resolution_levels, "MAX_LEVELS", levels),
        ):
            picture, march_seconds, seconds = _render(image, defocus, 0)
        decibels = -10 * math.log10(np.mean((picture - full) ** 2))
        print(
            f"{radius:g} px, {levels}: rays {march_seconds:.1f} s, render {seconds:.1f} s, {decibels:.2f} dB"
        )
    print(f"another draw: {-10 * math.log10(np.mean((other - full) ** 2)):.2f} dB")


if __name__ == "__main__":
    main()
