"""The scatter in ONNX Runtime. Authority: the scatter of the package."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.classical.scatter_renderer import render_scatter
from bokehnet.classical.scatter_renderer import scatter_inside as package_scatter
from bokehnet.onnx_file.scatter import scatter, scatter_beyond
from tests.unit.onnx_file.running import compiled, decibels, picture, steps


@pytest.fixture(scope="module")
def call():
    """``call(image (H, W, 3), defocus)`` to bokeh (H, W, 3)."""
    run = compiled(scatter, 3, 2)
    return lambda image, defocus: run(image.transpose(2, 0, 1), defocus).transpose(1, 2, 0)


@pytest.mark.parametrize(
    ("height", "width", "radius"),
    [(1, 1, 5), (1, 50, 30), (50, 70, 9), (77, 131, 30), (75, 90, 62), (64, 64, 0)],
)
def test_levels_are_those_of_the_package(call, height, width, radius):
    image, defocus = picture(height, width), steps(height, width, 1) * np.float32(radius)
    np.testing.assert_allclose(call(image, defocus), package_scatter(image, defocus), rtol=0, atol=2e-6)


def test_lights_and_shadows_stay_on_their_level(call):
    """A pixel that outshines its tile keeps the rim of its disc; a tile at the border is a part of one."""
    image, defocus = 0.1 * picture(70, 93), np.full((70, 93), 25.0, np.float32)
    image[35, 40], image[69, 92] = 300, 80
    expected = package_scatter(image, defocus)
    np.testing.assert_allclose(call(image, defocus), expected, rtol=1e-5)


@pytest.mark.parametrize(("radius", "least"), [(90, 80), (400, 70), (1e6, 50)])
def test_discs_beyond_the_packages_table_are_spread_too(call, radius, least):
    """Up to 128 pixels from a table of their own, above on smaller pictures; a million is one grey."""
    image, defocus = picture(150, 203), steps(150, 203, radius)
    assert decibels(call(image, defocus), package_scatter(image, defocus)) > least


@pytest.mark.parametrize(("radius", "within"), [(100, 0.05), (140, 0.45)])
def test_a_lamp_with_a_disc_beyond_the_table_only_loses_the_sharpness_of_its_rim(call, radius, within):
    """Its light stays; the rim is off by a part of the disc's brightness in the mean."""
    side = 2 * radius + 40
    image, defocus = np.full((side, side, 3), 0.1, np.float32), np.full((side, side), radius, np.float32)
    image[side // 2, side // 2] = 4 * radius**2
    result, expected = call(image, defocus), package_scatter(image, defocus)
    brightness = expected[side // 2, side // 2, 0]
    assert brightness > 1
    y, x = np.mgrid[:side, :side] - side // 2
    distance = np.abs(np.hypot(y, x) - radius)
    error = np.abs(result - expected) / brightness
    assert error[distance > 4].max() < 0.01
    assert error[distance < 1].mean() < within
    assert result.sum() == pytest.approx(expected.sum(), rel=0.005)


@pytest.fixture(scope="module")
def call_beyond():
    """``call(image (H, W, 3), defocus)`` to bokeh (H, W, 3) of the engine."""
    run = compiled(scatter_beyond, 3, 2)
    return lambda image, defocus: run(image.transpose(2, 0, 1), defocus).transpose(1, 2, 0)


@pytest.mark.parametrize(
    ("height", "width", "radius"), [(1, 1, 5), (3, 50, 30), (50, 70, 9), (61, 40, 0), (64, 90, 1e30)]
)
def test_pictures_with_lines_and_lamps_continue_as_in_the_package(call_beyond, height, width, radius):
    """Authority: the engine of the package."""
    image, defocus = 0.2 * picture(height, width), np.full((height, width), radius, np.float32)
    image[0], image[-1, -1], image[height // 2, 0] = 1, 40, 30
    expected = render_scatter(image, np.clip(defocus, None, 4.0 * max(height, width))).bokeh
    np.testing.assert_allclose(call_beyond(image, defocus), expected, rtol=1e-3, atol=1e-4)
