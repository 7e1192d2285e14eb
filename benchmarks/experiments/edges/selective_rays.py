"""Comparison of post-processes, hybrids with selective rays, and full rays.

Run ``python -m benchmarks.experiments.edges.selective_rays``.

Draws three scenes from seeds, a room, open land and a table, whose triangles Embree intersects. The truth has
1024 rays per pixel, full rays have 64. Hybrids may send 35 % of that; each is followed by full rays of equal
processor time. The last hybrid uses the rays engine as post-process, and traces rays into the scene where
:mod:`bokehnet.engines.expected_error` expects an error. Edge PSNR is that of :mod:`train.scores.metrics`.
"""

import argparse
from dataclasses import replace
from functools import partial
from time import process_time

import numpy as np

from bokehnet.baselines.gather.scatter_as_you_gather import jimenez
from bokehnet.baselines.rays.ray_mask import normals_of_depth
from bokehnet.baselines.rays.selective_rays import RaySelection, SelectiveResult, TraceRays, selective_rays
from bokehnet.classical.scatter_renderer import scatter
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.optics.pixels.sample_allocation import neyman
from bokehnet.synth import SynthConfig
from bokehnet.synth.clutter.baked_scene import BakedScene, View
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.config import ClutterConfig
from bokehnet.synth.pairs import lens_for_view
from train.scores.metrics import compare

_WIDTH, _HEIGHT = 192, 144
_BLUR, _FOCUS = 24.0, 0.45
_TRUTH_RAYS, _FULL_RAYS, _IMAGE_RAYS = 1024, 64, 64

# Maximum mean number of rays per pixel of hybrids.
_BUDGET = 0.35 * _FULL_RAYS

# Assumed depth of the sky, mm.
_SKY_DEPTH_MM = 1e7

_SCENES = {"room": ((0, 1, 0), 3), "open": ((0, 0, 1), 5), "table": ((1, 0, 0), 2)}

# Expected errors, 8-bit levels, from which a pixel sends rays, and from which it sends the maximum number.
_MIN_ERROR, _FULL_ERROR = 1.0, 4.0

# Post-process of breda, with a random offset of each tap.
_JITTERED = partial(jimenez, jitter=1.0)

# Options of each hybrid.
_OURS = {"mask": "reach", "rule": "ours", "post_process": scatter}
_HYBRIDS = {
    "hybrid, as published": {"mask": "sobel", "rule": "tan"},
    "hybrid, by tile": {"mask": "sobel", "rule": "tan", "by_tile": True},
    "hybrid, our mask": {"mask": "reach", "rule": "tan"},
    "hybrid, breda": {"mask": "sobel", "rule": "breda", "post_process": _JITTERED},
    "hybrid, our mask, breda": {
        "mask": "reach",
        "rule": "breda",
        "post_process": partial(jimenez, jitter=1.0),
    },
    "hybrid, our mask, fields": {"mask": "reach", "rule": "fields", "post_process": scatter},
    "hybrid, ours": _OURS,
    "hybrid, ours, by tile": _OURS | {"by_tile": True},
    "hybrid, ours, neyman": _OURS | {"allocation": neyman},
    "hybrid, expected error": {"mask": "expected", "rule": "ours", "allocation": neyman},
}
_POST = {"hybrid, as published": "tan", "hybrid, by tile": "tan, by tile", "hybrid, ours": "scatter"}
_POST |= {"hybrid, breda": "jimenez, jittered"}
_POST |= {"hybrid, expected error": "rays through the picture"}


