"""OpenImageIO's PNG writer against the parallel one: processor time, wall time, size.

    python -m benchmarks.experiments.programs.png_writers PHOTO [--rounds 5]

The photograph, and the same enlarged to 24 megapixels, as 8 and 16 bits per channel.
"""

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813

from bokehnet.arrays.resample import resample
from bokehnet.io.color.dither import quantise
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.io.containers.png import write_png
from bokehnet.io.image import read_image


def write_oiio(path: Path, values: np.ndarray, level: int) -> None:
    """Write by OpenImageIO, in bands of 256 rows."""
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, values.dtype.name)
    spec.attribute("png:compressionLevel", level)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    for top in range(0, height, 256):
        bottom = min(top + 256, height)
        assert output.write_scanlines(top, bottom, 0, values[top:bottom]), output.geterror()
    assert output.close(), output.geterror()


def main() -> None:
    """Print medians of alternating rounds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photo", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    photo = read_image(options.photo)
    height, width = photo.shape[:2]
    factor = (24e6 / (height * width)) ** 0.5
    large = np.clip(resample(photo, round(height * factor), round(width * factor)), 0, 1)
    for light in (photo, large):
        for bits in (8, 16):
            values = quantise(linear_to_srgb(np.clip(light, 0, 1)), bits)
            writers = {
                "parallel": lambda path, values=values: write_png(
                    path, values.shape, values.dtype, values.__getitem__
                ),
                "OpenImageIO, level 3": lambda path, values=values: write_oiio(path, values, 3),
                "OpenImageIO, level 1": lambda path, values=values: write_oiio(path, values, 1),
            }
            times: dict[str, list[tuple[float, float]]] = {name: [] for name in writers}
            sizes = {}
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder, "a.png")
                for _ in range(options.rounds):
                    for name, write in writers.items():
                        before, start = os.times(), time.perf_counter()
                        write(path)
                        wall, after = time.perf_counter() - start, os.times()
                        busy = after.user + after.system - before.user - before.system
                        times[name].append((wall, busy))
                        sizes[name] = path.stat().st_size
            for name, rows in times.items():
                wall, busy = (statistics.median(column) for column in zip(*rows, strict=True))
                megapixels = values.shape[0] * values.shape[1] / 1e6
                print(
                    f"{megapixels:5.1f} megapixels, {bits:2d} bits  {name:22s} wall {wall:6.2f} s  "
                    f"processor {busy:6.2f} s  {sizes[name] / 1e6:7.2f} MB",
                    flush=True,
                )


if __name__ == "__main__":
    main()
