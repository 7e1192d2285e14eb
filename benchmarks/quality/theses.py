"""Comparison of all methods of four theses: ``python -m benchmarks.quality.theses [FOLDER] [--engine NAME]``.

Prints the faults of each method on probes with known blur (:mod:`benchmarks.quality.scenes.fault_probes`),
its time and memory, its flicker on a pan (:mod:`benchmarks.experiments.edges.pan`), and its scores on the
path-traced scenes in FOLDER (:func:`train.scores.evaluation_sets.path_traced_pictures`; default
``../shared/cycles``): PSNR within the blur's reach of a depth step and over all pixels, FLIP, and seconds;
then everything as one table (:mod:`benchmarks.quality.tables.theses_table`), which ``--table JSON ...``
prints from saved runs. Methods that support only discs render discs where a shot has blades.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.experiments.edges.pan import flicker, pan
from benchmarks.measurement import extra_memory, scene
from benchmarks.quality.scenes.fault_probes import FAULTS, faults
from benchmarks.quality.tables.theses_table import Figures, merged, table, write_tables
from bokehnet import baselines
from bokehnet.baselines import BASELINES
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture
from bokehnet.scores.flip import flip_map
from train.scores.evaluation_sets import Shot, path_traced_shots
from train.scores.metrics import depth_step_pixels, encode, psnr

__all__ = ["METHODS", "SCENES", "render_with", "score_shot"]

OURS = ("scatter", "fast", "neural", "hybrid", "rays")
METHODS = ("no_blur", *BASELINES, *OURS)
SCENES = ("s1_still_life", "s2_thin_fence", "s4_corridor", "s8_crowd")

Method = Callable[..., np.ndarray]


def _no_blur(image: np.ndarray, defocus: np.ndarray, aperture: Aperture) -> np.ndarray:
    return image


def render_with(name: str) -> Method:
    """Return the method of a name: (image, defocus, aperture) -> picture; discs for unsupported apertures."""
    if name == "no_blur":
        return _no_blur
    if name in OURS:
        engine = Engine(name)
        return lambda image, defocus, aperture: (
            engine.render(image, defocus, options=RenderOptions(aperture=aperture)).bokeh
        )
    function = getattr(baselines, name)

    def render(image: np.ndarray, defocus: np.ndarray, aperture: Aperture) -> np.ndarray:
        try:
            return np.asarray(function(image, defocus, aperture))
        except ParameterError as error:
            if error.parameter != "aperture":
                raise
            return np.asarray(function(image, defocus))

    return render


def score_shot(shot: Shot, methods: dict[str, Method]) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield the scores of every method on one shot."""
    assert shot.disparity is not None
    truth, near = encode(shot.truth), depth_step_pixels(shot.disparity, shot.defocus)
    for name, method in methods.items():
        start = time.perf_counter()
        bokeh = method(shot.image, shot.defocus, shot.aperture)
        seconds = time.perf_counter() - start
        encoded = encode(bokeh)
        squared = (encoded - truth) ** 2
        yield (
            name,
            {
                "edge": psnr(squared[near]),
                "psnr": psnr(squared),
                "flip": float(flip_map(truth, encoded).mean()),
                "seconds": seconds,
            },
        )


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("../shared/cycles"))
    parser.add_argument("--engine", action="append", choices=METHODS, help="default: all")
    parser.add_argument("--shots", type=int, default=None, help="maximum number of shots per scene")
    parser.add_argument("--json", type=Path, help="save the figures to this file")
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="write the tables of the docs here")
    parser.add_argument("--table", type=Path, nargs="+", metavar="JSON", help="print saved figures")
    parser.add_argument("--faults", action="store_true", help="only faults")
    parser.add_argument("--costs", action="store_true", help="only time, memory and flicker")
    parser.add_argument("--timings", action="store_true", help="repeat the timing tables of the theses")
    arguments = parser.parse_args()
    if arguments.timings:
        print_timings()
        return
    if arguments.table:
        runs = [json.loads(path.read_text(encoding="utf-8")) for path in arguments.table]
        print(table(merged(runs), METHODS))
        if arguments.figures:
            write_tables(arguments.figures, merged(runs), METHODS, arguments.shots)
        return
    methods = {name: render_with(name) for name in arguments.engine or METHODS}
    everything = not (arguments.faults or arguments.costs)
    figures: Figures = {}
    if everything or arguments.faults:
        figures["faults"] = print_faults(methods)
    if everything or arguments.costs:
        figures["costs"] = print_costs(methods)
    if everything:
        figures["scenes"] = {}
        for name in SCENES:
            folder = arguments.folder / name
            if not (folder / "scene.json").exists():
                print(f"\n{name}: skipped, as {folder} holds no scene.json")
                continue
            figures["scenes"][name] = print_scene(folder, methods, arguments.shots)
        print(f"\n{table(figures, METHODS)}")
        if arguments.figures:
            write_tables(arguments.figures, figures, METHODS, arguments.shots)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1), encoding="utf-8")


