"""Gain from true layers over inpainted ones: ``python -m benchmarks.experiments.edges.true_layers``.

Draws scenes from seeds: emissive cards, peeled by :func:`bokehnet.raytrace.peeling.peel`, and objects on the
    ground, whose triangles Embree intersects one after the other. The truth is traced through the lens;
edge PSNR is that of :mod:`train.scores.metrics`.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from bokehnet import rays
from bokehnet.classical.known_layers import Layers
from bokehnet.lenses import ThinLens
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.pixels.pixel_layers import merge_surfaces
from bokehnet.raytrace import Camera, render_all_in_focus, render_bokeh, render_disparity
from bokehnet.raytrace.distribution import halton_points
from bokehnet.raytrace.peeling import peel
from bokehnet.raytrace.world import world_from_scene
from bokehnet.synth import SceneConfig, SynthConfig
from bokehnet.synth.clutter.baked_scene import BakedScene, View, sensor_xy
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.pairs import lens_for_view
from bokehnet.synth.scenes import random_scene
from train.scores.metrics import compare

_WIDTH, _HEIGHT = 160, 128
BLUR, _LAYERS = 14.0, 6
_SAMPLES, _TRUTH, _IMAGE = 32, 1024, 64
_BOX = PixelFilter("box", 1)

_CONFIG = SynthConfig(
    seed=1,
    scenes=1,
    width=_WIDTH,
    height=_HEIGHT,
    bokeh_samples=1,
    image_samples=1,
    scene=SceneConfig(light_probability=0.0, photographs=("coffee", "gravel", "rocket")),
)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Picture, its truth and its layers; disparity and focus are relative."""

    image: np.ndarray
    truth: np.ndarray
    disparity: np.ndarray
    focus: float
    layers: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def planes(seed: int) -> Scene:
    """Return a scene of cards of random outline and tilt."""
    scene, focus = random_scene(np.random.default_rng(seed), _CONFIG), (0.25, 0.6, 0.9)[seed % 3]
    lens = lens_for_view(BLUR, focus, _CONFIG)
    camera = Camera(lens=lens, width=_WIDTH, height=_HEIGHT, pixel_pitch=_CONFIG.pixel_pitch)
    world, layers = world_from_scene(scene), {}
    for label, samples in (("cut hard", 1), ("covered", _SAMPLES)):
        peeled = peel(world, camera, _LAYERS, samples=samples, bounces=0)
        near = _CONFIG.nearest_distance / peeled.depth.numpy().astype(np.float64)
        layers[label] = (peeled.colors.numpy(), near.astype(np.float32), peeled.coverage.numpy().clip(0, 1))
    return Scene(
        image=render_all_in_focus(scene, camera, _IMAGE, 1).numpy(),
        truth=render_bokeh(scene, camera, _TRUTH // 4, 0).numpy(),
        disparity=render_disparity(scene, camera).numpy() * _CONFIG.nearest_distance,
        focus=focus,
        layers=layers,
    )


def clutter(seed: int) -> Scene:
    """Return a scene of objects on the ground."""
    scene, focus = random_clutter(np.random.default_rng(seed), _CONFIG).scene, (0.2, 0.45, 0.7)[seed % 3]

    def view(samples: int) -> View:
        return View(
            width=_WIDTH, height=_HEIGHT, pixel_pitch=_CONFIG.pixel_pitch, samples=samples, seed=samples
        )

    pinhole = lens_for_view(BLUR, focus, _CONFIG)
    nearest = 0.8 / float(scene.disparity(pinhole, view(1)).max())
    lens = lens_for_view(BLUR, focus, replace(_CONFIG, nearest_distance=nearest))
    image = scene.render(lens, view(_IMAGE), False)
    gain = 0.2 / float(np.median(image))
    shape = (_HEIGHT, _WIDTH, _LAYERS)
    colors, values, coverage = _peeled(scene, lens, view(1))
    values = np.minimum.accumulate(nearest * values, 2)
    merged = merge_surfaces(gain * colors, values, coverage, _LAYERS, 2e-3 * float(values.max()))
    surfaces = {"cut hard": (gain * colors[:, 0], values[:, 0], coverage[:, 0]), "covered": merged}
    return Scene(
        image=gain * image,
        truth=gain * scene.render(lens, view(_TRUTH), True),
        disparity=nearest * scene.disparity(lens, view(1)),
        focus=focus,
        layers={
            label: (c.reshape(*shape, 3), v.reshape(shape), a.reshape(shape))
            for label, (c, v, a) in surfaces.items()
        },
    )


def _peeled(scene: BakedScene, lens: ThinLens, view: View) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return colours, inverse depth and coverage (P, S, K) along pixel rays, the first through the centre.

    The rear side of the same body is ignored.
    """
    offsets = np.stack([halton_points(_SAMPLES, base) for base in (2, 3)], -1)[None]
    jitter = (offsets + np.random.default_rng(0).random((_WIDTH * _HEIGHT, 1, 2))) % 1 - 0.5
    jitter[:, 0] = 0
    sensor = (sensor_xy(view)[:, None] + view.pixel_pitch * jitter).reshape(-1, 2).astype(np.float32)
    rays = lens.sample_rays(sensor, np.zeros_like(sensor))
    direction = np.ascontiguousarray(np.column_stack([rays.slope, np.ones(len(sensor))]), np.float32)
    depth, body = np.zeros(len(sensor), np.float32), np.full(len(sensor), -1)
    ended = np.zeros(len(sensor), bool)
    surfaces = []
    for _ in range(_LAYERS):
        hit_triangle = np.full(len(sensor), -1, np.int32)
        barycentric = np.zeros((2, len(sensor)), np.float32)
        active = np.flatnonzero(~ended)
        while len(active):
            start = direction[active] * depth[active, None]
            start[:, :2] += np.broadcast_to(rays.origin, (len(sensor), 2))[active]
            hit = scene.soup.tree.run(start, direction[active], output=True)
            triangle = hit["primID"].astype(np.int32)
            is_hit = triangle >= 0
            depth[active] += np.where(is_hit, hit["tfar"] + 1e-4 * (depth[active] + hit["tfar"]), 0)
            owner = np.where(is_hit, scene.soup.mesh[np.maximum(triangle, 0)], -1)
            again = is_hit & (owner == body[active])
            finished = active[~again]
            hit_triangle[finished], body[finished] = triangle[~again], owner[~again]
            barycentric[:, finished] = hit["u"][~again], hit["v"][~again]
            active = active[again]
        color = scene.colours(
            {"primID": hit_triangle, "u": barycentric[0], "v": barycentric[1]}, direction[:, None, :2].copy()
        )
        alpha = np.where(ended, 0, 1).astype(np.float32)
        inverse = np.where(hit_triangle >= 0, 1 / np.maximum(depth, 1e-6), 0).astype(np.float32)
        surfaces.append((color * alpha[:, None], inverse * alpha, alpha))
        ended |= hit_triangle < 0
    colors, values, coverage = (np.stack(column, 1) for column in zip(*surfaces, strict=True))
    shape = (-1, _SAMPLES, _LAYERS)
    return colors.reshape(*shape, 3), values.reshape(shape), coverage.reshape(shape)


def scores(scene: Scene) -> dict[str, float]:
    """Return the edge PSNR of the rays with inpainted layers and with each kind of true layers, dB."""
    image = scene.image.astype(np.float32)
    defocus = defocus_from_disparity(scene.disparity, BLUR, scene.focus).astype(np.float32)
    pictures = {"guessed": rays(image, defocus, pixel_filter=_BOX)}
    for label, (colors, values, coverage) in scene.layers.items():
        radii = np.minimum.accumulate(BLUR * (values - scene.focus), 2)
        layers = Layers(colors=colors, defocus=radii, coverage=coverage)
        pictures[label] = rays(image, defocus, layers=layers)
    return {label: compare(picture, scene.truth, defocus)["edge_psnr"] for label, picture in pictures.items()}


def main() -> None:
    """Entry of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=3, help="number of scenes of each kind")
    count = parser.parse_args().scenes
    for make in (clutter, planes):
        rows = []
        for seed in range(1, count + 1):
            rows.append(scores(make(seed)))
            values = "  ".join(f"{label} {value:.2f}" for label, value in rows[-1].items())
            print(f"{make.__name__} {seed}: {values}", flush=True)
        values = "  ".join(f"{label} {np.mean([row[label] for row in rows]):.2f}" for label in rows[0])
        print(f"{make.__name__}, mean: {values}", flush=True)


if __name__ == "__main__":
    main()
