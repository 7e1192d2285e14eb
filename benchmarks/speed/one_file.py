"""Time and memory of the renderer as one ONNX file: ``python -m benchmarks.speed.one_file``.

ONNX Runtime renders with the file that ``bokehnet export`` writes; for comparison, the package renders with
the same engine in the same run, each in a separate process, warm. Then both render one picture for their
PSNR.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import onnxruntime

from benchmarks.measurement import in_own_process, median_seconds, peak_memory, scene
from bokehnet.onnx_file.renderer import ONE_FILE_ENGINES, export_renderer
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.render.renderer import BokehRenderer


class OneFile:
    """Exported file in plain ONNX Runtime."""

    def __init__(self, path: Path) -> None:
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])

    def __call__(self, image: np.ndarray, disparity: np.ndarray, blur: float) -> np.ndarray:
        """Return the bokeh (H, W, 3), focused on disparity 0."""
        numbers = {"K": blur, "focus": 0, "gamma": 1}
        scalars = {name: np.array(value, np.float32) for name, value in numbers.items()}
        return self._session.run(None, {"image": image, "disparity": disparity, **scalars})[0]


class Package:
    """Renderer of the package with the same interface."""

    def __init__(self, engine: str) -> None:
        self._renderer = BokehRenderer(engine)

    def __call__(self, image: np.ndarray, disparity: np.ndarray, blur: float) -> np.ndarray:
        """Return the bokeh (H, W, 3), focused on disparity 0."""
        defocus = defocus_from_disparity(disparity, np.float32(blur), np.float32(0))
        return self._renderer.render_arrays(image, defocus).bokeh


def measure(
    path: Path | None, engine: str, size: tuple[int, int], blur: float, repeats: int
) -> tuple[float, float]:
    """Return median seconds and peak memory in GB of the file, or of the package without a file."""
    render = OneFile(path) if path else Package(engine)
    image, disparity = scene(*size, 1.0)
    render(image[:64, :64].copy(), disparity[:64, :64].copy(), 4.0)
    seconds = median_seconds(lambda: render(image, disparity, blur), repeats)
    return seconds, peak_memory() / 1024**3


def parity(path: Path, engine: str, size: tuple[int, int], blur: float) -> float:
    """Return the PSNR between file and package, dB, scene-linear."""
    image, disparity = scene(*size, 1.0)
    one, other = (render(image, disparity, blur) for render in (OneFile(path), Package(engine)))
    return float(-10 * np.log10(np.square(one - other).mean() + 1e-20))


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1350, 1080), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--blur", type=float, default=60.0, help="maximum blur radius, pixels")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--engine", choices=ONE_FILE_ENGINES, default="fast")
    arguments = parser.parse_args()
    engine, size, blur = arguments.engine, tuple(arguments.size), arguments.blur
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "one.onnx"
        export_renderer(path, engine=engine)
        print(f"{size[0]}x{size[1]}, largest blur {blur:g} px, median of {arguments.repeats} warm renders")
        for name, file in (("package", None), ("one file", path)):
            seconds, memory = in_own_process(measure, file, engine, size, blur, arguments.repeats)
            print(f"{name:10s} {seconds:6.2f} s  {memory:5.2f} GB", flush=True)
        print(f"parity     {in_own_process(parity, path, engine, size, blur):6.1f} dB")


if __name__ == "__main__":
    main()
