"""Training pairs per minute: ``python -m benchmarks.speed.training_pairs``.

Planes as ``bokehnet synth`` makes them in one process, or rendered on a GPU (``--device cuda``); on the CPU
also clutter, through thin lenses and catalog lenses, with the noise of its pictures.
"""

import argparse
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.lenses import ThinLens
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)
from bokehnet.synth import ClutterConfig, SynthConfig
from bokehnet.synth.clutter.baked_scene import View
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.pairs import lens_for_view, make_sample
from bokehnet.synth.scenes import random_scene

__all__ = ["main", "print_pairs"]

_PAIRS = SynthConfig(seed=11, scenes=1, width=256, height=256, bokeh_samples=512, image_samples=16)
# Cluttered scenes as in configs/synth_clutter.toml, with the narrower field of the catalog lenses.
_CATALOG = ("cooke_triplet", "double_gauss", "retrofocus")
_CLUTTER = SynthConfig(
    seed=11,
    scenes=1,
    kind="clutter",
    views=2,
    bokeh_samples=128,
    image_samples=32,
    sensor_distance=100.0,
    clutter=ClutterConfig(lamp_probability=0.0),
)


def print_pairs(device: torch.device, scenes: int) -> None:
    """Print pairs per minute of ``scenes`` scenes of each kind."""
    _print_planes(device, scenes)
    if device.type == "cpu":
        _print_clutter(scenes)


def _print_clutter(scenes: int) -> None:
    """Print training pairs per minute of scenes with objects, in one process, and their noise."""
    variants: dict[str, dict[str, Any]] = {
        "thin lenses": {},
        "catalog lenses": {"catalog": _CATALOG, "catalog_share": 1.0},
    }
    for name, change in variants.items():
        config = replace(_CLUTTER, **change)
        make_sample(config, scenes)  # compiles
        start = time.perf_counter()
        pairs = sum(len(make_sample(config, index).bokeh) for index in range(scenes))
        rate = 60 * pairs / (time.perf_counter() - start)
        print(
            f"cluttered pairs of 256x256, {config.bokeh_samples} pupil samples, {name}: {rate:.1f} per "
            f"minute ({pairs} pairs)"
        )
    noise = [_clutter_noise(index) for index in range(scenes)]
    print(
        f"  noise of one picture, sRGB: {np.mean(noise):.1f} dB on average, {np.min(noise):.1f} dB at worst"
    )


def _clutter_noise(index: int) -> float:
    """Return the PSNR of a cluttered picture relative to one without noise, from two seeds."""
    rng = np.random.default_rng([_CLUTTER.seed, index])
    clutter = random_clutter(rng, _CLUTTER)
    pinhole = ThinLens(focal_length=_CLUTTER.sensor_distance, f_number=1.0)

    def view(samples: int, seed: int) -> View:
        return View(width=256, height=256, pixel_pitch=_CLUTTER.pixel_pitch, samples=samples, seed=seed)

    inverse_depth = clutter.scene.disparity(pinhole, view(1, 0))
    config = replace(_CLUTTER, nearest_distance=1 / float(inverse_depth.max()))
    focus = float(rng.choice(inverse_depth.ravel())) * config.nearest_distance
    lens = lens_for_view(12.0 / max(focus, 1 - focus), focus, config)
    first, second = (clutter.scene.render(lens, view(config.bokeh_samples, seed)) for seed in (0, 1))
    white = 0.18 / float(first.mean())
    first, second = (linear_to_srgb(np.clip(white * picture, 0, 1)) for picture in (first, second))
    return -10 * math.log10(max(float(np.mean((first - second) ** 2)) / 2, 1e-12))


def _print_planes(device: torch.device, scenes: int) -> None:
    """Print training pairs of planes per minute: as synth makes them in one process, or rendered on a GPU."""
    start = time.perf_counter()
    if device.type == "cpu":
        pairs = sum(len(make_sample(_PAIRS, index).bokeh) for index in range(scenes))
        seconds = time.perf_counter() - start
    else:
        scene_list = [random_scene(np.random.default_rng(index), _PAIRS) for index in range(scenes)]
        scene_list = [_to_device(scene, device) for scene in scene_list]
        lens = lens_for_view(20.0, 0.3, _PAIRS)
        view = Camera(lens=lens, width=256, height=256, pixel_pitch=_PAIRS.pixel_pitch)
        render_bokeh(scene_list[0], view, 8, 0)
        torch.cuda.synchronize()
        start = time.perf_counter()
        for index, scene in enumerate(scene_list):
            render_all_in_focus(scene, view, _PAIRS.image_samples, index)
            render_disparity(scene, view)
            render_bokeh(scene, view, _PAIRS.bokeh_samples, index)
        torch.cuda.synchronize()
        pairs, seconds = scenes, time.perf_counter() - start
    print(
        f"training pairs of 256x256, {_PAIRS.bokeh_samples} pupil samples: {60 * pairs / seconds:.1f} per "
        f"minute on {device} ({pairs} pairs)"
    )


def _to_device(scene: Scene, device: torch.device) -> Scene:
    background = scene.background
    return Scene(
        background=Background(
            texture=background.texture.to(device),
            half_extent=background.half_extent,
            disparity=background.disparity,
        ),
        planes=tuple(
            Plane(texture=p.texture.to(device), centre=p.centre, u_axis=p.u_axis, v_axis=p.v_axis)
            for p in scene.planes
        ),
    )


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--scenes", type=int, default=6, help="scenes of each kind")
    parser.add_argument("--threads", type=int, default=1)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    print_pairs(torch.device(arguments.device), arguments.scenes)


if __name__ == "__main__":
    main()
