"""Quality of rays as tensor operations: ``python -m benchmarks.quality.tensors FOLDER``.

FOLDER holds scenes as for :mod:`benchmarks.quality.cycles`. All methods render the same layers, those of the
numba rays:

- ``rays``: the numba kernels, with the scatter on single surfaces and lights splatted whole;
- ``layered``: :func:`bokehnet.torch.layered`, searches along pupil samples;
- ``splatted``: the layers in slices of the defocus, each spread over its discs and composited by its
  coverage, front to back.

``onnx`` is the file of ``bokehnet export --engine rays``, with layers of its own.

Source: Sheng et al., "Dr.Bokeh: DiffeRentiable Occlusion-aware Bokeh Rendering", CVPR 2024, for layers that
are splatted with occlusion; our slices are simpler.
"""

import argparse
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from benchmarks.figures import write_figures
from benchmarks.quality.cycles import read_shots, scene_folders
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.layers import split_layers
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter import pyramid_levels
from bokehnet.onnx_file.renderer import build_model
from bokehnet.optics.aperture import Aperture
from bokehnet.torch import layered
from train.scores.evaluation_sets import Shot
from train.scores.metrics import compare, encode, mean_scores, psnr

_COLUMNS = {
    "edge_psnr": ("edge PSNR", ".2f"),
    "psnr": ("PSNR", ".2f"),
    "to_rays": ("PSNR to rays", ".2f"),
}

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


def file_renderer() -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return a function of image and defocus that runs the exported file."""
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    model = build_model(engine="rays").SerializeToString()
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    scalars = {name: np.array(x, np.float32) for name, x in {"K": 1, "focus": 0, "gamma": 1}.items()}

    def render(image: np.ndarray, defocus: np.ndarray) -> np.ndarray:
        return session.run(None, {"image": image, "disparity": defocus, **scalars})[0]

    return render


def score(shot: Shot, samples: int, in_file: Callable[..., np.ndarray]) -> dict[str, dict[str, float]]:
    """Return the scores of all methods on a shot with a round aperture."""
    image, defocus = np.asarray(shot.image, np.float32), np.asarray(shot.defocus, np.float32)
    stack = split_layers(image, defocus, math.ceil(float(np.abs(defocus).max())))
    pictures = {
        "rays": rays(image, defocus, aperture=shot.aperture),
        "layered": render_layered(stack, shot.aperture, samples),
        "splatted": render_splatted(stack),
        "onnx": in_file(image, defocus),
    }
    expected = encode(np.clip(pictures["rays"], 0, 1))
    scores = {}
    for name, picture in pictures.items():
        scores[name] = compare(picture, shot.truth, defocus)
        scores[name]["to_rays"] = psnr(np.square(encode(np.clip(picture, 0, 1)) - expected))
    return scores


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shots", type=int, default=5, help="shots with a round aperture of each scene")
    parser.add_argument("--samples", type=int, default=32, help="pupil samples of layered")
    parser.add_argument("--figures", type=Path, help="JSON file for the tables of the documentation")
    arguments = parser.parse_args()
    rows, in_file = [], file_renderer()
    for folder in scene_folders(arguments.folder):
        round_shots = [shot for shot in read_shots(folder) if shot.aperture.is_disc]
        for shot in round_shots[: arguments.shots]:
            rows.append(score(shot, arguments.samples, in_file))
            for name, scores in rows[-1].items():
                line = "".join(f"{scores[column]:9.2f}" for column in _COLUMNS)
                print(f"{folder.name:16s}{name:10s}{line}", flush=True)
    means = {name: mean_scores([row[name] for row in rows]) for name in rows[0]}
    for name, scores in means.items():
        print(f"{'mean':16s}{name:10s}" + "".join(f"{scores[column]:9.2f}" for column in _COLUMNS))
    if arguments.figures:
        command = f"python -m benchmarks.quality.tensors FOLDER --shots {arguments.shots}"
        conditions = f"{len(rows)} path-traced pictures, true depth, dB of the clipped sRGB picture"
        write_figures(arguments.figures, command, conditions, _COLUMNS, means)


if __name__ == "__main__":
    main()
