"""Quality, time and size of rays as tensor operations: ``python -m benchmarks.quality.tensors FOLDER``.

FOLDER holds scenes as for :mod:`benchmarks.quality.cycles`. Three methods render the same layers, those of
the numba rays:

- ``rays``: the numba kernels, with the scatter on single surfaces and lights splatted whole;
- ``layered``: :func:`bokehnet.torch.layered`, searches along pupil samples;
- ``splatted``: the layers in slices of the defocus, each spread over its discs and composited by its
  coverage, front to back.

``file`` is the file of ``bokehnet export --engine rays`` in ONNX Runtime, with layers of its own; ``fast``,
``neural`` and ``bokehme`` are engines and the baseline. The time is user and system time of one picture; that
of the slow ``layered`` and ``bokehme`` is four times the time of a quarter of the picture.
With ``--results`` each row is written when it is measured, and the same command resumes a stopped run.

Source: Sheng et al., "Dr.Bokeh: DiffeRentiable Occlusion-aware Bokeh Rendering", CVPR 2024, for layers that
are splatted with occlusion; our slices are simpler.
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import cache, partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from benchmarks.figures import write_figures
from benchmarks.measurement import scene
from benchmarks.quality.cycles import read_shots, scene_folders
from bokehnet.baselines.spread.bokehme import bokehme
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.layers import split_layers
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter import pyramid_levels
from bokehnet.io.files.atomic import write_text
from bokehnet.onnx_file.renderer import build_model
from bokehnet.optics.aperture import Aperture
from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.engine_settings import EngineName
from bokehnet.torch import layered
from train.scores.evaluation_sets import Shot
from train.scores.metrics import compare, encode, mean_scores, psnr

_COLUMNS = {
    "edge_psnr": ("edge PSNR", ".2f"),
    "psnr": ("PSNR", ".2f"),
    "to_rays": ("PSNR to rays", ".2f"),
}
_COSTS = {"seconds": ("processor s", ".1f"), "megabytes": ("file, MB (0: none)", ".1f")}

# Size, blur radius in pixels, and methods that are timed on a quarter of the picture.
_SIZE, _BLUR_PX, _SLOW = (1920, 1080), 20.0, ("layered", "bokehme")

# Number of slices of the defocus.
_SLICES = 16


def render_layered(stack: Layers, aperture: Aperture, samples: int) -> np.ndarray:
    """Return the picture of :func:`bokehnet.torch.layered`, (H, W, 3)."""
    colors = torch.from_numpy(stack.colors).permute(2, 3, 0, 1)[:, None]
    radii = torch.from_numpy(stack.defocus).permute(2, 0, 1)[:, None, None]
    coverage = torch.from_numpy(stack.coverage).permute(2, 0, 1)[:1, None]
    hidden = list(zip(colors[1:], radii[1:], strict=True))
    with torch.no_grad():
        bokeh = layered(colors[0], radii[0], hidden, coverage, aperture, samples=samples)
    return bokeh[0].movedim(0, 2).numpy()


def render_splatted(stack: Layers) -> np.ndarray:
    """Return the picture of splatted slices, (H, W, 3)."""
    edges = np.linspace(stack.defocus.max() + 1e-3, stack.defocus.min() - 1e-3, _SLICES + 1)
    total = np.zeros((*stack.defocus.shape[:2], 4))
    hidden = np.concatenate([np.zeros_like(stack.coverage[..., :1]), stack.coverage[..., :-1]], -1)
    is_repeated = (np.diff(stack.defocus, axis=-1, prepend=np.inf) == 0) & (hidden == 1)
    for high, low in pairwise(edges):
        values = np.zeros((*stack.defocus.shape[:2], 4), np.float32)
        radius = np.zeros(stack.defocus.shape[:2], np.float32)
        for layer in reversed(range(stack.defocus.shape[2])):
            depth = stack.defocus[..., layer]
            inside = (depth <= high) & (depth > low) & ~is_repeated[..., layer]
            coverage = np.where(inside, stack.coverage[..., layer], 0)[..., None]
            values = values * (1 - coverage)
            values += coverage * np.concatenate([stack.colors[:, :, layer], np.ones_like(coverage)], -1)
            radius = np.where(inside, depth, radius)
        spread = pyramid_levels.scatter_forward(values, radius)
        alpha = np.clip(spread[..., 3:], 0, 1)
        color = spread[..., :3] / np.maximum(spread[..., 3:], 1e-9)
        share = (1 - total[..., 3:]) * alpha
        total += share * np.concatenate([color, np.ones_like(alpha)], -1)
    picture: np.ndarray = (total[..., :3] / np.maximum(total[..., 3:], 1e-9)).astype(np.float32)
    return picture


Render = Callable[[np.ndarray, np.ndarray], np.ndarray]


def file_renderer(content: bytes) -> Render:
    """Return a function of image and defocus that runs an exported file."""
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    scalars = {name: np.array(x, np.float32) for name, x in {"K": 1, "focus": 0, "gamma": 1}.items()}

    def render(image: np.ndarray, defocus: np.ndarray) -> np.ndarray:
        return session.run(None, {"image": image, "disparity": defocus, **scalars})[0]

    return render


def _layers(image: np.ndarray, defocus: np.ndarray) -> Layers:
    return split_layers(image, defocus, math.ceil(float(np.abs(defocus).max())))


def make_methods(samples: int) -> tuple[dict[str, Render], dict[str, float]]:
    """Return functions of image and defocus by name, and the sizes of their files, MB."""
    files = {
        name: build_model(engine=engine).SerializeToString()
        for name, engine in (("file", "rays"), ("fast", "fast"), ("neural", "neural"), ("bokehme", "bokehme"))
    }

    def engine(name: EngineName) -> Render:
        renderer = BokehRenderer(name)
        return lambda image, defocus: renderer.render_arrays(image, defocus).bokeh

    methods: dict[str, Render] = {
        "rays": rays,
        "layered": lambda image, defocus: render_layered(_layers(image, defocus), Aperture(), samples),
        "splatted": lambda image, defocus: render_splatted(_layers(image, defocus)),
        "file": file_renderer(files["file"]),
        "fast": engine("fast"),
        "neural": engine("neural"),
        "bokehme": bokehme,
    }
    return methods, {name: len(content) / 1e6 for name, content in files.items()}


def processor_seconds(name: str, render: Render) -> float:
    """Return user and system time of one picture of ``_SIZE``, seconds."""
    share = 2 if name in _SLOW else 1
    image, defocus = scene(_SIZE[0] // share, _SIZE[1] // share, _BLUR_PX)
    render(image[:64, :64].copy(), defocus[:64, :64].copy())
    start = time.process_time()
    render(image, defocus)
    return share**2 * (time.process_time() - start)


def _render(render: Render, shot: Shot) -> np.ndarray:
    return render(np.asarray(shot.image, np.float32), np.asarray(shot.defocus, np.float32))


def score(shot: Shot, render: Render, expected: Callable[[], np.ndarray]) -> dict[str, float]:
    """Return the scores of a method on a shot with a round aperture; ``expected`` returns the rays'."""
    picture = _render(render, shot)
    difference = encode(np.clip(picture, 0, 1)) - encode(np.clip(expected(), 0, 1))
    scores = compare(picture, shot.truth, np.asarray(shot.defocus, np.float32))
    return scores | {"to_rays": psnr(np.square(difference))}


