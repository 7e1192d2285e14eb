"""Time and memory as seen by a user: ``python -m benchmarks.speed.end_to_end [SECTION...]``.

photograph: every engine, warm, on a photograph of 1080x1350 pixels, compared with the published architecture
    in the same run: a scatter as a double loop over every disc, and ARNet and IUNet of the published widths
    over the whole picture, in torch. cold: the command line from start to the written file, in alternation
    with ``--help``. large: 24 megapixels with radii up to 160 pixels, and 100 megapixels with bounded memory,
    by the command line, with its peak memory. enlarged: a photograph and its map at 6, 24 and 100 megapixels,
    with default options, with a lens, in bounded memory, and with large radii. radii: the same photograph at
    24 megapixels, with discs of up to 39, 100, 200 and 400 pixels. bounded: 100 megapixels, discs of up to
    311 pixels, in bounded memory. trace: cores in use in each 0.1 s of one command line, Linux only. SHARED
    holds ``real/21.jpg`` with its disparity ``21.png``.
"""

import argparse
import multiprocessing
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.classical import BLUR, FOCUS, photograph
from benchmarks.figures import write_figures
from benchmarks.measurement import scene, time_in_turns
from benchmarks.methods.rivals import double_loop
from bokehnet.arrays.resample import resample
from bokehnet.classical.error_map import geometric_error_map
from bokehnet.engine_registry import ENGINES
from bokehnet.io.containers.png import write_png
from bokehnet.io.image import read_image, write_image, write_map
from bokehnet.io.maps import read_map
from bokehnet.render.renderer import BokehRenderer

PUBLISHED = "published wiring"


def published_wiring() -> Callable[[np.ndarray, np.ndarray], None]:
    """Return a renderer with the published networks, untrained, which cost the same as trained ones.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """
    import torch

    from bokehnet.inference.coarse_to_fine import render_neural
    from bokehnet.models.arnet import ARNet, ARNetConfig
    from bokehnet.models.iunet import IUNet, IUNetConfig

    arnet = ARNet(ARNetConfig(see_classical=False)).eval()
    iunet = IUNet(IUNetConfig(see_classical=False)).eval()

    def render(image: np.ndarray, defocus: np.ndarray) -> None:
        classical = double_loop(image, defocus)
        classical_error_map = geometric_error_map(defocus)
        arrays = (image, defocus[..., None], classical, classical_error_map[..., None])
        batch = [
            torch.from_numpy(np.ascontiguousarray(x.transpose(2, 0, 1), np.float32))[None] for x in arrays
        ]
        with torch.inference_mode():
            render_neural(
                *batch, arnet=arnet, iunet=iunet, network_max_radius=arnet.config.network_max_radius
            )

    return render


def photograph_section(shared: Path, rounds: int, figures: Path | None = None) -> None:
    """Print medians of all engines and the ratio of the published architecture to each."""
    image, defocus = photograph(shared)
    runs: dict[str, Callable[[], object]] = {}
    for name in ENGINES:
        renderer = BokehRenderer(name)
        renderer.render_arrays(image, defocus)
        runs[name] = lambda renderer=renderer: renderer.render_arrays(image, defocus)
    rival = published_wiring()
    rival(image[:64, :64].copy(), np.ascontiguousarray(defocus[:64, :64]))
    runs[PUBLISHED] = lambda: rival(image, defocus)
    rows = time_in_turns(runs, rounds)
    medians: dict[str, dict[str, float]] = {}
    print(
        f"== photograph: {image.shape[1]}x{image.shape[0]}, blur {BLUR:g}, medians of {rounds} rounds, warm"
    )
    for name in runs:
        ratio = statistics.median(row[PUBLISHED] / row[name] for row in rows)
        medians[name] = {"seconds": statistics.median(row[name] for row in rows), "ratio": ratio}
        print(f"{name:18s} {medians[name]['seconds']:7.2f} s  {ratio:6.1f}x", flush=True)
    if figures:
        conditions = (
            f"{image.shape[1]}x{image.shape[0]}, blur {BLUR:g}, medians of {rounds} rounds in turns, warm"
        )
        columns = {"seconds": ("median, s", ".2f"), "ratio": ("times as fast as the published wiring", ".1f")}
        write_figures(
            figures, "python -m benchmarks.speed.end_to_end photograph", conditions, columns, medians
        )


