"""Expected error of the rays: availability, and correlation with the true error."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import spearmanr

from bokehnet.arrays.pyramid import crop_to, upsample2
from bokehnet.engines.engine import Engine
from bokehnet.engines.expected_error import _enlarged
from bokehnet.errors import ParameterError
from bokehnet.io.channels import read_channels
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.render.look import make_lens_response
from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import ColorSettings, LensSettings, OutputSettings
from tests.unit.engines.test_coarse_to_fine import picture


def test_an_exr_contains_the_channel_only_on_request(tmp_path):
    image, defocus = picture(31, 43, 5)
    result = BokehRenderer("rays").render(image, defocus, expected_error=True)
    result.save(tmp_path / "plain.exr")
    with_output = replace(result, output=OutputSettings(expected_error="on"))
    with_output.save(tmp_path / "with_error.exr")
    with_output.save(tmp_path / "with_error.png")
    assert set(read_channels(tmp_path / "plain.exr").channels) == set("RGB")
    stored = read_channels(tmp_path / "with_error.exr").channels
    assert set(stored) == {*"RGB", "expected_error"}
    assert_allclose(stored["expected_error"], result.expected_error, rtol=1e-3)  # half


@pytest.mark.parametrize("engine", ["rays", "hybrid"])
def test_the_error_covers_every_pixel_and_is_computed_only_on_request(engine):
    image, defocus = picture(61, 83, 9)
    renderer = BokehRenderer(engine)
    plain, result = renderer.render(image, defocus), renderer.render(image, defocus, expected_error=True)
    assert plain.expected_error is None
    assert_array_equal(result.bokeh, plain.bokeh)
    assert result.expected_error.shape == (61, 83)
    assert result.expected_error.dtype == np.float32
    assert 0.04 < result.expected_error.min() <= result.expected_error.max() <= 128


def test_a_hybrid_returns_the_error_of_its_rays():
    image, defocus = picture(61, 83, 9)
    rays, hybrid = (Engine(name).render(image, defocus, expected_error=True) for name in ("rays", "hybrid"))
    assert_array_equal(rays.expected_error, hybrid.expected_error)


def test_strips_give_the_error_of_the_whole_picture():
    """Oracle: the whole picture without strips."""
    image, defocus = picture(700, 96, 6)
    engine = Engine("rays")
    whole = engine.render(image, defocus, expected_error=True)
    strips = engine.render(image, defocus, expected_error=True, max_memory=6_000_000)
    assert strips.classical is strips.bokeh  # one array of all strips
    assert_allclose(strips.expected_error, whole.expected_error, rtol=2e-2, atol=0.05)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (17, 3), (64, 64)])
@pytest.mark.parametrize("light", [0.0, 1.0, 1e5])
def test_the_error_is_finite_for_any_picture(height, width, light):
    image, defocus = picture(height, width, 90.0)  # halved twice for the network
    values = Engine("rays").render(light * image, defocus, expected_error=True).expected_error
    assert values.shape == (height, width)
    assert np.isfinite(values).all()


def test_bands_are_enlarged_like_the_whole_map():
    """Oracle: doubling of the whole map; 130 rows are three bands."""
    small = np.random.default_rng(0).random((130, 8), dtype=np.float32)
    expected = crop_to(upsample2(upsample2(small)), 517, 31)
    assert_allclose(_enlarged(small, 2, 517, 31), expected, rtol=1e-6)
    assert_array_equal(_enlarged(small, 0, 130, 7), small[:, :7])


@pytest.mark.parametrize(
    ("engine", "options", "message"),
    [
        ("scatter", {}, "expected_error: expected an engine with rays: rays or hybrid, got `scatter`"),
        ("tan", {}, "expected_error: expected an engine with rays"),
        ("rays", {"gamma": 2.0}, "expected_error: expected a perfect lens and a gamma of 1"),
        (
            "rays",
            {"lens_response": make_lens_response(LensSettings(coma=2), ColorSettings())},
            "expected a perfect lens",
        ),
    ],
)
def test_untrained_cases_raise_an_error(engine, options, message):
    image, defocus = picture(16, 16, 3)
    with pytest.raises(ParameterError, match=message):
        Engine(engine).render(image, defocus, expected_error=True, **options)


def test_the_error_ranks_the_pixels_of_an_independent_renderer(shared):
    """Authority: a held-out path-traced shot, near depth discontinuities."""
    from train.evaluation_sets import list_pictures

    folder = shared("cycles/s1_still_life/scene.json").parents[1]
    shot = list_pictures("cycles", folder)[2].read()
    result = Engine("rays").render(shot.image, shot.defocus, aperture=shot.aperture, expected_error=True)
    values, expected = (linear_to_srgb(np.clip(x, 0, 1)) for x in (result.bokeh, shot.truth))
    true_error = 255 * np.abs(values - expected).mean(-1)  # levels
    near_edges = result.error_map > 0
    assert spearmanr(result.expected_error[near_edges], true_error[near_edges]).statistic > 0.3
    ratio = result.expected_error[near_edges].mean() / true_error[near_edges].mean()
    assert 0.5 < ratio < 2
