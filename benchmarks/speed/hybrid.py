"""Time and memory of the engines, warm: ``python -m benchmarks.speed.hybrid``.

Every engine renders the same picture of 1920x1080 pixels in a separate process. For comparison, the same run
includes the usual implementation of the scatter: a double loop over every pixel's disc.
"""

import argparse

import numpy as np

from benchmarks.measurement import in_own_process, median_seconds, peak_memory, scene
from benchmarks.methods.rivals import double_loop
from bokehnet.engine_registry import ENGINES
from bokehnet.render.renderer import BokehRenderer

RIVAL = "double loop"


def measure(engine: str, size: tuple[int, int], blur: float, repeats: int) -> tuple[float, float]:
    """Return median seconds and peak memory in GB of one engine."""
    render = double_loop if engine == RIVAL else BokehRenderer(engine).render_arrays
    image, defocus = scene(*size, blur)
    render(image[:64, :64].copy(), np.zeros((64, 64), np.float32))  # excludes compilation by numba
    seconds = median_seconds(lambda: render(image, defocus), 1 if engine == RIVAL else repeats)
    return seconds, peak_memory() / 1024**3


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1920, 1080), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--blur", type=float, default=40.0, help="maximum blur radius, pixels")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--no-rival", action="store_true", help="skip the double loop, which is slow")
    arguments = parser.parse_args()
    width, height = arguments.size
    print(f"{width}x{height}, largest blur {arguments.blur:g} px, median of {arguments.repeats} warm renders")
    names = [*ENGINES] if arguments.no_rival else [RIVAL, *ENGINES]
    slowest = None
    for name in names:
        seconds, memory = in_own_process(measure, name, (width, height), arguments.blur, arguments.repeats)
        slowest = seconds if name == RIVAL else slowest
        ratio = f"{slowest / seconds:8.1f}x" if slowest else ""
        print(f"{name:12s} {seconds:8.2f} s  {memory:5.2f} GB {ratio}", flush=True)


if __name__ == "__main__":
    main()
