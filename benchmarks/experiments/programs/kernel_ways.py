"""Toolchains for a kernel: ``python -m benchmarks.experiments.programs.kernel_ways [--megapixels 1]``.

All toolchains build the same kernel: every pixel writes the ends of its disc's rows, about 28 for a radius of
    9 pixels, as differences, four channels at a time, in one thread. Toolchains that are not installed are
    skipped with the reason. Prints the build seconds, the size of the result, the size of the packages for
    running and for building, the time relative to the first toolchain, the maximum difference to its result,
    and the lines of the kernel.
"""

import argparse
import ctypes
import importlib.util
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numba
import numpy as np

from bokehnet.classical.scatter.disc_scatter import _four
from bokehnet.classical.scatter.disc_table import disc_table, find_step
from bokehnet.classical.simd.double4 import add_interval

__all__ = ["WAYS", "Missing", "Way", "picture", "spread"]

MARGIN = 16  # pixels around the picture: no disc ends outside

SOURCE = """
def spread(values, start, end, along, places, weights, sums):
    height, width = start.shape
    for y in range(height):
        for x in range(width):
            a, b, c, d = values[y, x, 0], values[y, x, 1], values[y, x, 2], values[y, x, 3]
            for n in range(start[y, x], end[y, x]):
                s = weights[n, 0] + along[y, x] * weights[n, 1]
                left, right = x + 16 - places[n, 1], x + 17 + places[n, 1]
                for row in (y + 16 - places[n, 0], y + 16 + places[n, 0]):
                    sums[row, left, 0] += s * a
                    sums[row, left, 1] += s * b
                    sums[row, left, 2] += s * c
                    sums[row, left, 3] += s * d
                    sums[row, right, 0] -= s * a
                    sums[row, right, 1] -= s * b
                    sums[row, right, 2] -= s * c
                    sums[row, right, 3] -= s * d
"""

TYPES = "float32[:,:,:], int32[:,:], int32[:,:], float64[:,:], int16[:,:], float64[:,:], float64[:,:,:]"

CPP = """
#include <cstdint>
typedef double four __attribute__((vector_size(32), aligned(8)));
extern "C" void spread(const float *values, const int32_t *start, const int32_t *end, const double *along,
                       const int16_t *places, const double *weights, double *sums,
                       int64_t height, int64_t width) {
  const int64_t line = 4 * (width + 33);
  for (int64_t y = 0; y < height; ++y)
    for (int64_t x = 0; x < width; ++x) {
      const int64_t p = y * width + x;
      const float *v = values + 4 * p;
      const four value = {v[0], v[1], v[2], v[3]};
      for (int64_t n = start[p]; n < end[p]; ++n) {
        const four s = value * (weights[2 * n] + along[p] * weights[2 * n + 1]);
        const int64_t row = line * places[2 * n], column = 4 * places[2 * n + 1];
        double *middle = sums + line * (y + 16) + 4 * (x + 16);
        *(four *)(middle - row - column) += s;
        *(four *)(middle - row + column + 4) -= s;
        *(four *)(middle + row - column) += s;
        *(four *)(middle + row + column + 4) -= s;
      }
    }
}
"""


class Missing(Exception):  # noqa: N818  # not an error: the toolchain is skipped
    """Raised if a toolchain is not installed."""


Spread = Callable[..., None]


@dataclass(frozen=True, kw_only=True)
class Way:
    """Toolchain for the kernel.

    Attributes:
        build: Function that builds the kernel in a folder; returns it and the files for a wheel.
        run: Packages needed at run time, besides NumPy.
        make: Additional packages needed for building.
        lines: Lines of the kernel source.
        bare: What is available on a machine without a compiler.
    """

    build: Callable[[Path], tuple[Spread, list[Path]]]
    run: tuple[str, ...] = ()
    make: tuple[str, ...] = ()
    lines: int
    bare: str


def picture(width: int, height: int) -> tuple[np.ndarray, ...]:
    """Return the kernel inputs without the sums: random values, radii of 4 to 14 pixels, disc table."""
    rng = np.random.default_rng(0)
    table = disc_table()
    values = rng.random((height, width, 4), dtype=np.float32)
    radii = 9 + 5 * np.sin(np.arange(width) / 90) * np.cos(np.arange(height) / 70)[:, None]
    start, end = np.empty((2, height, width), np.int32)
    along = np.empty((height, width))
    for y in range(height):
        for x in range(width):
            step, along[y, x], far = find_step.function(table, radii[y, x])
            start[y, x], end[y, x] = table.first[step, 0], table.first[step, far + 1]
    return values, start, end, along, np.ascontiguousarray(table.places), np.ascontiguousarray(table.weights)


