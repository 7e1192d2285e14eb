"""The engines and the scatter's gradients on a CUDA device: ``python -m benchmarks.gpu``.

Renders a picture by each engine there and on this machine's cores, and prints times and how far the two
agree. Then it times forward and backward of the torch operations, counts the bytes that they move through
memory, and sets the rate beside the card's peak and beside that of a plain copy on it. The numba kernels
render the same picture on this machine's cores in the same run: the sums must agree. Without a CUDA device
it says so, and how far what a device would do agrees with the CPU: the scatter by torch on the CPU, the
rays in numba's simulator of a device, on a picture of a few pixels. ``--device cpu`` shows that the rest of
the command works, on a small picture.
"""

import argparse
import math
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from benchmarks.measurement import median_seconds, scene
from bokehnet.classical.scatter import pyramid_levels
from bokehnet.classical.torch.pyramid_levels import scatter_sums
from bokehnet.engines.engine import Engine

__all__ = ["Traffic", "main"]

# Operations that touch only the entries they are given an index for; the others read and write all of
# their tensors.
_READS_SOME = {"aten::index_select", "aten::index"}
_WRITES_SOME = {"aten::index_add", "aten::index_add_", "aten::index_put_", "aten::_index_put_impl_"}
_TOUCHES_NOTHING = {"aten::empty", "aten::empty_like", "aten::new_empty", "aten::empty_strided"}


def _size(tensors: Any) -> int:
    """Bytes of all tensors in a nest of arguments."""
    return sum(
        leaf.numel() * leaf.element_size() for leaf in tree_leaves(tensors) if isinstance(leaf, Tensor)
    )


class Traffic(TorchDispatchMode):
    """Counts the bytes that torch operations read and write, as if none of them met a cache."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes = 0
        self.operations = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Run one operation and add what it moves."""
        result = func(*args, **(kwargs or {}))
        name = func._schema.name
        aliases = [value.alias_info for value in func._schema.returns]
        if name in _TOUCHES_NOTHING or (aliases and all(alias and not alias.is_write for alias in aliases)):
            return result
        self.operations += 1
        if name in _READS_SOME:
            self.bytes += _size(args[1:]) + 2 * _size(result)
        elif name in _WRITES_SOME:  # the last argument is added: it is read, and so are the places it goes to
            self.bytes += _size(args[1:]) + 2 * _size(args[3] if "index_add" in name else args[2])
        else:
            self.bytes += _size([args, kwargs]) + _size(result)
        return result


def _seconds(run: Callable[[], Any], device: torch.device, repeats: int) -> float:
    """Median time of one run, from its start to the device's last operation, after one to warm up."""

    def whole() -> None:
        run()
        if device.type == "cuda":
            torch.cuda.synchronize(device)

    whole()
    return median_seconds(whole, repeats)


def _peak(device: torch.device) -> float | None:
    """The card's memory bandwidth by its data, bytes/s; None where torch does not know them."""
    card = torch.cuda.get_device_properties(device)
    clock, width = getattr(card, "memory_clock_rate", 0), getattr(card, "memory_bus_width", 0)
    return 2 * 1000 * clock * width / 8 or None  # kHz; two transfers in each cycle


def _copy_rate(device: torch.device, repeats: int) -> float:
    """What a plain copy of one gigabyte reaches, bytes/s."""
    source = torch.rand(1 << 28, device=device)
    target = torch.empty_like(source)
    return 2 * _size(source) / _seconds(lambda: target.copy_(source), device, repeats)


def _rate(moved: float, seconds: float, ceilings: dict[str, float]) -> str:
    """Bytes per second, and the share of each ceiling."""
    shares = "".join(f", {moved / seconds / ceiling:4.0%} of {name}" for name, ceiling in ceilings.items())
    return f"{moved / seconds / 1e9:8.1f} GB/s{shares}"


