"""BokehMe: one pipeline in NumPy, torch and ONNX; its resize and dilation against their definitions."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra train")
onnx = pytest.importorskip("onnx", reason="needs the extra train")

from bokehnet.baselines.spread import bokehme as module  # noqa: E402
from bokehnet.errors import ParameterError  # noqa: E402
from bokehnet.inference.bokehme import coarse_dilation, highlight_gain, render_bokehme, resize  # noqa: E402
from bokehnet.models.bokehme import BokehMeARNet, BokehMeConfig, BokehMeIUNet  # noqa: E402
from bokehnet.models.onnx_export import export_networks  # noqa: E402
from bokehnet.onnx_file.bokehme import build_bokehme  # noqa: E402
from bokehnet.onnx_session import OnnxSession  # noqa: E402

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def networks(tmp_path_factory):
    """Small random networks, and the folder of their export."""
    torch.manual_seed(0)
    config = BokehMeConfig(width=8, num_blocks=1)
    pair = {"bokehme_arnet": BokehMeARNet(config), "bokehme_iunet": BokehMeIUNet(config)}
    for network in pair.values():
        torch.nn.init.normal_(network.backbone.head.weight, std=0.1)
    folder = tmp_path_factory.mktemp("weights")
    export_networks(pair, folder / "bokehme", {})
    return folder, *(network.eval() for network in pair.values())


@pytest.mark.parametrize("blur", [4.0, 15.0])
def test_numpy_torch_and_onnx_agree(networks, blur, monkeypatch):
    """Without and with steps of IUNet; odd sides."""
    folder, arnet, iunet = networks
    monkeypatch.setattr(module, "WEIGHTS", folder)
    module._networks.cache_clear()
    rng = np.random.default_rng(0)
    image = rng.random((61, 83, 3), np.float32)
    disparity = np.full(image.shape[:2], 0.2, np.float32)
    disparity[20:40, 30:50] = 1
    defocus = np.float32(blur) * disparity
    bokeh = module.bokehme(image, defocus)
    module._networks.cache_clear()

    pictures = image, module.bokehme_scatter(image, defocus)
    encoded = [x.transpose(2, 0, 1)[None] ** (1 / 2.2) for x in pictures]
    tensors = [torch.from_numpy(x.astype(np.float32)) for x in (encoded[0], defocus[None, None], encoded[1])]
    with torch.no_grad():
        result = render_bokehme(
            *tensors,
            torch.full((1, 1, 1, 1), 2.2),
            arnet=arnet,
            iunet=iunet,
            dilate=lambda x: torch.from_numpy(coarse_dilation(x.numpy())),
        )
    assert len(result.steps) == (1 if blur < 10 else 2)
    expected = result.bokeh[0].permute(1, 2, 0).clamp(min=0).numpy() ** 2.2
    np.testing.assert_allclose(bokeh, expected, atol=1e-5)

    pair = (onnx.load(folder / f"bokehme/bokehme_{name}.onnx") for name in ("arnet", "iunet"))
    session = OnnxSession(build_bokehme(*pair).SerializeToString())
    numbers = {name: np.array(x, np.float32) for name, x in {"K": blur, "focus": 0, "gamma": 1}.items()}
    np.testing.assert_allclose(
        bokeh, session.run({"image": image, "disparity": disparity, **numbers})[0], atol=2e-4
    )


@pytest.mark.parametrize("size", [(11, 30), (24, 17)])
def test_resize_is_the_triangle_filter_of_torch(size):
    x = torch.rand(1, 3, 20, 24, generator=torch.Generator().manual_seed(1))
    expected = torch.nn.functional.interpolate(x, size=size, mode="bilinear", antialias=True)
    torch.testing.assert_close(resize(x, *size), expected, atol=1e-5, rtol=0)
    np.testing.assert_allclose(resize(x.numpy(), *size), expected.numpy(), atol=1e-5)


def test_dilation_is_the_largest_disc_over_each_pixel():
    defocus = np.zeros((25, 27), np.float32)
    defocus[10, 12], defocus[4, 20] = -6.0, 9.5
    y, x = np.mgrid[:25, :27]
    expected = np.zeros_like(defocus)
    for row, column in ((10, 12), (4, 20)):
        radius = abs(defocus[row, column])
        expected = np.maximum(expected, np.where(np.hypot(y - row, x - column) <= radius, radius, 0))
    np.testing.assert_array_equal(coarse_dilation(defocus), expected)


def test_highlights_are_raised_only_where_they_are_blurred():
    encoded, defocus = np.array([0.2, 0.95, 0.95], np.float32), np.array([5, 0, 5], np.float32)
    gain = highlight_gain(encoded, defocus)
    assert gain[0] == gain[1] == 1
    assert 1.2 < gain[2] < 1.4


def test_a_gamma_out_of_range_is_refused():
    with pytest.raises(ParameterError, match=r"^gamma: expected "):
        module.bokehme(np.ones((8, 8, 3), np.float32), np.zeros((8, 8), np.float32), gamma=0.5)