def spread() -> Spread:
    """Return the kernel in Python."""
    names: dict[str, Any] = {}
    exec(SOURCE, names)
    function: Spread = names["spread"]
    return function


def _four_wide(values, start, end, along, places, weights, sums):  # type: ignore[no-untyped-def]
    height, width = start.shape
    line = 4 * (width + 33)
    flat = sums.reshape(-1)
    for y in range(height):
        for x in range(width):
            value = _four(values, y, x)
            middle = line * (y + 16) + 4 * (x + 16)
            for n in range(start[y, x], end[y, x]):
                s = weights[n, 0] + along[y, x] * weights[n, 1]
                row, column = line * np.int64(places[n, 0]), 4 * np.int64(places[n, 1])
                add_interval(flat, middle - row - column, middle - row + column + 4, s, value)
                add_interval(flat, middle + row - column, middle + row + column + 4, s, value)


def _vectors(folder: Path) -> tuple[Spread, list[Path]]:
    return _compiled(_four_wide, folder)


def _numba(folder: Path) -> tuple[Spread, list[Path]]:
    return _compiled(spread(), folder)


def _compiled(function: Spread, folder: Path) -> tuple[Spread, list[Path]]:
    kernel = numba.njit(function)
    kernel.compile(f"void({TYPES.replace(':]', '::1]')})")
    object_file = folder / "kernel.o"
    library = kernel.overloads[kernel.signatures[0]].library
    object_file.write_bytes(library._get_compiled_object())
    return kernel, [object_file]


def _cpp(folder: Path) -> tuple[Spread, list[Path]]:
    source, library = folder / "kernel.cpp", folder / "kernel.so"
    source.write_text(CPP, "utf-8")
    _call("g++", "-O3", "-march=native", "-shared", "-fPIC", "-s", str(source), "-o", str(library))
    function = ctypes.CDLL(str(library)).spread
    function.restype = None

    def run(*arrays: np.ndarray) -> None:
        height, width = arrays[1].shape
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        function(*pointers, ctypes.c_int64(height), ctypes.c_int64(width))

    return run, [library]


def _pythran(folder: Path) -> tuple[Spread, list[Path]]:
    _need("pythran")
    source = folder / "pythran_kernel.py"
    source.write_text(f"#pythran export spread({TYPES})\n{SOURCE}", "utf-8")
    library = folder / f"pythran_kernel{sysconfig.get_config_var('EXT_SUFFIX')}"
    _call(sys.executable, "-m", "pythran.run", "-O3", "-march=native", str(source), "-o", str(library))
    spec = importlib.util.spec_from_file_location("pythran_kernel", library)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.spread, [library]


def _halide(folder: Path) -> tuple[Spread, list[Path]]:
    _need("halide")
    import halide as hl

    values = hl.ImageParam(hl.Float(32), 3, "values")
    start, end = hl.ImageParam(hl.Int(32), 2, "start"), hl.ImageParam(hl.Int(32), 2, "end")
    along, places = hl.ImageParam(hl.Float(64), 2, "along"), hl.ImageParam(hl.Int(16), 2, "places")
    weights = hl.ImageParam(hl.Float(64), 2, "weights")
    max_length = hl.Param(hl.Int(32), "max_length")
    c, x, y = hl.Var("c"), hl.Var("x"), hl.Var("y")
    sums = hl.Func("sums")
    sums[c, x, y] = hl.f64(0)
    r = hl.RDom([(0, 4), (0, max_length), (0, start.dim(0).extent()), (0, start.dim(1).extent())])
    q, n, px, py = r[0], r[1], r[2], r[3]
    r.where(n < end[px, py] - start[px, py])
    i = hl.unsafe_promise_clamped(start[px, py] + n, 0, places.dim(1).extent() - 1)
    row, column = hl.i32(places[0, i]), hl.i32(places[1, i])
    up, left = q < 2, q % 2 == 0
    to_x = px + 16 + hl.select(left, -column, column + 1)
    to_y = py + 16 + hl.select(up, -row, row)
    to_x = hl.unsafe_promise_clamped(to_x, 0, start.dim(0).extent() + 32)
    to_y = hl.unsafe_promise_clamped(to_y, 0, start.dim(1).extent() + 31)
    strength = weights[0, i] + along[px, py] * weights[1, i]
    light = strength * hl.f64(values[c, px, py])
    sums[c, to_x, to_y] += hl.select(left, light, -light)
    sums.bound(c, 0, 4).vectorize(c, 4)
    sums.update(0).reorder(c, q, n, px, py).vectorize(c, 4).unroll(q)
    target = hl.get_host_target()
    inputs = [values, start, end, along, places, weights, max_length]
    sums.compile_to_static_library(str(folder / "halide_kernel"), inputs, "spread", target)
    sums.compile_jit(target)
    library = folder / "halide_kernel.so"
    archive = str(folder / "halide_kernel.a")
    _call(
        "gcc", "-shared", "-s", "-Wl,--whole-archive", archive, "-Wl,--no-whole-archive", "-o", str(library)
    )

    def run(*arrays: np.ndarray) -> None:
        buffers = [hl.Buffer(array) for array in arrays]
        for parameter, buffer in zip(inputs, buffers[:-1], strict=False):
            parameter.set(buffer)
        max_length.set(int((arrays[2] - arrays[1]).max()))
        sums.realize(buffers[-1])

    return run, [library]


