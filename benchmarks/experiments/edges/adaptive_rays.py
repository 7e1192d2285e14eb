"""Adaptive sampling and multi-view accumulation: ``python -m benchmarks.experiments.edges.adaptive_rays``.

Prints the PSNR of the clipped sRGB picture against the tracer's own truth, for equal numbers of samples per
pixel that are distributed evenly, by variance (:mod:`bokehnet.raytrace.adaptive`) and in views that all
pixels share, through the scene's lens or a catalog lens.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from bokehnet.raytrace.adaptive import advance_adaptive
from bokehnet.raytrace.tracer import Accumulation
from bokehnet.scenes import SceneJob, read_scene
from train.scores.metrics import encode, psnr

METHODS = ("even", "by variance", "views")

_CONFIGS = Path(__file__).parents[3] / "configs"


def _score(film: Accumulation, encoded_truth: np.ndarray) -> float:
    return psnr((encode(film.bokeh.numpy()) - encoded_truth) ** 2)


def _picture(job: SceneJob, samples: int, method: str) -> Accumulation:
    """Return the picture of ``samples`` per pixel with a sampling method; seeds differ from the truth's."""
    if method == "views":
        return replace(job, render=replace(job.render, method="accumulation")).tracer().render(samples)
    tracer = job.tracer()
    if method == "even":
        return tracer.render(samples)
    adaptive = tracer.begin()
    while adaptive.samples < samples:
        adaptive = advance_adaptive(tracer, adaptive)
    return adaptive


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--width", type=int, default=120)
    parser.add_argument("--height", type=int, default=80)
    parser.add_argument("--samples", type=int, nargs="+", default=[32, 64, 256])
    parser.add_argument("--truth", type=int, default=4096)
    parser.add_argument("--scenes", nargs="+", default=["balls", "cards"])
    parser.add_argument("--ways", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--lens", default=None, help="catalog lens that replaces the scene's lens")
    arguments = parser.parse_args()
    size = {"camera.width": arguments.width, "camera.height": arguments.height}
    for name in arguments.scenes:
        overrides = {**size, "render.seed": 1}
        if arguments.lens is not None:
            overrides |= {"lens.name": arguments.lens, "lens.focal_length": None, "lens.f_number": None}
        job = read_scene(_CONFIGS / f"scene_{name}.toml", overrides)
        truth = replace(job, render=replace(job.render, seed=2)).tracer().render(arguments.truth)
        encoded_truth = encode(truth.bokeh.numpy())
        for samples in arguments.samples:
            scores = {
                method: _score(_picture(job, samples, method), encoded_truth) for method in arguments.ways
            }
            values = "".join(f"{label:>14s} {value:.2f}" for label, value in scores.items())
            print(f"{name:8s}{samples:6d} samples{values} dB", flush=True)


if __name__ == "__main__":
    torch.set_num_threads(1)  # more threads do not help for small pictures
    main()
