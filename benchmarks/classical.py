"""Speed, memory and quality of the classical renderers: ``python -m benchmarks.classical SECTION...``.

speed: the scatter on a photograph compared with a literal double loop and GEGL's lens blur, in alternation,
    on one core and on all. scaling: seconds and memory by picture size and radius. rays: time and noise of
    the rays on the same photograph. shapes: cost of other apertures than the disc. quality: PSNR and SSIM on
    ray-traced
planes and on path-traced scenes. SHARED holds ``real/21.jpg`` with its disparity ``21.png`` and the
path-traced scenes in ``cycles``.
"""

import argparse
import math
import statistics
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np

from benchmarks.measurement import extra_memory, in_own_process, median_seconds, scene, time_in_turns
from benchmarks.methods.rivals import double_loop, open_lens_blur
from benchmarks.quality.cycles import read_shots, scene_folders
from benchmarks.quality.tables.score_table import Engine, Row, print_header, print_scores, score
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity
from train.scores.metrics import compare

BLUR, FOCUS = 60.0, 90 / 255
LOOP, GEGL = "double loop", "GEGL lens-blur"
LARGE = 8.0  # px; minimum radius of discs for which whole and fractional pixels hardly differ


# Classical renderers without their error maps.
ENGINES: dict[str, Engine] = {"scatter": scatter, "rays": rays}