# Toolchains by name; the others are compared with the first.
WAYS = {
    "numba with vectors, as the package": Way(
        build=_vectors,
        run=("numba", "llvmlite"),
        lines=14,
        bare="all of it, precompiled or at the first call",
    ),
    "numba": Way(
        build=_numba, run=("numba", "llvmlite"), lines=18, bare="all of it, compiled at the first call"
    ),
    "C++ with vector types": Way(build=_cpp, lines=23, bare="a wheel for its system, else nothing"),
    "Pythran": Way(
        build=_pythran,
        make=("pythran", "beniget", "gast", "ply"),
        lines=19,
        bare="a wheel for its system and version of Python, else the same Python, uncompiled",
    ),
    "Halide": Way(
        build=_halide,
        make=("halide",),
        lines=26,
        bare="a wheel for its system, else nothing; or halide itself",
    ),
}


def _need(package: str) -> None:
    if importlib.util.find_spec(package) is None:
        raise Missing(f"{package} is not installed: pip install {package}")


def _call(*words: str) -> None:
    try:
        subprocess.run(words, check=True, capture_output=True, text=True)
    except FileNotFoundError as error:
        raise Missing(f"{words[0]} is not installed") from error
    except subprocess.CalledProcessError as error:
        raise Missing(f"{words[0]} failed: {error.stderr.strip().splitlines()[-1]}") from error


def _megabytes(packages: tuple[str, ...]) -> float:
    total = 0
    for package in packages:
        try:
            files = distribution(package).files or ()
        except PackageNotFoundError:
            continue
        total += sum(path.stat().st_size for file in files if (path := Path(str(file.locate()))).is_file())
    return total / 1e6


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--megapixels", type=float, default=0.25)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    side = round((1e6 * arguments.megapixels) ** 0.5)
    inputs = picture(side, side)
    built: dict[str, tuple[Spread, float, int]] = {}
    results: dict[str, np.ndarray] = {}
    with tempfile.TemporaryDirectory() as name:
        for number, (way, toolchain) in enumerate(WAYS.items()):
            folder = Path(name, str(number))
            folder.mkdir()
            start = time.perf_counter()
            try:
                kernel, files = toolchain.build(folder)
            except Missing as reason:
                print(f"{way}: skipped, {reason}")
                continue
            built[way] = kernel, time.perf_counter() - start, sum(file.stat().st_size for file in files)
            results[way] = np.zeros((side + 2 * MARGIN, side + 2 * MARGIN + 1, 4))
            kernel(*inputs, results[way])
        seconds: dict[str, list[float]] = {way: [] for way in built}
        for _ in range(arguments.rounds):
            for way, (kernel, _, _) in built.items():
                sums = np.zeros_like(results[way])
                start = time.process_time()
                kernel(*inputs, sums)
                seconds[way].append(time.process_time() - start)
    print(
        "| way | build, s | made, KB | run takes, MB | build takes, MB "
        "| time | difference | lines | bare machine |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    first = next(iter(built))
    for way, (_, build, size) in built.items():
        toolchain = WAYS[way]
        ratio = statistics.median(a / b for a, b in zip(seconds[way], seconds[first], strict=True))
        difference = float(np.abs(results[way] - results[first]).max())
        cells = (
            f"{build:.1f}", f"{size / 1e3:.0f}",
            f"{_megabytes(toolchain.run):.0f}", f"{_megabytes(toolchain.make):.0f}",
            f"{ratio:.2f}", f"{difference:.0e}", f"{toolchain.lines}", toolchain.bare,
        )  # fmt: skip
        print(f"| {way} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
