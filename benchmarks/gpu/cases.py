"""Agreement and speed on a CUDA device: ``python -m benchmarks.gpu.cases --out FOLDER``.

The benchmark renders the same arrays on the device and on the CPU of the same machine. A row states the
difference of the results, the median time of each after a warm-up, the time of the copies between host and
device, and the peak device memory. Rows: scatter, gradients of the scatter, rays, and whole renderers. If a
case fails, the report contains its traceback, and the other cases continue. Without a device the same cases
run on pictures of a few pixels: the scatter by torch on the CPU, the rays in the device simulator of numba.
"""

import argparse
import importlib.metadata
import json
import math
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch

from benchmarks.gpu.measurement import DeviceMemory, Report, TimedMarch, agreement, synchronize
from benchmarks.measurement import median_seconds, scene
from bokehnet.classical.cuda.march import CudaMarch
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.march import ray_marching
from bokehnet.classical.picture_job import Device
from bokehnet.classical.rays_renderer import render_rays
from bokehnet.classical.scatter_renderer import scatter_inside
from bokehnet.classical.torch import autograd
from bokehnet.classical.torch.device_scatter import scatter_on
from bokehnet.classical.torch.pyramid_levels import scatter_sums
from bokehnet.engines.options import RenderOptions
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.tone import Highlights
from bokehnet.render.renderer import BokehRenderer

__all__ = ["main"]

APERTURES = {
    "disc": Aperture(),
    "6 blades": Aperture(blades=6, rotation=10),
    "cat's-eye": Aperture(cats_eye=0.8),
}

# Largest blur radius, as a fraction of the width of the picture.
BLURS = {"small": 0.006, "usual": 0.02, "large": 0.06}

PACKAGES = ("numpy", "numba", "numba-cuda", "llvmlite", "torch", "onnxruntime")