def print_faults(methods: dict[str, Method]) -> dict[str, dict[str, float]]:
    """Print the table of faults, and return its values."""
    print("Faults on probes, per cent; 0 is best")
    print(f"{'method':18s}" + "".join(f"{name:>9s}" for name in FAULTS))
    figures = {}
    for name, method in methods.items():
        figures[name] = faults(lambda image, defocus, method=method: method(image, defocus, Aperture()))
        print(f"{name:18s}" + "".join(f"{figures[name][key]:9.1f}" for key in FAULTS), flush=True)
    for name, text in FAULTS.items():
        print(f"  {name}: {text}")
    return figures


def print_costs(methods: dict[str, Method]) -> dict[str, dict[str, float]]:
    """Print processor seconds, extra memory in bytes per pixel and flicker, and return the values."""
    image, defocus = scene(512, 384, 16.0)
    frames = pan()
    middle = [(frame.truths[0] + frame.truths[1]) / 2 for frame in frames]
    print("\nProcessor seconds, bytes a pixel and flicker in per cent of white; 512x384, discs up to 16 px")
    print(f"{'method':18s}{'seconds':>9s}{'memory':>9s}{'flicker':>9s}")
    figures = {}
    for name, method in methods.items():

        def run(method: Method = method) -> np.ndarray:
            return method(image, defocus, Aperture())

        method(image[:64, :64], defocus[:64, :64], Aperture())  # compiles
        memory = extra_memory(run)
        pictures = [method(frame.image, frame.defocus, Aperture()) for frame in frames]
        cost = {
            "seconds": _processor_seconds(run),
            "memory": max(memory, 0) / defocus.size,
            "flicker": flicker(pictures, middle),
        }
        print(f"{name:18s}{cost['seconds']:9.2f}{cost['memory']:9.0f}{cost['flicker']:9.2f}", flush=True)
        figures[name] = cost
    # Half the difference of two truths has the noise of their mean.
    noise = flicker([frame.truths[0] for frame in frames], middle)
    print(f"{'the truth itself':18s}{'':18s}{noise:9.2f}")
    return figures


def print_scene(folder: Path, methods: dict[str, Method], shots: int | None) -> dict[str, dict[str, float]]:
    """Print the table of one scene, means over its shots, and return the values."""
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in methods}
    for index, shot in enumerate(path_traced_shots(folder)):
        if shots is not None and index >= shots:
            break
        for name, scores in score_shot(shot, methods):
            rows[name].append(scores)
    means = {
        name: {key: float(np.mean([row[key] for row in shot_scores])) for key in shot_scores[0]}
        for name, shot_scores in rows.items()
    }
    _print_scores(folder.name, means)
    return means


def _print_scores(title: str, means: dict[str, dict[str, float]]) -> None:
    print(f"\n{title}\n{'method':18s}{'edge PSNR':>10s}{'PSNR':>8s}{'FLIP':>8s}{'seconds':>9s}")
    for name, score in means.items():
        numbers = f"{score['edge']:10.2f}{score['psnr']:8.2f}{score['flip']:8.4f}{score['seconds']:9.2f}"
        print(f"{name:18s}{numbers}", flush=True)


def _processor_seconds(run: Callable[[], np.ndarray]) -> float:
    """Return the minimum processor time of two runs."""
    seconds = []
    for _ in range(2):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return min(seconds)


def _user_seconds(function: Callable[..., np.ndarray], *arrays: np.ndarray, **options: float) -> float:
    """Return the minimum processor time of two runs, after a warm-up run on a corner."""
    function(*(array[:64, :64] for array in arrays), **options)
    return _processor_seconds(lambda: function(*arrays, **options))


def print_timings() -> None:
    """Print table 2.1 of thesis 004 and figure 5.7 of thesis 001, in seconds of user time."""
    rng = np.random.default_rng(0)
    print("1280x720 pixels, discs of 20 px")
    image = rng.random((720, 1280, 3)).astype(np.float32)
    defocus = np.full(image.shape[:2], 20, np.float32)
    defocus[:, :640] = -20
    for samples in (64, 512):
        for name, options in (
            ("gather_basic", {"samples": samples}),
            ("gather_spiral", {"scale": 20**2 / (2 * samples)}),
            ("gather_bokeh", {"samples": samples}),
        ):
            seconds = _user_seconds(getattr(baselines, name), image, defocus, **options)
            print(f"{name:18s}{samples:5d} samples{seconds:9.2f} s", flush=True)
    print("1500x1500 pixels of noise, discs of 100 px")
    image = (rng.random((1500, 1500, 3)) ** 4).astype(np.float32)
    for name in ("rectangle", "hybrid_spreading", "perimeter"):
        seconds = _user_seconds(getattr(baselines, name), image, np.full(image.shape[:2], -100, np.float32))
        print(f"{name:18s}{seconds:9.2f} s", flush=True)


if __name__ == "__main__":
    main()
