"""One correction by networks, written four times: for torch, whole, in strips, as one file. All must agree.

Authority: ``bokehnet.inference.coarse_to_fine.render_neural`` on the torch modules, which is what training
validates.
"""

import numpy as np
import pytest
import torch

from bokehnet.classical.error_map import geometric_error_map
from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.engines.options import RenderOptions
from bokehnet.engines.strips import strip_bytes
from bokehnet.errors import ParameterError
from bokehnet.inference.coarse_to_fine import render_neural
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.models.onnx_export import export_networks
from bokehnet.onnx_file.renderer import build_model
from bokehnet.render.renderer import BokehRenderer
from tests.unit.onnx_file.running import picture, start, steps

# Of scene-linear light, white is 1, and of error maps. Measured: 8e-7, a few roundings of float32.
TOLERANCE = 4e-6

# Pixels. Of the largest blurs below one is trusted, one in part, one not at all.
TRUSTED = 24.0


def scatter_of(image, defocus, aperture=None):
    """Return the picture of the classical renderer."""
    return render_scatter(image, defocus, aperture).bokeh


def random_networks() -> tuple[ARNet, IUNet]:
    """Untrained, but with a say: a fresh network's last convolution is zero."""
    torch.manual_seed(0)
    networks = ARNet(ARNetConfig(width=8)), IUNet(IUNetConfig(width=8))
    for network in networks:
        torch.nn.init.normal_(network.backbone.head.weight, std=0.02)
        network.eval()
    return networks


@pytest.fixture(scope="module")
def arnet():
    return random_networks()[0]


@pytest.fixture(scope="module")
def weights(arnet, tmp_path_factory):
    folder = tmp_path_factory.mktemp("arnet")
    export_networks({"arnet": arnet}, folder, {"classical": "scatter", "max_valid_radius": TRUSTED})
    return folder


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pair")
    arnet, iunet = random_networks()
    export_networks(
        {"arnet": arnet, "iunet": iunet}, folder, {"classical": "scatter", "max_valid_radius": TRUSTED}
    )
    return folder


@pytest.fixture(scope="module")
def one_file(weights):
    return start(build_model(weights))


def in_torch(image, defocus, arnet, iunet=None):
    """Blend, error map and classical render, (H, W, C), of the way that training takes."""
    classical, classical_error_map = scatter_of(image, defocus), geometric_error_map(defocus)
    batch = [
        torch.from_numpy(np.atleast_3d(x)).permute(2, 0, 1)[None]
        for x in (image, defocus, classical, classical_error_map)
    ]
    with torch.no_grad():
        picture = render_neural(
            *batch,
            arnet=arnet,
            iunet=iunet,
            network_max_radius=10.0,
            max_valid_radius=TRUSTED,
            leaves_outlines=True,
        )
    bokeh, error_map = (x[0].permute(1, 2, 0).numpy() for x in (picture.bokeh, picture.error_map))
    return bokeh, error_map[..., 0], classical


def in_one_file(session, image, defocus):
    numbers = {"K": 1.0, "focus": 0.0, "gamma": 1.0}
    scalars = {name: np.array(x, np.float32) for name, x in numbers.items()}
    return session.run(None, {"image": image, "disparity": defocus, **scalars})[0]


@pytest.mark.parametrize("radius", [8.0, 17.0, 40.0])
def test_all_ways_without_an_iunet_agree(arnet, weights, one_file, radius):
    """No, one and two halvings; sides that no block divides; enough rows for several strips."""
    image, defocus = 2 * picture(701, 67), steps(701, 67, radius, seed=4)
    expected, error_map, classical = in_torch(image, defocus, arnet)
    assert np.abs(expected - classical)[error_map > 0].mean() > 0.01
    renderer = BokehRenderer("fast", weights=weights)
    calls: list[tuple[int, int]] = []
    memory = strip_bytes((701, 67), (256, 67), int(radius), "scatter")
    whole = renderer.render_arrays(image, defocus)
    strips = renderer.render_arrays(
        image, defocus, lambda *call: calls.append(call), options=RenderOptions(max_memory=memory)
    )
    assert calls[-1][1] > 2
    file = in_one_file(one_file, image, defocus)
    for result in (whole.bokeh, strips.bokeh, file):
        np.testing.assert_allclose(result, expected, rtol=0, atol=TOLERANCE)
    for result in (whole.error_map, strips.error_map):
        np.testing.assert_allclose(result, error_map, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("radius", [8.0, 17.0, 40.0])
def test_all_ways_with_an_iunet_agree(pair, radius):
    """The renderer runs it in tiles, the one file over the whole picture. Strips refuse it."""
    image, defocus = picture(97, 131), steps(97, 131, radius, seed=4)
    expected, error_map, _ = in_torch(image, defocus, *random_networks())
    renderer = BokehRenderer("neural", weights=pair)
    result = renderer.render_arrays(image, defocus)
    file = in_one_file(start(build_model(pair, "neural")), image, defocus)
    np.testing.assert_allclose(result.bokeh, expected, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(file, expected, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(result.error_map, error_map, rtol=0, atol=TOLERANCE)
    with pytest.raises(ParameterError, match="these networks need the whole picture"):
        renderer.render_arrays(
            *(np.tile(x, (9, 1, 1)[: x.ndim]) for x in (image, defocus)),
            options=RenderOptions(max_memory=5_000_000),
        )


def test_fast_is_neural_without_its_iunet(arnet, pair):
    image, defocus = picture(97, 131), steps(97, 131, 17.0, seed=4)
    refined, _, _ = in_torch(image, defocus, *random_networks())
    expected, _, _ = in_torch(image, defocus, arnet)
    assert np.abs(refined - expected).max() > 0.01
    renderer, session = BokehRenderer("fast", weights=pair), start(build_model(pair, "fast"))
    for result in (renderer.render_arrays(image, defocus).bokeh, in_one_file(session, image, defocus)):
        np.testing.assert_allclose(result, expected, rtol=0, atol=TOLERANCE)