def _callback(scene: BakedScene, gain: float, sky_depth: float) -> TraceRays:
    """Return a function that traces rays into the scene."""

    def trace_rays(origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        slope = np.ascontiguousarray(directions[:, None, :2], np.float32)
        hits = scene.intersect(origins[:, :2], np.ascontiguousarray(directions[:, :2], np.float32))
        colors = scene.colours(hits, slope)
        hit = hits["primID"] >= 0
        return gain * colors, np.where(hit, hits["tfar"], sky_depth), hit

    return trace_rays


def _on_rays(engine: Engine, image: np.ndarray, defocus: np.ndarray) -> dict:
    """Return options with the rays engine as post-process, and a mask by its expected error."""
    result = engine.render(image, defocus, options=RenderOptions(expected_error=True))
    assert result.expected_error is not None
    mask = np.clip(result.expected_error / _FULL_ERROR, 0, 1)
    mask[result.expected_error < _MIN_ERROR] = 0
    return {"mask": mask, "post_process": lambda image, defocus: result.bokeh}


def compared(places: tuple[float, float, float], seed: int) -> list[tuple[str, float, float, float]]:
    """Return rows of name, edge PSNR, rays per pixel and processor seconds."""
    config = SynthConfig(seed=1, scenes=1, width=_WIDTH, height=_HEIGHT, bokeh_samples=1, image_samples=1)
    config = replace(
        config, clutter=ClutterConfig(places=places, foreground_probability=1, lamp_probability=0)
    )
    scene = random_clutter(np.random.default_rng(seed), config).scene

    def view(samples: int) -> View:
        pitch = config.pixel_pitch
        return View(width=_WIDTH, height=_HEIGHT, pixel_pitch=pitch, samples=samples, seed=samples)

    near = 0.8 / float(scene.disparity(lens_for_view(_BLUR, _FOCUS, config), view(1)).max())
    lens = lens_for_view(_BLUR, _FOCUS, replace(config, nearest_distance=near))
    image = scene.render(lens, view(_IMAGE_RAYS), False)
    gain = 0.2 / float(np.median(image))
    depth = 1 / np.maximum(scene.disparity(lens, view(1)), 1 / _SKY_DEPTH_MM)
    normals = normals_of_depth(depth, config.pixel_pitch / lens.sensor_distance)
    truth, image = gain * scene.render(lens, view(_TRUTH_RAYS)), gain * image
    defocus = np.asarray(lens.coc_radius(1 / depth) / config.pixel_pitch, np.float32)
    rows = []

    def row(name: str, picture: np.ndarray, rays: float, seconds: float) -> None:
        rows.append((name, compare(picture, truth, defocus)["edge_psnr"], rays, seconds))

    trace_rays, engine = _callback(scene, gain, _SKY_DEPTH_MM), Engine("rays")
    for name, options in _HYBRIDS.items():

        def hybrid(frames: int = 8, options: dict = options) -> SelectiveResult:
            arguments = options | {"frames": frames, "max_rays": 8, "budget": _BUDGET}
            if options["mask"] == "expected":
                arguments |= _on_rays(engine, image.astype(np.float32), defocus)
            return selective_rays(
                image, depth, normals, trace_rays, lens, config.pixel_pitch, RaySelection(**arguments)
            )

        hybrid(1)
        start = process_time()
        result = hybrid()
        seconds = process_time() - start
        if name in _POST:
            row(f"{_POST[name]}, alone", result.post_process, 0, 0)
        row(name, result.bokeh, float(result.rays.mean()), seconds)
        start = process_time()
        scene.render(lens, view(4))
        samples = max(1, round(4 * seconds / (process_time() - start)))
        row(f"  full rays, {samples}", gain * scene.render(lens, view(samples)), samples, seconds)
    row(f"full rays, {_FULL_RAYS}", gain * scene.render(lens, view(_FULL_RAYS)), _FULL_RAYS, np.nan)
    return rows


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", choices=_SCENES, default=list(_SCENES))
    for name in parser.parse_args().scenes:
        places, seed = _SCENES[name]
        for label, score, rays, seconds in compared(places, seed):
            fraction = rays / _FULL_RAYS
            print(
                f"{name:8s}{label:32s}{score:8.2f} dB{rays:8.1f} rays{fraction:8.1%}{seconds:8.2f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