def photograph(shared: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return picture 21, (H, W, 3), and its defocus in pixels, (H, W)."""
    disparity = read_disparity(shared / "real/21.png")
    return read_image(shared / "real/21.jpg"), defocus_from_disparity(disparity, BLUR, FOCUS)


def warm_up(render: Engine) -> None:
    """Let numba compile the kernels or load them from its cache."""
    render(np.zeros((64, 64, 3), np.float32), np.ones((64, 64), np.float32))


def speed(shared: Path, threads: int, rounds: int) -> list[str]:
    """Return the lines of the table for one number of threads."""
    numba.set_num_threads(threads)
    image, defocus = photograph(shared)
    results = {"scatter": scatter(image, defocus)}

    def rendering(name: str, engine: Engine) -> Callable[[], None]:
        warm_up(engine)
        return lambda: results.update({name: engine(image, defocus)})

    runs = {"scatter": rendering("scatter", scatter), LOOP: rendering(LOOP, double_loop)}
    lens_blur = open_lens_blur(threads)
    if lens_blur is not None:
        blur = lens_blur(image, defocus)
        results[GEGL] = blur()
        runs[GEGL] = blur
    rows = time_in_turns(runs, rounds)
    lines = []
    for name in runs:
        seconds = statistics.median(row[name] for row in rows)
        ratio = statistics.median(row[name] / row["scatter"] for row in rows)
        lines.append(f"{threads} threads  {name:15s}{seconds:9.3f} s {ratio:7.1f}x")
    like_loop = compare(results["scatter"], results[LOOP], defocus)
    lines.append(f"  scatter against the double loop's exact coverage: {like_loop['psnr']:.1f} dB")
    if lens_blur is None:
        lines.append(f"  {GEGL} skipped: its library is not installed (Debian: apt install gegl)")
    else:
        like_gegl = compare(results["scatter"], results[GEGL], defocus)
        large = np.where(np.abs(defocus) >= LARGE)
        squared = (np.clip(results["scatter"][large], 0, 1) - np.clip(results[GEGL][large], 0, 1)) ** 2
        lines.append(
            f"  scatter against GEGL's picture: {like_gegl['psnr']:.1f} dB; where the radius is at least "
            f"{LARGE:g} px {-10 * math.log10(float(squared.mean())):.1f} dB (linear light)"
        )
    return lines


def print_speed(shared: Path, rounds: int) -> None:
    """Print the speed of the scatter and its rivals."""
    image, defocus = photograph(shared)
    radius = np.abs(defocus)
    print(
        f"{image.shape[1]}x{image.shape[0]} photograph, radius up to {radius.max():.1f} px, mean "
        f"{radius.mean():.1f} px; medians of {rounds} rounds, ratio to the scatter"
    )
    for threads in sorted({1, numba.config.NUMBA_NUM_THREADS}):
        print("\n".join(in_own_process(speed, shared, threads, rounds)), flush=True)


def measure_size(name: str, width: int, height: int, radius: float, repeats: int) -> tuple[float, int]:
    """Return median seconds, and the memory in bytes in addition to picture, defocus and result."""
    engine = ENGINES[name]
    warm_up(engine)
    image, defocus = scene(width, height, 1.0)
    # Every pixel has nearly the same blur radius, in front of or behind the focal plane.
    defocus = (np.sign(defocus) * radius * (0.8 + 0.2 * np.abs(defocus))).astype(np.float32)
    memory = extra_memory(lambda: engine(image, defocus))
    return median_seconds(lambda: engine(image, defocus), repeats), memory


def print_scaling(name: str, megapixels: list[float], radii: list[float], repeats: int) -> None:
    """Print time and memory by picture size, with a proportional radius, and by radius alone."""
    print(f"{name}: radii from 80 to 100 % of the largest; median of {repeats} warm renders")
    print(f"{'MP':>6s}{'radius':>8s}{'seconds':>10s}{'ns/pixel':>10s}{'extra MB':>10s}{'bytes/pixel':>12s}")
    widths = [round(math.sqrt(1.5e6 * size)) for size in megapixels]
    sizes = [(width, round(width / 1.5), width / 50) for width in widths]
    for width, height, radius in sizes + [(1920, 1080, radius) for radius in radii]:
        seconds, memory = in_own_process(measure_size, name, width, height, radius, repeats)
        pixels = width * height
        print(
            f"{pixels / 1e6:6.1f}{radius:8.1f}{seconds:10.3f}{seconds / pixels * 1e9:10.1f}"
            f"{memory / 1e6:10.1f}{memory / pixels:12.1f}",
            flush=True,
        )


def measure_rays(shared: Path, threads: int, repeats: int) -> tuple[float, dict[str, float]]:
    """Return median seconds, and the scores between two seeds."""
    numba.set_num_threads(threads)
    image, defocus = photograph(shared)
    first, second = (rays(image, defocus, seed=seed) for seed in (0, 1))
    return median_seconds(lambda: rays(image, defocus), repeats), compare(first, second, defocus)


def print_rays(shared: Path, repeats: int) -> None:
    """Print time and noise of the rays on two cores."""
    threads = min(2, numba.config.NUMBA_NUM_THREADS)
    seconds, noise = in_own_process(measure_rays, shared, threads, repeats)
    print(f"{seconds:.2f} s with {threads} threads on the photograph, median of {repeats} warm renders")
    print(f"  two seeds differ by {noise['psnr']:.1f} dB, at edges by {noise['edge_psnr']:.1f} dB")


def _heart(size: int = 64) -> np.ndarray:
    v, u = np.mgrid[1.2 : -1.2 : size * 1j, -1.2 : 1.2 : size * 1j]
    return np.asarray((u * u + v * v - 0.7) ** 3 - u * u * v**3 < 0, np.float32)


SHAPES = {
    "6 blades": Aperture(blades=6),
    "5 curved blades": Aperture(blades=5, curvature=0.5, rotation=10),
    "squeeze 0.5": Aperture(squeeze=0.5),
    "obstruction": Aperture(obstruction=0.4),
    "rim": Aperture(spherical_profile=0.7),
    "picture": Aperture(picture=_heart()),
    "cat's-eye": Aperture(cats_eye=1.0),
}


def measure_shapes(shared: Path, threads: int, rounds: int) -> list[str]:
    """Return the lines of the table: both renderers with every shape, as ratios to the disc."""
    numba.set_num_threads(threads)
    image, defocus = photograph(shared)
    lines = []
    for name, shape in SHAPES.items():
        ratios = []
        for engine in ENGINES.values():
            runs = {"disc": lambda engine=engine: engine(image, defocus)}
            runs[name] = lambda engine=engine, shape=shape: engine(image, defocus, aperture=shape)
            for run in runs.values():
                run()
            rows = time_in_turns(runs, rounds)
            ratios.append(statistics.median(row[name] / row["disc"] for row in rows))
        lines.append(f"{name:18s}" + "".join(f"{ratio:9.2f}x" for ratio in ratios))
    return lines


def print_shapes(shared: Path, rounds: int) -> None:
    """Print the cost of other shapes."""
    print(
        f"time on the photograph as a multiple of the disc's, medians of {rounds} rounds, 2 threads at most"
    )
    print(f"{'shape':18s}" + "".join(f"{name:>10s}" for name in ENGINES))
    threads = min(2, numba.config.NUMBA_NUM_THREADS)
    print("\n".join(in_own_process(measure_shapes, shared, threads, rounds)))


def print_gain(rows: list[Row]) -> None:
    """Print the gain of the rays over the scatter."""
    gains = {key: [row["rays"][key] - row["scatter"][key] for row in rows] for key in ("psnr", "edge_psnr")}
    print(
        f"  rays less scatter: edge pixels {np.nanmean(gains['edge_psnr']):+.2f} dB on average; all pixels "
        f"{np.mean(gains['psnr']):+.2f} dB on average, {min(gains['psnr']):+.2f} dB at worst"
    )


def print_quality(shared: Path, data: Path) -> None:
    """Print scores on ray-traced planes and on the path-traced scenes."""
    from benchmarks.quality.scenes.traced import (  # local import: only this section needs torch
        LAMPS,
        PLANES,
        read_traced,
    )

    print_header("pictures")
    for label, config in (("ray-traced planes", PLANES), ("planes and lamps", LAMPS)):
        rows = score(read_traced(config, data), ENGINES)
        print_scores(label, rows)
        print_gain(rows)
    everything = []
    for folder in scene_folders(shared / "cycles"):
        rows = score(read_shots(folder), ENGINES)
        everything += rows
        print_scores(folder.name, rows)
    if everything:
        print_scores("path-traced, all", everything)
        print_gain(everything)
    else:
        print(f"path-traced scenes skipped: found none in {shared / 'cycles'}")


def main() -> None:
    """Entry of the command line."""
    sections = ("speed", "scaling", "rays", "shapes", "quality")
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="+", choices=(*sections, "all"), metavar="SECTION")
    parser.add_argument("--shared", type=Path, default=Path("../shared"), help="pictures and scenes")
    parser.add_argument(
        "--data", type=Path, default=Path("data/traced"), help="folder of the ray-traced scenes"
    )
    parser.add_argument("--repeats", type=int, default=5, help="number of rounds or warm renders")
    parser.add_argument("--engine", default="scatter", choices=ENGINES, help="for scaling")
    parser.add_argument("--megapixels", type=float, nargs="*", default=[1, 4, 12, 24], help="for scaling")
    parser.add_argument("--radii", type=float, nargs="*", default=[8, 16, 32, 64, 128, 256], help="at 2 MP")
    arguments = parser.parse_args()
    selected = sections if "all" in arguments.sections else arguments.sections
    has_photograph = (arguments.shared / "real/21.png").exists()
    for section in selected:
        print(f"== {section}")
        if section in ("speed", "rays", "shapes") and not has_photograph:
            print(f"skipped: found no real/21.png in {arguments.shared}")
        elif section == "speed":
            print_speed(arguments.shared, arguments.repeats)
        elif section == "scaling":
            print_scaling(arguments.engine, arguments.megapixels, arguments.radii, arguments.repeats)
        elif section == "rays":
            print_rays(arguments.shared, arguments.repeats)
        elif section == "shapes":
            print_shapes(arguments.shared, arguments.repeats)
        else:
            print_quality(arguments.shared, arguments.data)


if __name__ == "__main__":
    main()