class _Results:
    """Results by method and row, in a JSON file that is written after each, so that a run can be resumed."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._rows: dict[str, dict[str, dict[str, float]]] = {}
        if path is not None and path.exists():
            self._rows = json.loads(path.read_text(encoding="utf-8"))

    def get(self, name: str, row: str, measure: Callable[[], dict[str, float]]) -> dict[str, float]:
        """Return a row of a method, measured unless the file has it."""
        rows = self._rows.setdefault(name, {})
        if row not in rows:
            rows[row] = {key: float(value) for key, value in measure().items()}
            line = "  ".join(f"{key} {value:.2f}" for key, value in rows[row].items())
            print(f"{row:24s}{name:10s}{line}", flush=True)
            if self._path is not None:
                write_text(self._path, json.dumps(self._rows, indent=1) + "\n")
        return rows[row]


def _score_all(
    folder: Path, count: int, methods: dict[str, Render], results: _Results
) -> dict[str, dict[str, dict[str, float]]]:
    """Return the scores of all methods by method and row, SCENE/NUMBER."""
    scores: dict[str, dict[str, dict[str, float]]] = {name: {} for name in methods}
    for path in scene_folders(folder):
        short = path.name.split("_")[0]
        shots = [shot for shot in read_shots(path) if shot.aperture.is_disc][:count]
        for number, shot in enumerate(shots):
            expected = cache(partial(_render, methods["rays"], shot))
            for name, render in methods.items():
                row = f"{short}/{number}"
                scores[name][row] = results.get(name, row, partial(score, shot, render, expected))
    return scores


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, default=5, help="shots with a round aperture of each scene")
    parser.add_argument("--samples", type=int, default=32, help="pupil samples of layered")
    parser.add_argument("--figures", type=Path, help="JSON file for the tables of the documentation")
    parser.add_argument("--methods", nargs="+", help="methods to measure beside rays; default: all")
    parser.add_argument("--results", type=Path, help="JSON file of single results; resumes from it")
    arguments = parser.parse_args()
    methods, sizes = make_methods(arguments.samples)
    if arguments.methods:
        methods = {name: methods[name] for name in ("rays", *arguments.methods)}
    results = _Results(arguments.results)
    scores = _score_all(arguments.folder, arguments.shots, methods, results)
    columns, means = dict(_COLUMNS), {}
    for name, render in methods.items():
        means[name] = mean_scores(list(scores[name].values()))
        for short in dict.fromkeys(row.split("/")[0] for row in scores[name]):
            columns[short] = (f"edge PSNR {short}", ".2f")
            own = [x["edge_psnr"] for row, x in scores[name].items() if row.split("/")[0] == short]
            means[name][short] = float(np.mean(own))
        cost = results.get(name, "seconds", partial(_cost, name, render))
        means[name] |= cost | {"megabytes": sizes.get(name, 0.0)}
    columns |= _COSTS
    for name, row in means.items():
        print(f"{'mean':24s}{name:10s}" + "".join(f"{row[column]:9.2f}" for column in columns), flush=True)
    if arguments.figures:
        chosen = " ".join(["", "--methods", *arguments.methods]) if arguments.methods else ""
        command = f"python -m benchmarks.quality.tensors FOLDER --shots {arguments.shots}{chosen}"
        conditions = (
            f"{len(scores['rays'])} path-traced pictures, true depth, dB of the clipped sRGB picture; "
            f"time of {_SIZE[0]}x{_SIZE[1]} pixels, blur {_BLUR_PX:g} px"
        )
        write_figures(arguments.figures, command, conditions, columns, means)


def _cost(name: str, render: Render) -> dict[str, float]:
    return {"seconds": processor_seconds(name, render)}


if __name__ == "__main__":
    main()
