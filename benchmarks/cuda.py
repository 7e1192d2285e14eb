"""Agreement and speed on a CUDA device: ``python -m benchmarks.cuda --out FOLDER``.

Renders the same arrays on the device and on the CPU of the same machine. A row states how far the two
agree, the median time of each after a warm-up, the share of the copies between host and device, and the
device memory at its peak. Rows: scatter, gradients of the scatter, rays, and whole renderers. A case that
fails keeps its traceback in the report, and the others go on. Without a device the same cases run on
pictures of a few pixels: scatter by torch on the CPU, rays in numba's simulator of a device.
"""

import argparse
import importlib.metadata
import json
import math
import os
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch

from benchmarks.measurement import median_seconds, scene
from bokehnet.classical.cuda.march import CudaMarch, cuda
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.march import ray_marching
from bokehnet.classical.rays_renderer import Device, render_rays
from bokehnet.classical.scatter_renderer import scatter
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

# Largest radius, as a share of the picture's width.
BLURS = {"small": 0.006, "usual": 0.02, "large": 0.06}

# Differences beyond which a pixel is counted, in scene-linear light.
LIMITS = (1e-5, 1e-3, 1e-2)

PACKAGES = ("numpy", "numba", "numba-cuda", "llvmlite", "torch", "onnxruntime")


class Report:
    """Rows of the table, printed and written as they come.

    Args:
        folder: Of ``cuda.json``; ``None`` writes none.
        seconds: Time after which cases are left out.
    """

    def __init__(self, folder: Path | None, seconds: float) -> None:
        self._folder, self._end = folder, time.monotonic() + seconds
        self.content: dict[str, Any] = {"rows": []}

    def add(self, part: str, name: str, megapixels: float, measure: Callable[[], dict[str, Any]]) -> None:
        """Measure a case, print its row and keep it; a failure is kept with its traceback."""
        row: dict[str, Any] = {"part": part, "case": name, "megapixels": megapixels}
        if time.monotonic() > self._end:
            row["left_out"] = "no time left"
        else:
            try:
                row |= measure()
            except Exception as error:
                row |= {"failure": f"{type(error).__name__}: {error}", "traceback": traceback.format_exc()}
        self.content["rows"].append(row)
        print(_line(row), flush=True)
        self.write()

    def write(self) -> None:
        """Write what there is so far."""
        if self._folder is not None:
            self._folder.mkdir(parents=True, exist_ok=True)
            (self._folder / "cuda.json").write_text(json.dumps(self.content, indent=1) + "\n", "utf-8")


def _line(row: dict[str, Any]) -> str:
    """One line of the table."""
    start = f"{row['part']:9s} {row['case']:26s} {row['megapixels']:6.2f} MP "
    if "failure" in row:
        return start + f"FAILED {row['failure'].splitlines()[0][:150]}"
    if "left_out" in row:
        return start + row["left_out"]
    words = [f"{row['psnr_db']:5.0f} dB, max {row['max_difference']:.1e}, {row['differing'][1]} px > 1e-3"]
    if "device_s" in row:
        copies = f" ({1000 * row['copies_s']:.1f} copies)" if "copies_s" in row else ""
        words.append(f"{1000 * row['device_s']:.1f} ms{copies}")
    if "cpu_s" in row:
        words.append(f"CPU {1000 * row['cpu_s']:.0f} ms")
    if "peak_mb" in row:
        words.append(f"{row['peak_mb']:.0f} MB")
    return start + "; ".join(words) + ("" if row.get("repeatable", True) else "; DIFFERS FROM RUN TO RUN")


def agreement(found: np.ndarray, wanted: np.ndarray) -> dict[str, Any]:
    """Compare a picture of the device with the CPU's.

    Returns:
        PSNR in dB of light 1, largest difference absolute and over max(light, 1), and the pixels whose
        difference in any channel exceeds each of ``LIMITS``.
    """
    difference = np.abs(found.astype(float) - wanted)
    worst = difference.reshape(*difference.shape[:2], -1).max(-1)
    return {
        "psnr_db": -10 * math.log10(max(float(np.mean(difference**2)), 1e-30)),
        "max_difference": float(difference.max()),
        "max_relative": float((difference / np.maximum(np.abs(wanted), 1)).max()),
        "differing": [int(np.count_nonzero(~(worst <= limit))) for limit in LIMITS],
        "pixels": int(worst.size),
    }


class CardMemory:
    """Memory of the whole device beyond that at the start, bytes, sampled while it is open."""

    def __enter__(self) -> "CardMemory":
        self.peak, self._ends = 0, threading.Event()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
            torch.cuda.empty_cache()
        self._before = self._used()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._ends.wait(0.002):
            self.peak = max(self.peak, self._used() - self._before)

    @staticmethod
    def _used() -> int:
        if not torch.cuda.is_available():
            return 0
        free, total = torch.cuda.mem_get_info()
        return total - free