def measure(width: int, height: int, blur: float, device: torch.device, repeats: int) -> None:
    """Print the table for one picture."""
    image, radii = scene(width, height, blur)
    picture = np.concatenate([image, np.ones((height, width, 1), np.float32)], axis=2)
    values, defocus = (torch.from_numpy(array).to(device).requires_grad_() for array in (picture, radii))
    gradient = torch.rand(values.shape, device=device)
    ceilings = {}
    if device.type == "cuda":
        peak = _peak(device)
        if peak:
            ceilings["the card's peak"] = peak
        ceilings["a copy's rate"] = _copy_rate(device, repeats)
        for name, rate in ceilings.items():
            print(f"{name:16s}{rate / 1e9:10.1f} GB/s")
        torch.cuda.reset_peak_memory_stats(device)
    held = torch.cuda.memory_allocated(device) if device.type == "cuda" else 0

    sums = scatter_sums(values, defocus)

    def forward() -> None:
        with torch.no_grad():
            scatter_sums(values, defocus)

    def backward() -> None:
        torch.autograd.grad(sums, (values, defocus), gradient, retain_graph=True)

    least = {
        "forward": _size([values, defocus, sums]),
        "backward": _size([values, defocus, gradient]) + _size([values, defocus]),
    }
    for name, run in (("forward", forward), ("backward", backward)):
        seconds = _seconds(run, device, repeats)
        with Traffic() as traffic:
            run()
        print(f"{name:10s}{1000 * seconds:10.2f} ms  {_rate(traffic.bytes, seconds, ceilings)}")
        print(
            f"          {traffic.bytes / 1e9:.2f} GB in {traffic.operations} operations; "
            f"all inputs and results once are {least[name] / 1e9:.3f} GB"
        )
    if device.type == "cuda":
        used = torch.cuda.max_memory_allocated(device) - held
        print(f"memory    {used / 1e6:10.0f} MB beyond inputs, at most")
    wanted = pyramid_levels.scatter_forward(picture, radii)
    seconds = median_seconds(lambda: pyramid_levels.scatter_forward(picture, radii), max(1, repeats // 4))
    print(
        f"numba     {1000 * seconds:10.2f} ms  forward on {numba.get_num_threads()} threads of this machine"
    )
    error = float(np.sqrt(np.mean((sums.detach().cpu().numpy() - wanted) ** 2)))
    print(f"sums agree with numba's to {-20 * math.log10(max(error, 1e-12)):.0f} dB")


def measure_engines(width: int, height: int, blur: float, device: str, repeats: int) -> None:
    """Print a line for each engine: milliseconds on the device and on the cores, and decibels between."""
    image, radii = scene(width, height, blur)
    for name in ("scatter", "rays", "hybrid"):
        there, here = Engine(name, device=device), Engine(name)
        found, wanted = there.render(image, radii).bokeh, here.render(image, radii).bokeh
        times = [
            1000 * median_seconds(lambda engine=engine: engine.render(image, radii), count)
            for engine, count in ((there, repeats), (here, max(1, repeats // 10)))
        ]
        error = float(np.sqrt(np.mean((found - wanted) ** 2)))
        print(
            f"{name:8s}{times[0]:10.2f} ms there, {times[1]:.0f} ms on "
            f"{numba.get_num_threads()} threads here; agree to {-20 * math.log10(max(error, 1e-12)):.0f} dB"
        )


def simulate(width: int, height: int, blur: float) -> None:
    """Print how far pictures by a device's own code agree with the CPU's, in a simulator of a device."""
    from bokehnet.classical.cuda.march import CudaMarch
    from bokehnet.classical.rays_renderer import Device, render_rays
    from bokehnet.classical.scatter_renderer import scatter
    from bokehnet.classical.torch.device_scatter import scatter_on

    image, radii = scene(width, height, blur)
    device = Device(scatter_on("cpu"), CudaMarch())
    wanted = {"scatter": scatter(image, radii), "rays": render_rays(image, radii, rays_factor=0.125).bokeh}
    simulated = render_rays(image, radii, rays_factor=0.125, device=device).bokeh
    found = {"scatter": device.scatter(image, radii), "rays": simulated}
    for name, picture in found.items():
        error = float(np.sqrt(np.mean((picture - wanted[name]) ** 2)))
        told = -20 * math.log10(max(error, 1e-12))
        print(f"{name:8s}by the device's code, simulated: {width}x{height}, agrees to {told:.0f} dB")


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1920, 1080), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--blur", type=float, default=60.0, help="largest radius, pixels")
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--simulated", action="store_true", help="what is printed where there is no device")
    arguments = parser.parse_args()
    if arguments.simulated:
        simulate(32, 24, 6.0)
        return
    device = torch.device(arguments.device)
    if device.type == "cuda" and not torch.cuda.is_available():
        print(
            f"There is no CUDA device here (torch {torch.__version__} finds none): nothing was measured. "
            "--device cpu --size 480 270 --blur 15 shows that the command works.",
            flush=True,
        )
        words = [sys.executable, "-W", "ignore", "-m", "benchmarks.gpu", "--simulated"]
        subprocess.run(words, env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1"}, check=True)
        return
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else "CPU"
    width, height = arguments.size
    print(f"{name}, torch {torch.__version__}: {width}x{height}, largest blur {arguments.blur:g} px")
    measure_engines(width, height, arguments.blur, device.type, arguments.repeats)
    measure(width, height, arguments.blur, device, arguments.repeats)


if __name__ == "__main__":
    main()
