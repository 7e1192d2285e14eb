import math

import numpy as np
import pytest

from bokehnet.config import load_config
from bokehnet.lenses import defocus_map
from bokehnet.synth import SceneConfig, SynthConfig
from bokehnet.synth.pairs import lens_for_view, make_sample
from bokehnet.synth.scenes import random_scene

TINY = "configs/synth_tiny.toml"


@pytest.fixture(scope="module")
def config():
    return load_config(TINY, SynthConfig)


def test_blur_times_disparity_is_the_circle_of_confusion_of_the_lens(config):
    """Authority: coc_radius in metric units."""
    disparity = np.linspace(0, 1, 7)[None]
    for blur, focus in ((25.0, 0.3), (4.0, 0.0), (60.0, 1.0)):
        lens = lens_for_view(blur, focus, config)
        assert lens.sensor_distance == pytest.approx(config.sensor_distance)
        radius = defocus_map(disparity / config.nearest_distance, lens, config.pixel_pitch)
        assert radius == pytest.approx(blur * (disparity - focus), abs=1e-9)
    assert lens_for_view(4.0, 0.0, config).focus_distance == math.inf


def test_samples_keep_their_promises(config):
    for index in range(3):
        sample = make_sample(config, index)
        assert sample.image.shape == (64, 64, 3)
        assert sample.image.dtype == np.float16
        assert sample.bokeh.shape == (2, 64, 64, 3)
        assert sample.disparity.dtype == np.float32
        assert sample.disparity.min() >= 0
        assert sample.disparity.max() <= 1
        for blur, focus in zip(sample.blur, sample.focus, strict=True):
            radius = np.abs(blur * (sample.disparity - focus)).max()
            assert radius <= config.defocus[1] * 1.001
        again = make_sample(config, index)
        assert np.array_equal(sample.bokeh, again.bokeh)


def test_sharp_regions_of_the_bokeh_equal_the_all_in_focus_picture():
    """Authority: a point with no blur images to a point; only noise and nearer objects may differ."""
    scene = SceneConfig(planes=(0, 1), ground_probability=0.0, light_probability=0.0)
    config = SynthConfig(seed=3, scenes=1, width=64, height=64, views=2, defocus=(2.0, 4.0), scene=scene)
    compared = 0
    for index in range(6):
        sample = make_sample(config, index)
        for blur, focus, bokeh in zip(sample.blur, sample.focus, sample.bokeh, strict=True):
            sharp = np.abs(blur * (sample.disparity - focus)) < 0.1
            if sharp.mean() > 0.3:
                compared += 1
                image = sample.image.astype(float)[sharp]
                difference = np.abs(bokeh.astype(float)[sharp] - image)
                assert np.median(difference) < 0.02 * image.mean()
    assert compared >= 4


def test_no_corner_of_a_scene_is_nearer_than_the_nearest_distance(config):
    for seed in range(40):
        scene = random_scene(np.random.default_rng(seed), config)
        for plane in scene.planes:
            assert plane.corners[:, 2].min() >= config.nearest_distance * (1 - 1e-9)
