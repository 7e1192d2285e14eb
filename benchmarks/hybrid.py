"""Time and memory of the engines, warm: ``python -m benchmarks.hybrid``.

Every engine renders the same traced scene of 1920x1080 pixels in a process of its own. Beside them, as a
rival in the same run, the scatter as it is usually written: a double loop over every pixel's disc.
"""

import argparse
import json
import math
import resource
import statistics
import subprocess
import sys
import time

import numpy as np
from numba import njit, prange

from bokehnet.inference.pipeline import ENGINES, BokehRenderer

RIVAL = "double loop"


@njit(parallel=True, cache=True)
def double_loop(image, defocus):  # type: ignore[no-untyped-def]
    """The normalised scatter, turned round so that threads do not collide: every pixel asks all around it."""
    height, width, _ = image.shape
    reach = int(math.ceil(np.abs(defocus).max())) + 1
    result = np.zeros_like(image)
    for y in prange(height):
        for x in range(width):
            weight = 0.0
            red = green = blue = 0.0
            for v in range(max(0, y - reach), min(height, y + reach + 1)):
                for u in range(max(0, x - reach), min(width, x + reach + 1)):
                    radius = abs(defocus[v, u])
                    distance = math.sqrt((u - x) ** 2 + (v - y) ** 2)
                    if distance > radius + 0.5:
                        continue
                    w = min(1.0, radius + 0.5 - distance) / (radius * radius + 0.2)
                    weight += w
                    red += w * image[v, u, 0]
                    green += w * image[v, u, 1]
                    blue += w * image[v, u, 2]
            result[y, x, 0] = red / weight
            result[y, x, 1] = green / weight
            result[y, x, 2] = blue / weight
    return result


def scene(width: int, height: int, blur: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise behind discs and stripes at several depths; the largest radius is ``blur``."""
    rng = np.random.default_rng(0)
    image = rng.random((height, width, 3), dtype=np.float32)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    disparity = 0.15 + 0.25 * y / height
    for number in range(12):
        centre = rng.random(2) * (height, width)
        inside = np.hypot(y - centre[0], x - centre[1]) < rng.uniform(0.03, 0.15) * width
        disparity = np.where(inside, 0.2 + 0.05 * number, disparity)
    defocus = blur * (disparity - 0.35) / np.abs(disparity - 0.35).max()
    return image, defocus.astype(np.float32)


def measure(engine: str, size: tuple[int, int], blur: float, repeats: int) -> None:
    """Print median seconds and peak memory of one engine as JSON."""
    image, defocus = scene(*size, blur)
    if engine == RIVAL:
        small, few = image[:16, :16].copy(), np.zeros((16, 16), np.float32)
        double_loop(small, few)
        run = lambda: double_loop(image, defocus)  # noqa: E731
        repeats = 1
    else:
        renderer = BokehRenderer(engine)
        run = lambda: renderer.render(image, defocus)  # noqa: E731
        run()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        seconds.append(time.perf_counter() - start)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    print(json.dumps({"seconds": statistics.median(seconds), "peak_gb": peak}))


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1920, 1080), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--blur", type=float, default=40.0, help="largest radius, pixels")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--no-rival", action="store_true", help="leave the double loop out; it takes minutes")
    parser.add_argument("--engine", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.engine:
        measure(arguments.engine, tuple(arguments.size), arguments.blur, arguments.repeats)
        return
    width, height = arguments.size
    print(f"{width}x{height}, largest blur {arguments.blur:g} px, median of {arguments.repeats} warm renders")
    names = [*ENGINES] if arguments.no_rival else [*ENGINES, RIVAL]
    base = [sys.executable, "-m", "benchmarks.hybrid", "--size", str(width), str(height)]
    base += ["--blur", str(arguments.blur), "--repeats", str(arguments.repeats)]
    rows = {}
    for name in names:
        done = subprocess.run([*base, "--engine", name], capture_output=True, text=True, check=True)
        rows[name] = json.loads(done.stdout)
    for name, row in rows.items():
        ratio = f"{rows[RIVAL]['seconds'] / row['seconds']:8.1f}x" if RIVAL in rows else ""
        print(f"{name:12s} {row['seconds']:8.2f} s  {row['peak_gb']:5.2f} GB {ratio}")


if __name__ == "__main__":
    main()
