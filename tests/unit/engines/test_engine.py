"""The renderer as users get it, the hybrid with small random networks."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.engines import tiling
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.inference.coarse_to_fine import Level, refine_whole, render_neural
from bokehnet.inference.session import load_networks
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.onnx_export import export_networks
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.tone import Highlights, gamma_curve
from bokehnet.render.renderer import BokehRenderer


def scatter_of(image, defocus, aperture=None):
    """Return the picture of the classical renderer."""
    return render_scatter(image, defocus, aperture).bokeh


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    torch.manual_seed(0)
    networks = ARNet(ARNetConfig(width=8)), IUNet(IUNetConfig(width=8))
    for network in networks:
        torch.nn.init.normal_(network.backbone.head.weight, std=0.004)
    folder = tmp_path_factory.mktemp("weights")
    export_networks(dict(zip(("arnet", "iunet"), networks, strict=True)), folder, {"classical": "scatter"})
    return folder, networks


def picture(height: int, width: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    inside = np.hypot(y - height / 2, x - width / 3) < height / 4
    defocus = np.where(inside, radius, -0.2 * radius).astype(np.float32)
    return rng.random((height, width, 3), dtype=np.float32), defocus


@pytest.mark.parametrize(("height", "width", "radius"), [(37, 51, 4), (64, 48, 15), (61, 83, 33), (1, 1, 3)])
def test_inference_equals_the_torch_cascade(pair, height, width, radius):
    """One body serves training and inference: the same picture to float precision, odd sizes included."""
    folder, (arnet, iunet) = pair
    image, defocus = picture(height, width, radius)
    result = BokehRenderer("neural", weights=folder).render_arrays(image, defocus)
    classical = scatter_of(image, defocus)
    tensors = [torch.from_numpy(x).permute(2, 0, 1)[None] for x in (image, defocus[..., None], classical)]
    error_map = torch.from_numpy(geometric_error_map(defocus))[None, None]
    networks = {"arnet": arnet.eval(), "iunet": iunet.eval()}
    with torch.no_grad():
        expected = render_neural(
            *tensors, error_map, **networks, network_max_radius=10.0, leaves_outlines=True
        )
    assert_allclose(result.bokeh, expected.bokeh[0].permute(1, 2, 0).numpy(), atol=1e-4)
    assert_allclose(result.error_map, expected.error_map[0, 0].numpy(), atol=1e-4)


def test_tiles_give_the_same_picture_as_the_whole(pair, monkeypatch):
    """The halo covers the receptive field: no seam, at least 60 dB, here to float precision."""
    folder, _ = pair
    monkeypatch.setattr(tiling, "TILE", 64)
    iunet = load_networks(folder, "scatter").iunet
    rng = np.random.default_rng(1)
    level = Level(
        image=rng.random((1, 3, 152, 208), dtype=np.float32),
        defocus=rng.uniform(-12, 12, (1, 1, 152, 208)).astype(np.float32),
        classical=rng.random((1, 3, 152, 208), dtype=np.float32),
        classical_error_map=np.ones((1, 1, 152, 208), np.float32),
    )
    coarse = rng.random((1, 3, 76, 104), dtype=np.float32)
    everywhere = np.ones((1, 1, 152, 208), np.float32)
    tiled = tiling.refine_in_tiles(iunet, level, coarse, everywhere)
    assert_allclose(tiled, refine_whole(iunet, level, coarse, everywhere), atol=1e-5)


def test_skipped_tiles_change_no_pixel_that_is_used(pair, monkeypatch):
    """Several levels up, a pixel in use must not see that tiles away from all edges were skipped."""
    folder, _ = pair
    monkeypatch.setattr(tiling, "TILE", 64)
    rng = np.random.default_rng(2)
    defocus = np.full((400, 600), -1.0, np.float32)
    defocus[150:200, 250:290] = 38.0
    image = rng.random((400, 600, 3), dtype=np.float32)
    batches = [x.transpose(2, 0, 1)[None] for x in (image, defocus[..., None], scatter_of(image, defocus))]
    loaded = load_networks(folder, "scatter")
    ran = []

    def iunet(*arrays):
        ran.append(arrays[0].shape)
        return loaded.iunet(*arrays)

    classical_error_map = geometric_error_map(defocus)[None, None]
    shared = {"arnet": loaded.arnet, "network_max_radius": loaded.network_max_radius}
    whole = render_neural(*batches, classical_error_map, iunet=loaded.iunet, **shared)
    tiled = render_neural(*batches, classical_error_map, iunet=iunet, refine=tiling.refine_in_tiles, **shared)
    used = (whole.error_map > 0)[0, 0]
    assert 0.05 < used.mean() < 0.6
    assert len(ran) < 7 * 10 + 4 * 5
    assert_array_equal(tiled.error_map, whole.error_map)
    assert_allclose(tiled.steps[-1][..., used], whole.steps[-1][..., used], atol=1e-5)


def test_tiles_without_error_are_not_refined(pair):
    def never(*arrays):
        raise AssertionError("ran on a tile whose error map is zero")

    level = Level(
        image=np.zeros((1, 3, 32, 32), np.float32),
        defocus=np.zeros((1, 1, 32, 32), np.float32),
        classical=np.zeros((1, 3, 32, 32), np.float32),
        classical_error_map=np.zeros((1, 1, 32, 32), np.float32),
    )
    coarse = np.full((1, 3, 16, 16), 0.5, np.float32)
    assert_array_equal(tiling.refine_in_tiles(never, level, coarse, np.zeros((1, 1, 32, 32))), 0.5)


def test_where_the_error_map_is_zero_a_highlight_passes_unchanged(pair):
    folder, _ = pair
    image, defocus = picture(64, 64, 6)
    image[10, 50] = 1000.0
    result = BokehRenderer("neural", weights=folder).render_arrays(image, defocus)
    zero = geometric_error_map(defocus) == 0
    assert zero[10, 50]
    assert_array_equal(result.bokeh[zero], result.classical[zero])
    assert np.isfinite(result.bokeh).all()
    assert result.bokeh.min() >= 0


def test_the_scatter_engine_is_the_scatter():
    image, defocus = picture(40, 50, 8)
    result = BokehRenderer("scatter").render_arrays(image, defocus)
    assert_array_equal(result.bokeh, scatter_of(image, defocus))
    assert result.neural is None


def test_the_default_engine_is_the_rays():
    image, defocus = picture(40, 50, 8)
    renderer = BokehRenderer()
    result = renderer.render_arrays(image, defocus)
    assert renderer.engine == "rays"
    assert_array_equal(result.bokeh, rays(image, defocus))
    assert_array_equal(result.classical, result.bokeh)
    assert result.neural is None


PENTAGON = Aperture(blades=5, rotation=20)


@pytest.mark.parametrize(
    ("engine", "expected"),
    [("scatter", scatter_of), ("rays", lambda *args: rays(*args[:2], aperture=args[2]))],
)
def test_the_aperture_reaches_the_engine(engine, expected):
    image, defocus = picture(40, 50, 8)
    result = BokehRenderer(engine, aperture=PENTAGON).render_arrays(image, defocus)
    assert_array_equal(result.bokeh, expected(image, defocus, PENTAGON))
    assert np.abs(result.bokeh - BokehRenderer(engine).render_arrays(image, defocus).bokeh).max() > 0.01


@pytest.mark.parametrize("engine", ["scatter", "rays"])
def test_gamma_is_the_curve_around_the_engine(engine):
    """Oracle: encode, render, decode by hand; the curve has its own tests."""
    image, defocus = picture(40, 50, 8)
    image[5, 7] = 50.0
    curve = gamma_curve(image, 2.5)
    renderer = BokehRenderer(engine)
    result = renderer.render_arrays(image, defocus, options=RenderOptions(gamma=2.5))
    expected = curve.decode(renderer.render_arrays(curve.encode(image), defocus).bokeh)
    assert_array_equal(result.bokeh, expected)
    assert_array_equal(result.classical, expected)
    assert result.bokeh.dtype == np.float32
    assert result.bokeh.mean() > 1.2 * renderer.render_arrays(image, defocus).bokeh.mean()


@pytest.mark.parametrize("engine", ["scatter", "rays"])
@pytest.mark.parametrize("gamma", [0.3, 1.0, 2.2, 5.0])
def test_powers_of_small_and_large_values_neither_underflow_nor_overflow(engine, gamma):
    """Authority: a mean lies between the least and the largest of its values."""
    image, defocus = picture(40, 50, 8)
    image = 10 ** (10 * image - 6)
    result = BokehRenderer(engine).render_arrays(image, defocus, options=RenderOptions(gamma=gamma))
    assert result.bokeh.min() >= 0.99e-6
    assert result.bokeh.max() <= 1.01e4


def test_highlights_are_expanded_before_and_stay_unclipped():
    """Oracle: the expansion, which has its own tests, by hand."""
    image, defocus = picture(40, 50, 8)
    curve = Highlights(threshold=0.7, gain=5)
    renderer = BokehRenderer("scatter")
    result = renderer.render_arrays(image, defocus, options=RenderOptions(highlights=curve))
    assert_array_equal(result.bokeh, renderer.render_arrays(curve.expand(image), defocus).bokeh)
    sharp = renderer.render_arrays(
        image, np.zeros_like(defocus), options=RenderOptions(highlights=curve)
    ).bokeh
    assert sharp.max() > 4
    assert_allclose(curve.compress(sharp), image, rtol=1e-5)


def test_the_hybrid_takes_highlights(pair):
    image, defocus = picture(40, 50, 8)
    curve = Highlights(threshold=0.7, gain=5)
    renderer = BokehRenderer("neural", weights=pair[0])
    result = renderer.render_arrays(image, defocus, options=RenderOptions(highlights=curve))
    assert_array_equal(result.bokeh, renderer.render_arrays(curve.expand(image), defocus).bokeh)


def test_the_hybrid_takes_the_shape_of_the_aperture_from_its_classical_half(pair):
    image, defocus = picture(40, 50, 8)
    result = BokehRenderer("neural", aperture=PENTAGON, weights=pair[0]).render_arrays(image, defocus)
    assert_array_equal(result.classical, scatter_of(image, defocus, PENTAGON))
    assert (
        np.abs(
            result.bokeh - BokehRenderer("neural", weights=pair[0]).render_arrays(image, defocus).bokeh
        ).max()
        > 0.01
    )


def test_a_gamma_the_hybrid_was_not_trained_on_names_the_way_out(pair):
    renderer = BokehRenderer("neural", weights=pair[0])
    with pytest.raises(ParameterError, match=r"gamma: expected 1, .* got 2; use the engine `scatter`"):
        renderer.render_arrays(*picture(20, 30, 4), options=RenderOptions(gamma=2))


def test_progress_is_reported_to_the_end(pair):
    folder, _ = pair
    seen = []
    BokehRenderer("neural", weights=folder).render_arrays(
        *picture(32, 32, 4), lambda done, total: seen.append((done, total))
    )
    assert seen[0][0] == 0
    assert seen[-1][0] == seen[-1][1]


def test_bad_arguments_are_named():
    image, defocus = picture(20, 30, 4)
    with pytest.raises(
        ParameterError, match="engine: expected one of fast, hybrid, neural, rays, scatter, got 'rays2'"
    ):
        BokehRenderer("rays2")
    for gamma in (0.1, 6.0, np.nan):
        with pytest.raises(ParameterError, match=r"^gamma: expected"):
            BokehRenderer("scatter").render_arrays(image, defocus, options=RenderOptions(gamma=gamma))
    with pytest.raises(ShapeError, match="30x20 pixels but defocus is 20x30"):
        BokehRenderer("scatter").render_arrays(image, defocus.T)
    with pytest.raises(ParameterError, match="NaN"):
        BokehRenderer("scatter").render_arrays(image, np.full_like(defocus, np.nan))
