"""Held-out ray-traced scenes of textured planes, cached on disk: ground truth for classical renderers.

Each truth is traced twice with different rays; engines are compared with the mean, and the difference
measures its noise.
"""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tqdm import tqdm

from bokehnet.lenses import LensModel, ThinLens
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.raytrace import Camera, render_all_in_focus, render_bokeh, render_disparity
from bokehnet.synth import SceneConfig, SynthConfig
from bokehnet.synth.pairs import lens_for_view
from bokehnet.synth.scenes import random_scene
from train.scores.evaluation_sets import Shot
from train.scores.metrics import compare

__all__ = ["LAMPS", "PLANES", "read_traced"]

_HELD_OUT = ("coffee", "gravel", "rocket")  # photographs that the training scenes do not show

PLANES = SynthConfig(
    seed=2000003,
    scenes=8,
    width=384,
    height=384,
    bokeh_samples=512,
    image_samples=64,
    defocus=(10.0, 40.0),
    scene=SceneConfig(light_probability=0.0, photographs=_HELD_OUT),
)
# The same with small lamps, up to hundreds of times brighter than their surroundings.
LAMPS = SynthConfig(
    seed=2000029,
    scenes=4,
    width=384,
    height=384,
    bokeh_samples=1536,
    image_samples=64,
    defocus=(10.0, 40.0),
    scene=SceneConfig(light_probability=1.0, photographs=_HELD_OUT),
)


def read_traced(config: SynthConfig, folder: Path) -> Iterator[Shot]:
    """Yield the shots of a set, one per scene; traces those that are missing in ``folder``.

    A file name includes everything that determines its content except the code that draws scenes: delete the
    folder after changes of that code.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for index in tqdm(range(config.scenes), desc="traced scenes", mininterval=1):
        name = f"{config.seed}-{config.width}x{config.height}-{config.bokeh_samples}-{index}.npz"
        if not (folder / name).exists():
            partial = folder / f"partial-{name}"
            np.savez(partial, **_trace(config, index))
            partial.replace(folder / name)
        with np.load(folder / name) as arrays:
            image, defocus, first, second = (arrays[key] for key in ("image", "defocus", "first", "second"))
        noise = compare(first, second, defocus)
        # The difference of the halves has twice the variance of one, their mean half of it: 6 dB.
        noise |= {key: noise[key] + 20 * math.log10(2) for key in ("psnr", "edge_psnr")}
        yield Shot(image=image, defocus=defocus, truth=(first + second) / 2, noise=noise)


def _trace(config: SynthConfig, index: int) -> dict[str, np.ndarray]:
    """Trace one scene, focused at a depth in the picture; the maximum radius is log-uniform."""
    rng = np.random.default_rng([config.seed, index])
    scene = random_scene(rng, config)
    pinhole = _camera(config, ThinLens(focal_length=config.sensor_distance, f_number=1.0))
    disparity = render_disparity(scene, pinhole).numpy() * np.float32(config.nearest_distance)
    target = rng.uniform(disparity.min(), disparity.max())
    focus = float(disparity.flat[np.abs(disparity - target).argmin()])
    radius = math.exp(rng.uniform(*np.log(config.defocus)))
    blur = radius / max(float(np.abs(disparity - focus).max()), 0.1)
    lens = _camera(config, lens_for_view(blur, focus, config))
    first, second = (render_bokeh(scene, lens, config.bokeh_samples, seed).numpy() for seed in (0, 1))
    return {
        "image": render_all_in_focus(scene, pinhole, config.image_samples, 2).numpy(),
        "defocus": defocus_from_disparity(disparity, np.float32(blur), np.float32(focus)),
        "first": first,
        "second": second,
    }


def _camera(config: SynthConfig, lens: LensModel) -> Camera:
    return Camera(lens=lens, width=config.width, height=config.height, pixel_pitch=config.pixel_pitch)