def run_command(*arguments: str) -> tuple[float, int]:
    """Return seconds and peak memory in bytes of one ``bokehnet`` command line. Linux only."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "bokehnet", *arguments]
    # As in an installation: modules are compiled once and not with each command.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    seconds = time.perf_counter() - start
    if process.returncode != 0:
        raise SystemExit(f"bokehnet {' '.join(arguments)}: exit code {process.returncode}")
    return seconds, usage.ru_maxrss * 1024


def cold_section(shared: Path, rounds: int) -> None:
    """Print medians of whole command lines with compiled kernels."""
    with tempfile.TemporaryDirectory() as folder:
        picture = [str(shared / "real/21.jpg"), "--disparity", str(shared / "real/21.png")]
        options = ["--blur", f"{BLUR:g}", "--focus", f"{FOCUS:g}", "-o", f"{folder}/out.png"]
        commands = {"--help": ["--help"], "render --help": ["render", "--help"]}
        for name in ENGINES:
            for refine in ("off", "auto"):
                extra = ["--engine", name, "--repair-disparity", refine]
                commands[" ".join(["render", *extra])] = ["render", *picture, *options, *extra]
        for arguments in commands.values():
            run_command(*arguments)
        runs = {
            name: lambda arguments=arguments: run_command(*arguments) for name, arguments in commands.items()
        }
        rows = time_in_turns(runs, rounds)
    print(f"== cold: from start to written file, medians of {rounds} rounds")
    for name in runs:
        print(f"{name:52s} {statistics.median(row[name] for row in rows):6.2f} s", flush=True)


def _write_scene(folder: str, width: int, height: int, blur: float) -> tuple[float, float]:
    """Write ``image.png`` and ``map.exr``; return the minimum and maximum defocus."""
    image, defocus = scene(width, height, blur)
    low, high = float(defocus.min()), float(defocus.max())
    write_image(f"{folder}/image.png", image)
    write_map(f"{folder}/map.exr", (defocus - low) / (high - low))
    return low, high


def large_section(engines: list[str]) -> None:
    """Print seconds and peak memory of large pictures; each is rendered once."""
    print("== large: through the command line, reading and writing included")
    cases = (((6000, 4000), 160.0, []), ((12000, 8400), 160.0, ["--max-memory", "4G"]))
    for (width, height), blur, extra in cases:
        with tempfile.TemporaryDirectory() as folder:
            # In a separate process: the peak memory of a child starts with that of its parent.
            with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
                low, high = pool.submit(_write_scene, folder, width, height, blur).result()
            for engine in engines:
                seconds, memory = run_command(
                    *("render", f"{folder}/image.png", "--disparity", f"{folder}/map.exr"),
                    *("--blur", f"{high - low:.9g}", "--focus", f"{-low / (high - low):.9g}"),
                    *("--engine", engine, "--repair-disparity", "off", "-o", f"{folder}/out.png", *extra),
                )
                print(
                    f"{width * height / 1e6:6.1f} MP, radius {blur:g}, {engine:8s} {' '.join(extra):18s}"
                    f"{seconds:7.1f} s {memory / 2**30:6.2f} GB",
                    flush=True,
                )


def _write_enlarged(shared: str, folder: str, width: int, height: int) -> None:
    """Write ``photo.jpg``, ``photo.exr`` and ``map.png`` (16 bit): photograph 21, enlarged."""
    image = resample(read_image(f"{shared}/real/21.jpg"), height, width)
    for extension in ("jpg", "exr"):
        write_image(f"{folder}/photo.{extension}", np.clip(image, 0, 1))
    values = resample(read_map(f"{shared}/real/21.png"), height, width)
    stored = np.rint(65535 * values).astype(np.uint16)[..., None]
    write_png(Path(folder) / "map.png", (height, width, 1), np.uint16, lambda rows: stored[rows])


# Size, blur, files in and out, options.
_Row = tuple[tuple[int, int], int, str, tuple[str, ...]]

_ENLARGED: tuple[_Row, ...] = (
    ((4380, 5475), 60, "jpg jpg", ()),
    ((4380, 5475), 60, "jpg jpg", ("--engine", "hybrid")),
    ((4380, 5475), 60, "jpg jpg", ("--lens", "double_gauss")),
    ((4380, 5475), 60, "jpg jpg", ("--preset", "petzval-swirl")),
    ((4380, 5475), 60, "jpg jpg", ("--max-memory", "2G")),
    ((4380, 5475), 60, "exr exr", ("--max-memory", "2G")),
    ((8944, 11180), 60, "jpg jpg", ("--max-memory", "4G")),
    ((8944, 11180), 60, "exr exr", ("--max-memory", "4G")),
    ((2190, 2738), 92, "jpg jpg", ()),
    ((2190, 2738), 185, "jpg jpg", ()),
    ((2190, 2738), 369, "jpg jpg", ()),
    ((2190, 2738), 615, "jpg jpg", ()),
)

_RADII: tuple[_Row, ...] = tuple(((4380, 5475), blur, "jpg jpg", ()) for blur in (60, 154, 308, 615))

_BOUNDED: tuple[_Row, ...] = (((8944, 11180), 480, "jpg jpg", ("--max-memory", "4G")),)

# Interval of the trace, seconds.
_TRACE_SECONDS = 0.1


def trace_section(shared: Path) -> None:
    """Print the cores in use over the time of one command line, from its start to the written file."""
    ticks = os.sysconf("SC_CLK_TCK")
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "bokehnet", "render", str(shared / "real/21.jpg")]
        words += ["--disparity", str(shared / "real/21.png"), "--blur", f"{BLUR:g}", "--focus", f"{FOCUS:g}"]
        run_command(*words[3:], "-o", f"{folder}/out.png")
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        start = before = time.perf_counter()
        process, used, idle = subprocess.Popen([*words, "-o", f"{folder}/out.png"], **quiet), 0.0, 0.0
        print("== trace: cores in use; # is half a core")
        while process.poll() is None:
            time.sleep(_TRACE_SECONDS)
            try:
                fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
            except (FileNotFoundError, ProcessLookupError):
                break
            now, total = time.perf_counter(), (int(fields[11]) + int(fields[12])) / ticks
            cores = (total - used) / (now - before)
            idle += (now - before) * max(0.0, min(2, os.cpu_count() or 1) - cores)
            print(f"{now - start:5.1f} s {cores:4.1f} {'#' * round(2 * cores)}", flush=True)
            before, used = now, total
        print(f"{time.perf_counter() - start:.1f} s, {used:.1f} processor s, {idle:.1f} core seconds idle")


def enlarged_section(shared: Path, rows: tuple[_Row, ...]) -> None:
    """Print seconds, processor time and peak memory of an enlarged photograph; each is rendered once."""
    print("== enlarged: photograph 21 and its map, through the command line, reading and writing included")
    before: tuple[int, int] | None = None
    with tempfile.TemporaryDirectory() as folder:
        for size, blur, files, extra in rows:
            if size != before:
                with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
                    pool.submit(_write_enlarged, str(shared), folder, *size).result()
                before = size
            source, target = files.split()
            start = os.times()
            seconds, memory = run_command(
                *("render", f"{folder}/photo.{source}", "--disparity", f"{folder}/map.png"),
                *("--blur", f"{blur}", "--focus", f"{FOCUS:g}", "-o", f"{folder}/out.{target}", *extra),
            )
            now = os.times()
            processor = now.children_user + now.children_system - start.children_user - start.children_system
            options = f"blur {blur:3d}, {source} to {target} {' '.join(extra):24s}"
            print(
                f"{size[0] * size[1] / 1e6:6.1f} MP, {options}"
                f"{seconds:7.1f} s, of processors {processor:7.1f} s, {memory / 2**30:6.2f} GB",
                flush=True,
            )


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    sections = ("photograph", "cold", "large", "enlarged", "radii", "bounded", "trace")
    parser.add_argument("sections", nargs="*", metavar="SECTION", default=sections, help=", ".join(sections))
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--figures", type=Path, help="JSON file for the documentation, of the section photograph"
    )
    parser.add_argument("--megapixels", type=float, default=100, help="maximum size of the section enlarged")
    parser.add_argument(
        "--engines", nargs="+", default=["rays", "hybrid"], help="engines of the section large"
    )
    arguments = parser.parse_args()
    for section in arguments.sections:
        if section == "photograph":
            photograph_section(arguments.shared, arguments.rounds, arguments.figures)
        elif section == "cold":
            cold_section(arguments.shared, arguments.rounds)
        elif section == "large":
            large_section(arguments.engines)
        elif section == "enlarged":
            max_pixels = 1e6 * arguments.megapixels
            enlarged_section(
                arguments.shared, tuple(it for it in _ENLARGED if it[0][0] * it[0][1] <= max_pixels)
            )
        elif section == "radii":
            enlarged_section(arguments.shared, _RADII)
        elif section == "bounded":
            enlarged_section(arguments.shared, _BOUNDED)
        elif section == "trace":
            trace_section(arguments.shared)
        else:
            parser.error(f"unknown section {section}; expected {', '.join(sections)}")


if __name__ == "__main__":
    main()
