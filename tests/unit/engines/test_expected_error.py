"""Expected error of the rays: outputs that contain it, and its agreement with the true error."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import spearmanr

from bokehnet.arrays.pyramid import crop_to, upsample2
from bokehnet.engines.engine import Engine
from bokehnet.engines.expected_error import _enlarged
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.io.channels import read_channels
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.render.look import make_lens_response
from bokehnet.render.renderer import BokehRenderer
from bokehnet.settings.settings import ColorSettings, LensSettings, OutputSettings
from tests.unit.engines.test_coarse_to_fine import picture


def test_an_exr_holds_it_as_a_channel_where_that_is_requested(tmp_path):
    image, defocus = picture(31, 43, 5)
    result = BokehRenderer("rays").render_arrays(image, defocus, options=RenderOptions(expected_error=True))
    result.save(tmp_path / "plain.exr")
    requested = replace(result, output=OutputSettings(expected_error="on"))
    requested.save(tmp_path / "errors.exr")
    requested.save(tmp_path / "errors.png")
    assert set(read_channels(tmp_path / "plain.exr").channels) == set("RGB")
    stored = read_channels(tmp_path / "errors.exr").channels
    assert set(stored) == {*"RGB", "expected_error"}
    assert_allclose(stored["expected_error"], result.expected_error, rtol=1e-3)  # half


@pytest.mark.parametrize("engine", ["rays", "hybrid"])
def test_it_is_computed_for_every_pixel_and_only_on_request(engine):
    image, defocus = picture(61, 83, 9)
    renderer = BokehRenderer(engine)
    plain, result = (
        renderer.render_arrays(image, defocus),
        renderer.render_arrays(image, defocus, options=RenderOptions(expected_error=True)),
    )
    assert plain.expected_error is None
    assert_array_equal(result.bokeh, plain.bokeh)
    assert result.expected_error.shape == (61, 83)
    assert result.expected_error.dtype == np.float32
    assert 0.04 < result.expected_error.min() <= result.expected_error.max() <= 128


def test_a_hybrid_reports_the_values_of_its_rays():
    image, defocus = picture(61, 83, 9)
    rays, hybrid = (
        Engine(name).render(image, defocus, options=RenderOptions(expected_error=True))
        for name in ("rays", "hybrid")
    )
    assert_array_equal(rays.expected_error, hybrid.expected_error)


def test_strips_report_the_values_of_the_whole():
    """Oracle: the whole picture at once."""
    image, defocus = picture(700, 96, 6)
    engine = Engine("rays")
    whole = engine.render(image, defocus, options=RenderOptions(expected_error=True))
    strips = engine.render(image, defocus, options=RenderOptions(expected_error=True, max_memory=6_000_000))
    assert strips.classical is strips.bokeh  # one array of all strips
    assert_allclose(strips.expected_error, whole.expected_error, rtol=2e-2, atol=0.05)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (17, 3), (64, 64)])
@pytest.mark.parametrize("light", [0.0, 1.0, 1e5])
def test_it_is_finite_whatever_the_picture(height, width, light):
    image, defocus = picture(height, width, 90.0)  # seen halved twice
    result = (
        Engine("rays")
        .render(light * image, defocus, options=RenderOptions(expected_error=True))
        .expected_error
    )
    assert result.shape == (height, width)
    assert np.isfinite(result).all()


def test_a_small_copy_is_enlarged_as_the_whole_at_once():
    """Oracle: doublings of the whole map; 130 rows are three bands."""
    small = np.random.default_rng(0).random((130, 8), dtype=np.float32)
    expected = crop_to(upsample2(upsample2(small)), 517, 31)
    assert_allclose(_enlarged(small, 2, 517, 31), expected, rtol=1e-6)
    assert_array_equal(_enlarged(small, 0, 130, 7), small[:, :7])


@pytest.mark.parametrize(
    ("engine", "options", "words"),
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
def test_without_learned_statistics_nothing_is_reported(engine, options, words):
    image, defocus = picture(16, 16, 3)
    with pytest.raises(ParameterError, match=words):
        Engine(engine).render(image, defocus, options=RenderOptions(expected_error=True, **options))


def test_it_ranks_the_pixels_of_an_independent_renderer(shared):
    """Authority: a path-traced shot that nothing was trained on, within reach of depth discontinuities."""
    from train.scores.evaluation_sets import list_pictures

    folder = shared("cycles/s1_still_life/scene.json").parents[1]
    shot = list_pictures("cycles", folder)[2].read()
    result = Engine("rays").render(
        shot.image, shot.defocus, options=RenderOptions(aperture=shot.aperture, expected_error=True)
    )
    actual, expected = (linear_to_srgb(np.clip(x, 0, 1)) for x in (result.bokeh, shot.truth))
    true = 255 * np.abs(actual - expected).mean(-1)  # levels
    near = result.error_map > 0
    assert spearmanr(result.expected_error[near], true[near]).statistic > 0.3
    ratio = result.expected_error[near].mean() / true[near].mean()
    assert 0.5 < ratio < 2
