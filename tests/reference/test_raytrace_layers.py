"""Layers that a renderer took from behind things, in the classical rays renderer."""

import math

import numpy as np
import pytest

from bokehnet import rays
from bokehnet.classical.layered.background.occluded_background import occluded_background
from bokehnet.classical.layered.layers import Layers
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.raytrace import Camera, render_all_in_focus, render_bokeh, render_disparity
from bokehnet.raytrace.peeling import peel
from bokehnet.raytrace.world import world_from_scene
from bokehnet.synth import SceneConfig, SynthConfig
from bokehnet.synth.pairs import lens_for_view
from bokehnet.synth.scenes import random_scene

CONFIG = SynthConfig(
    seed=1,
    scenes=1,
    width=96,
    height=96,
    bokeh_samples=1,
    image_samples=1,
    scene=SceneConfig(light_probability=0.0, photographs=("coffee", "gravel", "rocket")),
)


def layers_from(peeled, lens, pixel_pitch):
    """A peeled scene as layers of the rays; ``pixel_pitch`` in mm."""
    disparity = 1 / peeled.depth.cpu().numpy().astype(np.float64)
    return Layers(
        colors=peeled.colors.cpu().numpy(),
        defocus=lens.coc_radius(disparity) / pixel_pitch,
        coverage=peeled.coverage.cpu().numpy().clip(0, 1),
    )


def psnr(first, second):
    return -10 * math.log10(float(((first.clip(0, 1) - second.clip(0, 1)) ** 2).mean()))


@pytest.mark.parametrize("seed", [1, 3, 4])
def test_true_layers_behind_come_nearer_to_the_truth_than_filled_ones(seed):
    """Authority: the ray tracer; what stands behind things is known to it and guessed by the fill."""
    scene = random_scene(np.random.default_rng(seed), CONFIG)
    blur, focus = 12.0, 0.25
    lens = lens_for_view(blur, focus, CONFIG)
    camera = Camera(lens=lens, width=CONFIG.width, height=CONFIG.height, pixel_pitch=CONFIG.pixel_pitch)
    truth = render_bokeh(scene, camera, 256, 0).numpy()
    image = render_all_in_focus(scene, camera, 64, 1).numpy()
    disparity = render_disparity(scene, camera).numpy() * CONFIG.nearest_distance
    defocus = defocus_from_disparity(disparity, blur, focus).astype(np.float32)
    peeled = peel(world_from_scene(scene), camera, 6, samples=1, bounces=0)
    layers = layers_from(peeled, lens, CONFIG.pixel_pitch)
    assert np.allclose(layers.defocus[..., 0].clip(defocus), layers.defocus[..., 0])  # first surfaces agree
    hidden, behind = occluded_background(image, defocus)
    guessed = Layers(
        colors=np.stack([image, hidden], 2),
        defocus=np.stack([defocus, behind], -1),
        coverage=np.ones((*defocus.shape, 2)),
    )
    filled, known, unmixed = (
        psnr(rays(image, defocus, layers=choice), truth) for choice in (guessed, layers, None)
    )
    assert known > filled + 1
    assert known > unmixed + 0.2  # whose first surfaces know their coverage too