class Bench:
    """Cases of the benchmark on one device.

    Args:
        report: Receiver of the rows.
        repeats: Number of timed runs per case.
        device: Torch device, ``cuda`` or ``cpu``.
    """

    def __init__(self, report: Report, repeats: int, device: str) -> None:
        self.report, self.repeats, self.device = report, repeats, device
        self.simulated = device == "cpu"

    def _seconds(self, run: Callable[[], Any], megapixels: float, share: int = 1) -> float:
        """Return the median time of a warm run in seconds; large pictures have fewer repeats."""

        def run_all() -> None:
            run()
            synchronize()

        repeats = self.repeats if megapixels < 3 else self.repeats // 2
        return median_seconds(run_all, max(1, repeats // share))

    def scatter(self, name: str, width: int, height: int, blur: float, aperture: Aperture) -> None:
        """Add the scatter of arrays, and of tensors that are already on the device."""
        megapixels = width * height / 1e6

        def measure() -> dict[str, Any]:
            image, radii = scene(width, height, blur)
            run_on_device = partial(scatter_on(self.device), image, radii, aperture)
            run_on_cpu = partial(scatter_inside, image, radii, aperture)
            on_device, repeated, on_cpu = run_on_device(), run_on_device(), run_on_cpu()
            row = agreement(on_device, on_cpu) | {"repeatable": bool((on_device == repeated).all())}
            colors, blurs = torch.from_numpy(image).to(self.device), torch.from_numpy(radii).to(self.device)
            values = torch.cat([colors, torch.ones_like(colors[..., :1])], -1)

            def copies() -> None:
                for array in (image, radii):
                    torch.from_numpy(array).to(self.device)
                colors.cpu()

            if not self.simulated:
                torch.cuda.empty_cache()
                torch.cuda.reset_peak_memory_stats()
                run_on_device()
                row["peak_mb"] = torch.cuda.max_memory_allocated() / 1e6
            return row | {
                "device_s": self._seconds(run_on_device, megapixels),
                "resident_s": self._seconds(lambda: scatter_sums(values, blurs, aperture), megapixels),
                "copies_s": self._seconds(copies, megapixels),
                "cpu_s": self._seconds(run_on_cpu, megapixels, 2),
            }

        self.report.add("scatter", name, megapixels, measure)

    def gradients(
        self, name: str, width: int, height: int, blur: float, aperture: Aperture, dtype: Any
    ) -> None:
        """Add forward and backward pass of the scatter; gradients are divided by their maximum."""
        megapixels = width * height / 1e6

        def run(device: str) -> Callable[[], list[torch.Tensor]]:
            arrays = [torch.from_numpy(array).to(device, dtype) for array in scene(width, height, blur)]
            image, radii = (tensor.requires_grad_() for tensor in arrays)
            generator = torch.Generator().manual_seed(0)
            weights = torch.rand(height, width, 3, generator=generator).to(device, dtype)

            def run_all() -> list[torch.Tensor]:
                bokeh = autograd.scatter(image, radii, aperture)
                return [bokeh.detach(), *torch.autograd.grad(bokeh, (image, radii), weights)]

            return run_all

        def measure() -> dict[str, Any]:
            run_on_device, run_on_cpu = run(self.device), run("cpu")
            on_device, repeated, on_cpu = run_on_device(), run_on_device(), run_on_cpu()
            row = agreement(on_device[0].cpu().numpy(), on_cpu[0].numpy())
            for key, device_gradient, cpu_gradient in zip(
                ("image", "defocus"), on_device[1:], on_cpu[1:], strict=True
            ):
                largest = cpu_gradient.abs().max()
                row[f"{key}_gradient"] = agreement(
                    (device_gradient.cpu() / largest).numpy(), (cpu_gradient / largest).numpy()
                )
            row["repeatable"] = all(bool((a == b).all()) for a, b in zip(on_device, repeated, strict=True))
            if not self.simulated:
                torch.cuda.reset_peak_memory_stats()
                run_on_device()
                row["peak_mb"] = torch.cuda.max_memory_allocated() / 1e6
            return row | {
                "device_s": self._seconds(run_on_device, megapixels),
                "cpu_s": self._seconds(run_on_cpu, megapixels, 2),
            }

        self.report.add("gradients", name, megapixels, measure)

    def rays(
        self, name: str, width: int, height: int, blur: float, aperture: Aperture, changes: str = ""
    ) -> None:
        """Add the rays renderer; ``changes`` selects a scene: front, behind, lights, layers."""
        megapixels = width * height / 1e6

        def measure() -> dict[str, Any]:
            image, radii = scene(width, height, blur)
            options: dict[str, Any] = {"rays_factor": 0.125} if self.simulated else {}
            if changes in ("front", "behind"):
                radii = np.abs(radii) if changes == "front" else -np.abs(radii)
            if changes == "lights":
                image = (
                    image * np.where(np.random.default_rng(1).random(radii.shape) < 5e-4, 200, 1)[..., None]
                )
                image = image.astype(np.float32)
            if changes == "layers":
                options["layers"] = _two_layers(image, radii)
            march, cpu_march = TimedMarch(CudaMarch()), TimedMarch(ray_marching._march)
            device_methods = Device(scatter_on(self.device), march)
            run_on_device = partial(render_rays, image, radii, aperture, device_methods, **options)
            cpu_methods = Device(scatter_inside, cpu_march)
            run_on_cpu = partial(render_rays, image, radii, aperture, cpu_methods, **options)
            with DeviceMemory() as memory:
                on_device = run_on_device()
            on_cpu = run_on_cpu()
            row = agreement(on_device.bokeh, on_cpu.bokeh) | {"peak_mb": memory.peak / 1e6}
            row["disocclusion"] = agreement(on_device.disocclusion_weight, on_cpu.disocclusion_weight)
            march.reset(copies=True)
            row["repeatable"] = bool((on_device.bokeh == run_on_device().bokeh).all())
            row |= {"copies_s": march.copied, "copied_mb": march.bytes / 1e6}
            for key, timed, run in (("device", march, run_on_device), ("cpu", cpu_march, run_on_cpu)):
                timed.reset()
                row[f"{key}_s"] = self._seconds(run, megapixels, 1 if key == "device" else 2)
                row[f"{key}_march_s"] = timed.seconds / timed.renders
            return row

        self.report.add("rays", name, megapixels, measure)

    def renderer(
        self,
        name: str,
        width: int,
        height: int,
        blur: float,
        engine: Any = "rays",
        aperture: Aperture | None = None,
        options: RenderOptions | None = None,
    ) -> None:
        """Add a whole renderer on arrays."""
        megapixels = width * height / 1e6

        def measure() -> dict[str, Any]:
            image, radii = scene(width, height, blur)
            device: Any = "cpu" if self.simulated else "cuda"
            start = time.perf_counter()
            run_on_device = partial(
                BokehRenderer(engine, device=device, aperture=aperture).render_arrays,
                image,
                radii,
                options=options,
            )
            run_on_cpu = partial(
                BokehRenderer(engine, aperture=aperture).render_arrays, image, radii, options=options
            )
            on_device = run_on_device()
            first = time.perf_counter() - start
            row = agreement(on_device.bokeh, run_on_cpu().bokeh) | {"first_s": first}
            if not self.simulated:
                with DeviceMemory() as memory:
                    run_on_device()
                row["peak_mb"] = memory.peak / 1e6
            return row | {
                "device_s": self._seconds(run_on_device, megapixels),
                "cpu_s": self._seconds(run_on_cpu, megapixels, 2),
            }

        self.report.add("renderer", name, megapixels, measure)


def _two_layers(image: np.ndarray, radii: np.ndarray) -> Layers:
    """Return semi-transparent surfaces in front of focus over others far behind focus."""
    behind = np.minimum(radii, -0.5 * np.abs(radii).max()).astype(np.float32)
    coverage = np.where(radii > 0, 0.5, 1).astype(np.float32)
    return Layers(
        colors=np.stack([image, image[::-1, ::-1]], 2),
        defocus=np.stack([radii, behind], 2),
        coverage=np.stack([coverage, np.ones_like(coverage)], 2),
    )


def _width_height(megapixels: float) -> tuple[int, int]:
    """Return width and height with the ratio 3:2, multiples of 8 pixels."""
    height = 8 * round(math.sqrt(megapixels * 1e6 / 1.5) / 8)
    return 8 * round(1.5 * height / 8), height


def _first_calls(device: str) -> dict[str, float]:
    """Return the seconds of the first call of scatter and rays on the device, including compilation."""
    image, radii = scene(32, 24, 5)
    seconds = {}
    runs: dict[str, Callable[[], Any]] = {
        "scatter": lambda: scatter_on(device)(image, radii),
        "rays": lambda: render_rays(
            image, radii, device=Device(scatter_on(device), CudaMarch()), rays_factor=0.125
        ),
    }
    for name, run in runs.items():
        start = time.perf_counter()
        run()
        seconds[name] = time.perf_counter() - start
    return seconds


def measure_all(bench: Bench, sizes: list[float]) -> None:
    """Add all cases: the most important ones first, the largest pictures last."""
    middle = min(sizes, key=lambda size: abs(size - 1.5))
    wide = _width_height(middle)
    large = [size for size in sizes if size > 10]
    for size in sorted(set(sizes) - set(large)):
        _one_size(bench, size)
    if bench.simulated:  # the other cases run no device code
        return
    for engine in ("rays", "scatter", "hybrid", "fast", "neural"):
        bench.renderer(engine, *wide, BLURS["usual"] * wide[0], engine)
    for name, aperture in APERTURES.items():
        for extent, share in BLURS.items():
            if (name, extent) != ("disc", "usual"):
                bench.scatter(f"{name}, {extent} blur", *wide, share * wide[0], aperture)
                bench.rays(f"{name}, {extent} blur", *wide, share * wide[0], aperture)
    for changes in ("front", "behind", "lights", "layers"):
        bench.rays(f"disc, {changes}", *wide, BLURS["usual"] * wide[0], APERTURES["disc"], changes)
    small = _width_height(min(sizes))
    for name, aperture in APERTURES.items():
        for dtype in (torch.float32, torch.float64):
            label = f"{name}, {str(dtype).removeprefix('torch.')}"
            bench.gradients(label, *small, BLURS["usual"] * small[0], aperture, dtype)
    bench.gradients("disc, float32", *wide, BLURS["usual"] * wide[0], APERTURES["disc"], torch.float32)
    blur = BLURS["usual"] * wide[0]
    bench.renderer("rays, cat's-eye", *wide, blur, aperture=APERTURES["cat's-eye"])
    bench.renderer("rays, highlights", *wide, blur, options=RenderOptions(highlights=Highlights()))
    bench.renderer(
        "rays, in strips", *wide, blur, options=RenderOptions(max_memory=round(100 * wide[0] * wide[1]))
    )
    for size in sorted(large):
        _one_size(bench, size)


def _one_size(bench: Bench, megapixels: float) -> None:
    """Add scatter and rays of a disc at one size."""
    width, height = _width_height(megapixels)
    blur = (0.2 if bench.simulated else BLURS["usual"]) * width
    bench.scatter("disc", width, height, blur, APERTURES["disc"])
    bench.rays("disc", width, height, blur, APERTURES["disc"])


def _installed() -> dict[str, str]:
    """Return the versions of the relevant packages."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "missing"
    return versions


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder for cuda.json")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.4, 1.5, 6, 24], metavar="MEGAPIXELS")
    parser.add_argument(
        "--repeats", type=int, default=6, help="number of timed runs; half as many from 3 megapixels"
    )
    parser.add_argument(
        "--seconds", type=float, default=math.inf, help="time after which no further case starts"
    )
    arguments = parser.parse_args()
    has_device = torch.cuda.is_available()
    if not has_device and os.environ.get("NUMBA_ENABLE_CUDASIM") != "1":
        print(f"No CUDA device found by torch {torch.__version__}: simulating with tiny pictures.")
        parts = [sys.executable, "-W", "ignore", "-m", "benchmarks.gpu.cases", *sys.argv[1:]]
        raise SystemExit(subprocess.run(parts, env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}).returncode)
    device = "cuda" if has_device else "cpu"
    report = Report(arguments.out, arguments.seconds)
    report.content |= {
        "card": torch.cuda.get_device_name() if has_device else "simulated",
        "driver_memory_mb": torch.cuda.mem_get_info()[1] / 1e6 if has_device else 0,
        "cpu_threads": numba.get_num_threads(),
        "packages": _installed(),
    }
    print(json.dumps(report.content), flush=True)
    try:
        report.content["first_call_s"] = _first_calls(device)
        print("first calls, with compilation:", report.content["first_call_s"], flush=True)
    except Exception:
        report.content["first_call_failure"] = traceback.format_exc()
        print(traceback.format_exc(), flush=True)
    bench = Bench(report, arguments.repeats if has_device else 1, device)
    measure_all(bench, arguments.sizes if has_device else [0.0008])
    report.write()
    failed = sum("failure" in row for row in report.content["rows"])
    raise SystemExit(f"{failed} cases failed" if failed else 0)


if __name__ == "__main__":
    main()
