"""Samples where they differ, and multi-view accumulation: ``python -m benchmarks.experiments.adaptive_rays``.

Prints PSNR on the clipped sRGB picture against the tracer's own truth, of as many samples a pixel spread
evenly, by their variance (:mod:`bokehnet.raytrace.adaptive`) and in views that all pixels share: how close
accumulation comes to the distribution tracer, through the scene's lens or one of the catalog.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from bokehnet.raytrace.adaptive import advance_adaptive
from bokehnet.raytrace.tracer import Accumulation
from bokehnet.scenes import SceneJob, read_scene
from train.metrics import encode, psnr

WAYS = ("even", "by variance", "views")

_CONFIGS = Path(__file__).parents[2] / "configs"


def _score(film: Accumulation, shown: np.ndarray) -> float:
    return psnr((encode(film.bokeh.numpy()) - shown) ** 2)


def _picture(job: SceneJob, samples: int, way: str) -> Accumulation:
    """The picture of ``samples`` a pixel by a way to send them; seeds differ from the truth's."""
    if way == "views":
        return replace(job, render=replace(job.render, method="accumulation")).tracer().render(samples)
    tracer = job.tracer()
    if way == "even":
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
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=list(WAYS))
    parser.add_argument("--lens", default=None, help="of the catalog, in place of the scene's")
    arguments = parser.parse_args()
    size = {"camera.width": arguments.width, "camera.height": arguments.height}
    for name in arguments.scenes:
        overrides = {**size, "render.seed": 1}
        if arguments.lens is not None:
            overrides |= {"lens.name": arguments.lens, "lens.focal_length": None, "lens.f_number": None}
        job = read_scene(_CONFIGS / f"scene_{name}.toml", overrides)
        truth = replace(job, render=replace(job.render, seed=2)).tracer().render(arguments.truth)
        shown = encode(truth.bokeh.numpy())
        for samples in arguments.samples:
            found = {way: _score(_picture(job, samples, way), shown) for way in arguments.ways}
            told = "".join(f"{label:>14s} {value:.2f}" for label, value in found.items())
            print(f"{name:8s}{samples:6d} samples{told} dB", flush=True)


if __name__ == "__main__":
    torch.set_num_threads(1)  # small pictures: more wait for each other
    main()