def synchronize() -> None:
    """Wait for the device, where there is one."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()


class Bench:
    """The cases on one device.

    Args:
        report: Where their rows go.
        repeats: Timed runs of each.
        device: Of torch, ``cuda`` or ``cpu``.
    """

    def __init__(self, report: Report, repeats: int, device: str) -> None:
        self.report, self.repeats, self.device = report, repeats, device
        self.simulated = device == "cpu"

    def _seconds(self, run: Callable[[], Any], megapixels: float, share: int = 1) -> float:
        """Median time of a run that was run before; fewer runs of large pictures."""

        def whole() -> None:
            run()
            synchronize()

        repeats = self.repeats if megapixels < 3 else self.repeats // 2
        return median_seconds(whole, max(1, repeats // share))

    def scatter(self, name: str, width: int, height: int, blur: float, aperture: Aperture) -> None:
        """Add the scatter of arrays, and of tensors that are on the device already."""
        megapixels = width * height / 1e6

        def measure() -> dict[str, Any]:
            image, radii = scene(width, height, blur)
            there = partial(scatter_on(self.device), image, radii, aperture)
            here = partial(scatter, image, radii, aperture)
            found, again, wanted = there(), there(), here()
            row = agreement(found, wanted) | {"repeatable": bool((found == again).all())}
            colors, blurs = torch.from_numpy(image).to(self.device), torch.from_numpy(radii).to(self.device)
            values = torch.cat([colors, torch.ones_like(colors[..., :1])], -1)

            def copies() -> None:
                for array in (image, radii):
                    torch.from_numpy(array).to(self.device)
                colors.cpu()

            if not self.simulated:
                torch.cuda.empty_cache()
                torch.cuda.reset_peak_memory_stats()
                there()
                row["peak_mb"] = torch.cuda.max_memory_allocated() / 1e6
            return row | {
                "device_s": self._seconds(there, megapixels),
                "resident_s": self._seconds(lambda: scatter_sums(values, blurs, aperture), megapixels),
                "copies_s": self._seconds(copies, megapixels),
                "cpu_s": self._seconds(here, megapixels, 2),
            }

        self.report.add("scatter", name, megapixels, measure)

    def gradients(
        self, name: str, width: int, height: int, blur: float, aperture: Aperture, dtype: Any
    ) -> None:
        """Add forward and backward of the differentiable scatter, gradients over their largest value."""
        megapixels = width * height / 1e6

        def run(device: str) -> Callable[[], list[torch.Tensor]]:
            arrays = [torch.from_numpy(array).to(device, dtype) for array in scene(width, height, blur)]
            image, radii = (tensor.requires_grad_() for tensor in arrays)
            generator = torch.Generator().manual_seed(0)
            weights = torch.rand(height, width, 3, generator=generator).to(device, dtype)

            def whole() -> list[torch.Tensor]:
                bokeh = autograd.scatter(image, radii, aperture)
                return [bokeh.detach(), *torch.autograd.grad(bokeh, (image, radii), weights)]

            return whole

        def measure() -> dict[str, Any]:
            there, here = run(self.device), run("cpu")
            found, again, wanted = there(), there(), here()
            row = agreement(found[0].cpu().numpy(), wanted[0].numpy())
            for key, one, other in zip(("image", "defocus"), found[1:], wanted[1:], strict=True):
                largest = other.abs().max()
                row[f"{key}_gradient"] = agreement((one.cpu() / largest).numpy(), (other / largest).numpy())
            row["repeatable"] = all(bool((a == b).all()) for a, b in zip(found, again, strict=True))
            if not self.simulated:
                torch.cuda.reset_peak_memory_stats()
                there()
                row["peak_mb"] = torch.cuda.max_memory_allocated() / 1e6
            return row | {
                "device_s": self._seconds(there, megapixels),
                "cpu_s": self._seconds(here, megapixels, 2),
            }

        self.report.add("gradients", name, megapixels, measure)

    def rays(
        self, name: str, width: int, height: int, blur: float, aperture: Aperture, changes: str = ""
    ) -> None:
        """Add the rays renderer; ``changes`` of the scene: front, behind, lights, layers."""
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
            on_card = Device(scatter_on(self.device), march)
            there = partial(render_rays, image, radii, aperture, on_card, **options)
            here = partial(render_rays, image, radii, aperture, Device(scatter, cpu_march), **options)
            with CardMemory() as memory:
                found = there()
            wanted = here()
            row = agreement(found.bokeh, wanted.bokeh) | {"peak_mb": memory.peak / 1e6}
            row["disocclusion"] = agreement(found.disocclusion_weight, wanted.disocclusion_weight)
            march.reset(copies=True)
            row["repeatable"] = bool((found.bokeh == there().bokeh).all())
            row |= {"copies_s": march.copied, "copied_mb": march.bytes / 1e6}
            for key, timed, run in (("device", march, there), ("cpu", cpu_march, here)):
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
            there = partial(
                BokehRenderer(engine, device=device, aperture=aperture).render_arrays,
                image,
                radii,
                options=options,
            )
            here = partial(
                BokehRenderer(engine, aperture=aperture).render_arrays, image, radii, options=options
            )
            found = there()
            first = time.perf_counter() - start
            row = agreement(found.bokeh, here().bokeh) | {"first_s": first}
            if not self.simulated:
                with CardMemory() as memory:
                    there()
                row["peak_mb"] = memory.peak / 1e6
            return row | {
                "device_s": self._seconds(there, megapixels),
                "cpu_s": self._seconds(here, megapixels, 2),
            }

        self.report.add("renderer", name, megapixels, measure)


def _two_layers(image: np.ndarray, radii: np.ndarray) -> Layers:
    """Half-transparent surfaces in front of focus before others far behind it."""
    behind = np.minimum(radii, -0.5 * np.abs(radii).max()).astype(np.float32)
    coverage = np.where(radii > 0, 0.5, 1).astype(np.float32)
    return Layers(
        colors=np.stack([image, image[::-1, ::-1]], 2),
        defocus=np.stack([radii, behind], 2),
        coverage=np.stack([coverage, np.ones_like(coverage)], 2),
    )


class TimedMarch:
    """A march whose calls are timed.

    Args:
        march: As ``send`` of :func:`bokehnet.classical.layered.march.ray_marching.march`.

    Attributes:
        seconds: Time inside all calls.
        renders: Pictures that were marched.
        copied: Seconds of the copies between host and device.
        bytes: What they move.
    """

    def __init__(self, march: Callable[..., None]) -> None:
        self._march = march
        self.reset()

    def reset(self, copies: bool = False) -> None:
        """Begin anew; with ``copies`` those to and from the device are made and timed once more."""
        self._copies = copies
        self.renders, self.seconds, self.copied, self.bytes = 0, 0.0, 0.0, 0

    def __call__(self, *arguments: Any) -> None:
        """Send rays."""
        colors, cells, mask, bins, points, chances, weights = arguments[:7]
        counts, sums = arguments[-2:]
        is_new = arguments[-4] == arguments[-3] == 0  # row and rays where the call begins
        self.renders += is_new
        if self._copies:
            means, kept = cuda.device_array(sums.shape, sums.dtype), np.array(sums)
            sent = [counts, *((colors, cells, mask, *bins[:3], points, chances, weights) if is_new else ())]
            start = time.perf_counter()
            there = [cuda.to_device(array) for array in sent]
            means.copy_to_host(kept)
            self.copied += time.perf_counter() - start
            self.bytes += sums.nbytes + sum(array.nbytes for array in sent)
            del there
        start = time.perf_counter()
        self._march(*arguments)
        self.seconds += time.perf_counter() - start


def _width_height(megapixels: float) -> tuple[int, int]:
    """A picture of 3:2, whole multiples of 8 pixels."""
    height = 8 * round(math.sqrt(megapixels * 1e6 / 1.5) / 8)
    return 8 * round(1.5 * height / 8), height


def _first_calls(device: str) -> dict[str, float]:
    """Seconds of the first call of scatter and rays on the device, compilation included."""
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
    """Add all cases, those that matter most first and the largest pictures last."""
    middle = min(sizes, key=lambda size: abs(size - 1.5))
    wide = _width_height(middle)
    large = [size for size in sizes if size > 10]
    for size in sorted(set(sizes) - set(large)):
        _one_size(bench, size)
    if bench.simulated:  # the other cases run no code of a device
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
    """Versions of the packages that matter, of those that are there."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="folder of cuda.json")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.4, 1.5, 6, 24], metavar="MEGAPIXELS")
    parser.add_argument(
        "--repeats", type=int, default=6, help="timed runs; half of them from 3 megapixels on"
    )
    parser.add_argument("--seconds", type=float, default=math.inf, help="then no case is begun any more")
    arguments = parser.parse_args()
    here = torch.cuda.is_available()
    if not here and os.environ.get("NUMBA_ENABLE_CUDASIM") != "1":
        print(
            f"There is no CUDA device here (torch {torch.__version__} finds none): simulated, tiny pictures."
        )
        words = [sys.executable, "-W", "ignore", "-m", "benchmarks.cuda", *sys.argv[1:]]
        raise SystemExit(subprocess.run(words, env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}).returncode)
    device = "cuda" if here else "cpu"
    report = Report(arguments.out, arguments.seconds)
    report.content |= {
        "card": torch.cuda.get_device_name() if here else "simulated",
        "driver_memory_mb": torch.cuda.mem_get_info()[1] / 1e6 if here else 0,
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
    bench = Bench(report, arguments.repeats if here else 1, device)
    measure_all(bench, arguments.sizes if here else [0.0008])
    report.write()
    failed = sum("failure" in row for row in report.content["rows"])
    raise SystemExit(f"{failed} cases failed" if failed else 0)


if __name__ == "__main__":
    main()
