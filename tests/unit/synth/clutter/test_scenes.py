import dataclasses

import numpy as np
import pytest

from bokehnet.config import load_config
from bokehnet.errors import ParameterError
from bokehnet.synth import ClutterConfig, SynthConfig, write_dataset
from bokehnet.synth.clutter.scenes import random_clutter
from bokehnet.synth.pairs import make_sample

pytest.importorskip("embreex", reason="Embree is not installed: pip install 'bokehnet[trace]'")


@pytest.fixture(scope="module")
def config():
    return load_config("configs/synth_clutter_tiny.toml", SynthConfig)


@pytest.mark.parametrize("places", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_samples_keep_their_promises(config, places):
    recipe = dataclasses.replace(config.clutter, places=places, lamp_probability=0.5)
    config = dataclasses.replace(config, clutter=recipe)
    for index in range(3):
        sample = make_sample(config, index)
        assert sample.image.shape == (48, 48, 3)
        assert sample.bokeh.shape == (2, 48, 48, 3)
        assert sample.bokeh.dtype == np.float16
        assert sample.disparity.dtype == np.float32
        assert sample.disparity.min() >= 0
        assert 0.7 <= sample.disparity.max() <= 1.001
        assert np.isfinite(sample.image).all()
        assert np.isfinite(sample.bokeh).all()
        assert sample.image.min() >= 0
        for blur, focus in zip(sample.blur, sample.focus, strict=True):
            assert np.abs(blur * (sample.disparity - focus)).max() <= config.defocus[1] * 1.001
        # Ground, walls and things: depth takes many values, unlike that of cards that face the camera.
        assert len(np.unique(sample.disparity)) > 48 * 48 / 4
    again = make_sample(config, index)
    for name in ("image", "disparity", "bokeh"):
        assert np.array_equal(getattr(again, name), getattr(sample, name))


def test_sharp_regions_of_the_bokeh_equal_the_all_in_focus_picture(config):
    """Authority: a point with no blur images to a point; only noise and nearer objects may differ."""
    recipe = dataclasses.replace(config.clutter, foreground_probability=0.0, thin_probability=0.0)
    config = dataclasses.replace(
        config, clutter=recipe, bokeh_samples=64, image_samples=64, defocus=(2.0, 3.0)
    )
    compared = 0
    for index in range(16):
        sample = make_sample(config, index)
        for blur, focus, bokeh in zip(sample.blur, sample.focus, sample.bokeh, strict=True):
            sharp = np.abs(blur * (sample.disparity - focus)) < 0.15
            if sharp.mean() > 0.15:
                compared += 1
                image = sample.image.astype(float)[sharp]
                assert np.median(np.abs(bokeh.astype(float)[sharp] - image)) < 0.06 * image.mean()
    assert compared >= 4


def test_blur_neither_adds_nor_takes_light(config):
    """Authority: energy; over the whole picture only what crosses its border is lost or won."""
    recipe = dataclasses.replace(config.clutter, foreground_probability=0.0)
    config = dataclasses.replace(config, clutter=recipe)
    ratios = []
    for index in range(12):
        sample = make_sample(config, index)
        ratios += list(sample.bokeh.astype(float).mean((1, 2, 3)) / sample.image.astype(float).mean())
    assert np.median(ratios) == pytest.approx(1.0, abs=0.02)
    assert np.std(ratios) < 0.1


def test_views_through_catalog_lenses_differ_from_thin_ones_but_little(config):
    """Authority: the same scene through thin lenses; the blur is as wide, only its shape is another."""
    recipe = dataclasses.replace(config.clutter, lamp_probability=0.0)
    thin = dataclasses.replace(config, sensor_distance=100.0, clutter=recipe, bokeh_samples=64)
    glass = dataclasses.replace(thin, catalog=("double_gauss",), catalog_share=1.0)
    errors, blurs = [], []
    for index in range(2):
        first, second = make_sample(thin, index), make_sample(glass, index)
        assert np.array_equal(first.image, second.image)
        assert np.array_equal(first.blur, second.blur)
        errors.append(np.abs(first.bokeh.astype(float) - second.bokeh).mean())
        blurs.append(np.abs(first.bokeh.astype(float) - first.image).mean())
    assert 0 < np.mean(errors) < 0.4 * np.mean(blurs)


@pytest.mark.slow
def test_processes_give_the_bytes_of_one_process(config, tmp_path):
    for workers in (1, 2):
        write_dataset(config, tmp_path / str(workers), workers=workers)
    names = sorted(path.name for path in (tmp_path / "1").iterdir())
    assert names == ["dataset.json", "shard-000000.tar", "shard-000001.tar"]
    for name in names:
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_lamps_and_places_follow_the_recipe(config):
    for probability in (0.0, 1.0):
        recipe = dataclasses.replace(config.clutter, lamp_probability=probability)
        result = dataclasses.replace(config, clutter=recipe)
        scenes = [random_clutter(np.random.default_rng(seed), result) for seed in range(2)]
        assert all(bool(scene.lamps) == bool(probability) for scene in scenes)
    with pytest.raises(ParameterError, match="at least one weight"):
        ClutterConfig(places=(0.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match="two rising counts"):
        ClutterConfig(objects=(4, 2))
