"""Common properties of all baselines, and engines that render with them."""

from importlib import import_module

import numpy as np
import pytest

from bokehnet import Aperture, BokehRenderer, RenderSettings, baselines, read_image, read_scene, write_image
from bokehnet.baselines import BASELINES
from bokehnet.engine_registry import ENGINES
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.io.image import write_map
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.tools.comparison import compare_engines

NAMES = [*BASELINES]

# Methods without networks, which would estimate even a uniform picture.
EXACT = [name for name in NAMES if name != "bokehme"]

# Which test of this folder writes each method out, pixel by pixel.
ORACLES = {
    "gather_basic": "test_gathers.test_basic_gather_is_the_first_listing_with_its_mean_corrected",
    "gather_spiral": "test_gathers.test_advanced_gather_is_the_second_listing",
    "gather_bokeh": "test_gathers.test_bokeh_gather_is_its_description",
    "gather_passes": "test_oracles.test_multi_pass_gather_composites_two_planes_over_the_sharp_picture",
    "jimenez": "test_oracles.test_scatter_as_you_gather_is_its_passes_one_after_the_other",
    "tan": "test_oracles.test_scatter_as_you_gather_is_its_passes_one_after_the_other",
    "abadie": "test_oracles.test_abadie_is_two_gathered_layers_with_sprites",
    "diffusion": "test_oracles.test_diffusion_solves_its_system_for_all_rows_then_all_columns",
    "overlap": "test_filters.test_overlap_filter_is_its_equation_column_by_column_then_row_by_row",
    "low_rank": "test_filters.test_low_rank_at_full_rank_spreads_the_image_of_the_opening",
    "lommel": "test_oracles.test_lommel_spreads_the_spot_of_each_channels_wavelength",
    "rectangle": "spread.test_spreading.test_rectangle_spreads_squares_of_the_discs_area",
    "perimeter": "spread.test_spreading.test_perimeter_spreads_the_whole_image_of_the_opening",
    "hybrid_spreading": "test_oracles."
    "test_hybrid_spreading_draws_outlines_of_salient_pixels_and_squares_elsewhere",
    "spread_intervals": "spread.test_layered_spreading.test_intervals_are_spread_and_composited",
    "spread_pixel_layers": "spread.test_layered_spreading."
    "test_pixel_layers_are_sorted_by_the_surface_of_the_pixel",
    "lens_spreading": "test_oracles.test_lens_spreading_mixes_the_tables_of_four_places_and_two_blurs",
    "profile_spreading": "test_oracles.test_profile_spreading_mixes_the_ring_means_of_two_blurs",
    "image_rays": "test_oracles.test_image_rays_meet_the_first_square_of_all",
    "bokehme_scatter": "spread.test_spreading.test_the_published_scatter_is_its_double_loop",
    "bokehme": "spread.test_bokehme.test_numpy_torch_and_onnx_agree",
}


def scene(height=33, width=41):
    rng = np.random.default_rng(5)
    image = rng.random((height, width, 3)).astype(np.float32)
    defocus = np.full((height, width), -3.0, np.float32)
    defocus[8:20, 10:24] = 4.5
    defocus[22:, :] = 0
    return image, defocus


@pytest.mark.parametrize("name", EXACT)
def test_one_colour_stays_one_colour(name):
    _, defocus = scene()
    image = np.full((*defocus.shape, 3), (0.2, 0.5, 3.0), np.float32)
    assert np.allclose(getattr(baselines, name)(image, defocus), image, rtol=2e-3)


@pytest.mark.parametrize("name", EXACT)
def test_what_is_in_focus_stays_as_it_is(name):
    image, defocus = scene()
    bokeh = getattr(baselines, name)(image, np.zeros_like(defocus))
    spot = (
        0.35 if name in ("lommel", "bokehme_scatter") else 1e-6
    )  # diffraction, and discs of more than a pixel
    assert np.abs(bokeh - image).max() <= spot
    assert bokeh.dtype == np.float32
    assert bokeh is not image


@pytest.mark.parametrize("name", NAMES)
def test_the_engine_renders_what_the_function_renders(name):
    image, defocus = scene()
    rendered = Engine(name).render(image, defocus)
    assert np.array_equal(rendered.bokeh, getattr(baselines, name)(image, defocus))
    assert rendered.error_map.shape == defocus.shape


@pytest.mark.parametrize("name", NAMES)
def test_what_a_method_does_not_know_is_refused(name):
    image, defocus = scene(12, 12)
    method, fringes = (
        getattr(baselines, name),
        LensResponse(chromatic_aberration=ChromaticAberration(axial=1)),
    )
    if name not in ("lens_spreading", "profile_spreading"):
        with pytest.raises(ParameterError, match=r"^engine: expected one that supports aberrations"):
            Engine(name).render(image, defocus, options=RenderOptions(lens_response=fringes))
    with pytest.raises(ParameterError, match=r"^max_memory: expected None"):
        Engine(name).render(image, defocus, options=RenderOptions(max_memory=10**9))
    with pytest.raises(ShapeError):
        method(image, defocus[1:])
    with pytest.raises(ParameterError, match="defocus"):
        method(image, np.where(defocus > 0, np.nan, defocus))
    known = BASELINES[name].apertures
    for aperture, knows in (
        (Aperture(blades=5), ("outline", "cats-eye", "any")),
        (Aperture(obstruction=0.4), ("any",)),
        (Aperture(cats_eye=0.8), ("cats-eye",)),
    ):
        if known in knows:
            assert np.isfinite(method(image, defocus, aperture)).all()
        else:
            with pytest.raises(ParameterError, match=rf"^aperture: expected .*{name}"):
                method(image, defocus, aperture)


@pytest.mark.parametrize("name", NAMES)
def test_each_method_has_a_slow_oracle(name):
    file, function = ORACLES[name].rsplit(".", 1)
    test = getattr(import_module(f"{__package__}.{file}"), function)
    options = [mark.args[1] for mark in getattr(test, "pytestmark", [])]
    assert name in test.__code__.co_names or any(name in row for rows in options for row in rows)
    assert "expected" in test.__code__.co_varnames or "sums" in test.__code__.co_varnames


def test_baselines_are_listed_with_the_engines():
    assert not set(BASELINES) & set(ENGINES)
    assert set(BASELINES) < set(baselines.__all__)
    for name in BASELINES:
        assert getattr(baselines, name).__doc__.count("Source:") == 1
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = baselines.nothing


def test_compare_runs_a_baseline_on_files(cli, tmp_path):
    """Oracle: the method called on the arrays of the same files."""
    image, defocus = scene()
    write_image(tmp_path / "in.exr", image)
    write_map(tmp_path / "d.exr", (defocus + 3) / 7.5, channel="disparity")
    settings = RenderSettings().updated(
        {
            "input": {"disparity": tmp_path / "d.exr"},
            "camera": {"blur": 7.5},
            "focus": {"value": 0.4},
            "depth": {"value_range": (0, 1), "repair": "off"},
        }
    )
    (compared,) = compare_engines(read_scene(tmp_path / "in.exr", settings), settings, ["overlap"])
    expected = BokehRenderer("overlap").render_arrays(read_image(tmp_path / "in.exr"), defocus).bokeh
    assert np.abs(compared.bokeh - expected).max() < 0.02
    words = ["compare", tmp_path / "in.exr", "--disparity", tmp_path / "d.exr", "--blur", 7.5, "--focus", 0.4]
    refused = cli(*words, "-o", tmp_path / "no.png", "--engines", "overlap", "--blades", 5)
    assert refused.code == 1
    assert "overlap" in refused.err
    assert not (tmp_path / "no.png").exists()
