"""Pictures made of finer ones, and disparity inside pixels."""

from dataclasses import replace

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.pairs import make_sample
from bokehnet.synth.subpixel import draw_pixel_filter

SMALL = SynthConfig(seed=4, scenes=1, width=48, height=40, views=0, image_samples=1, fine=4)


def test_filters_are_plain_means_and_gaussians_of_the_widths_of_cameras():
    drawn = [draw_pixel_filter(np.random.default_rng(seed)) for seed in range(200)]
    assert 0.1 < np.mean([result == PixelFilter("box", 1) for result in drawn]) < 0.3
    widths = [result.width for result in drawn if result.name == "gaussian"]
    assert 1.3 <= min(widths) < 1.4
    assert 2.6 < max(widths) <= 2.7


@pytest.mark.parametrize("kind", ["planes", "clutter"])
def test_fine_disparity_is_close_to_that_of_the_pixels(kind):
    """The centre of a pixel lies between four fine ones, all of which see what it sees, but at edges."""
    sample = make_sample(replace(SMALL, kind=kind), 0)
    assert sample.image.shape == (40, 48, 3)
    assert sample.bokeh.shape == (0, 40, 48, 3)
    assert sample.fine_disparity.shape == (160, 192)
    inside = sample.fine_disparity.reshape(40, 4, 48, 4).astype(np.float32)[:, 1:3, :, 1:3]
    low, high = inside.min((1, 3)) - 0.003, inside.max((1, 3)) + 0.003
    assert (
        (low <= sample.disparity) & (sample.disparity <= high)
    ).mean() > 0.97  # not where hairs lie between


def test_without_the_file_there_is_no_value():
    assert make_sample(replace(SMALL, fine=0, views=1, bokeh_samples=1), 0).fine_disparity.size == 0


@pytest.mark.parametrize(
    ("change", "name"), [({"fine": 3}, "fine"), ({"fine": -2}, "fine"), ({"views": -1}, "views")]
)
def test_impossible_settings_are_refused(change, name):
    with pytest.raises(ParameterError, match=name):
        replace(SMALL, **change)
    with pytest.raises(ParameterError, match="views"):
        replace(SMALL, fine=0)
