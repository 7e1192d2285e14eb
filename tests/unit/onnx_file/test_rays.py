"""Rays in one file. Authorities: closed forms, and the rays of the package on even surfaces."""

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.classical.known_layers import Layers  # noqa: E402
from bokehnet.classical.layered.layers import split_layers as numba_layers  # noqa: E402
from bokehnet.classical.rays_renderer import rays  # noqa: E402
from bokehnet.errors import ParameterError  # noqa: E402
from bokehnet.onnx_file import renderer  # noqa: E402
from bokehnet.onnx_file.occlusion.layers import split_layers  # noqa: E402
from tests.unit.onnx_file.running import compiled, decibels, start  # noqa: E402


@pytest.fixture(scope="module")
def render():
    session = start(renderer.build_model(engine="rays"), threads=2)

    def call(image, defocus, gamma=1.0, **background):
        numbers = {"K": 1.0, "focus": 0.0, "gamma": gamma}
        scalars = {name: np.array(value, np.float32) for name, value in numbers.items()}
        return session.run(None, {"image": image, "disparity": defocus, **scalars, **background})[0]

    return call


def disc_before_wall(height=90, width=110, front=9.0, back=-4.0):
    """Return picture and defocus of an even disc, antialiased, before an even wall."""
    y, x = np.mgrid[:height, :width].astype(np.float32)
    distance = np.hypot(y - height / 2, x - width / 2) - 20
    coverage = np.clip(0.5 - distance, 0, 1)[..., None]
    image = coverage * (0.9, 0.2, 0.1) + (1 - coverage) * (0.1, 0.3, 0.8)
    return image.astype(np.float32), np.where(distance < 0, front, back).astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize(("front", "back"), [(9.0, -4.0), (0.0, -8.0), (7.0, 0.0)])
def test_an_even_disc_before_an_even_wall_equals_the_package(render, front, back):
    image, defocus = disc_before_wall(front=front, back=back)
    assert decibels(render(image, defocus), rays(image, defocus)) > 40


@pytest.mark.slow
def test_a_known_background_shows_through_the_rim(render):
    """Authority: the rays with the same layers. Behind the disc is a lamp that no estimate can know."""
    image, defocus = disc_before_wall(front=9.0, back=0.0)
    background = np.broadcast_to(np.float32([0.1, 0.3, 0.8]), image.shape).copy()
    background[42:50, 34:40] = 3.0
    behind = np.zeros_like(defocus)
    colors = np.stack([image, background], 2)
    depths = np.stack([defocus, behind], -1)
    layers = Layers(colors=colors, defocus=depths, coverage=np.ones_like(depths))
    expected = rays(image, defocus, layers=layers)
    estimated = render(image, defocus)
    known = render(image, defocus, background=background, background_disparity=behind)
    assert decibels(known, expected) > decibels(estimated, expected) + 10


@pytest.mark.slow
def test_smooth_pictures_are_scattered(render):
    image = np.random.default_rng(0).random((40, 50, 3), np.float32)
    defocus = np.linspace(-4, 4, 50, dtype=np.float32)[None].repeat(40, 0)
    assert decibels(render(image, defocus), rays(image, defocus)) > 60


@pytest.mark.slow
def test_an_even_picture_stays_even_with_any_gamma(render):
    _, defocus = disc_before_wall()
    image = np.full((*defocus.shape, 3), 0.4, np.float32)
    np.testing.assert_allclose(render(image, defocus, gamma=2.2), image, atol=2e-3)


def test_layers_of_an_even_disc_are_those_of_the_package():
    image, defocus = disc_before_wall()
    build = compiled(lambda g, x, d: _flat(split_layers(g, x.transpose(2, 0, 1), d)), 3, 2)
    first, second, near, behind, coverage = build(image, defocus)
    expected = numba_layers(image, defocus)
    shape = defocus.shape
    np.testing.assert_allclose(near.reshape(shape), expected.defocus[:, :, 0])
    np.testing.assert_allclose(coverage.reshape(shape), expected.coverage[:, :, 0], atol=1e-3)
    is_hidden = expected.defocus[:, :, 1] < expected.defocus[:, :, 0] - 1
    np.testing.assert_allclose(behind.reshape(shape)[is_hidden], expected.defocus[:, :, 1][is_hidden])
    for layer, colors in enumerate((first, second)):
        difference = np.abs(colors.reshape(image.shape) - expected.colors[:, :, layer])
        assert difference[is_hidden].mean() < 0.01


def _flat(layers):
    return [*layers.colors, *layers.defocus, layers.coverage]


def test_weights_are_refused(tmp_path):
    with pytest.raises(ParameterError, match="weights: expected none for engine rays"):
        renderer.build_model(tmp_path, "rays")
