"""Pictures made of finer ones, and disparity inside pixels."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import ParameterError
from bokehnet.synth.config import SynthConfig
from bokehnet.synth.pairs import make_sample
from bokehnet.synth.subpixel import draw_pixel_filter, filter_pixels

SMALL = SynthConfig(seed=4, scenes=1, width=48, height=40, views=0, image_samples=1, fine=4)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("factor", [2, 4])
def test_filters_are_even_and_keep_light(seed, factor):
    weights = draw_pixel_filter(factor, np.random.default_rng(seed))
    assert_allclose(weights.sum(), 1, rtol=1e-6)
    assert_allclose(weights, weights[::-1])
    assert weights.min() >= 0


def test_filtering_is_the_weighted_sum_around_each_centre():
    """Against the sum written out."""
    rng = np.random.default_rng(0)
    fine, factor = rng.random((5 * 4, 6 * 4, 2)), 4
    weights = draw_pixel_filter(factor, rng)
    reach = (len(weights) - factor) // 2
    padded = np.pad(fine, ((reach, reach), (reach, reach), (0, 0)), "edge")
    wanted = np.zeros((5, 6, 2))
    for y in range(5):
        for x in range(6):
            window = padded[4 * y : 4 * y + len(weights), 4 * x : 4 * x + len(weights)]
            wanted[y, x] = np.einsum("i,j,ijc->c", weights, weights, window)
    assert_allclose(filter_pixels(fine, factor, weights), wanted, rtol=1e-6)


@pytest.mark.parametrize("kind", ["planes", "clutter"])
def test_fine_disparity_lies_around_that_of_the_pixels(kind):
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


def test_without_it_there_is_none():
    assert make_sample(replace(SMALL, fine=0, views=1, bokeh_samples=1), 0).fine_disparity.size == 0


@pytest.mark.parametrize(
    ("change", "name"), [({"fine": 3}, "fine"), ({"fine": -2}, "fine"), ({"views": -1}, "views")]
)
def test_impossible_settings_are_refused(change, name):
    with pytest.raises(ParameterError, match=name):
        replace(SMALL, **change)
    with pytest.raises(ParameterError, match="views"):
        replace(SMALL, fine=0)
