"""Discs in ONNX Runtime."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.classical.scatter.disc_scatter import scatter_forward
from bokehnet.classical.scatter.oracle import disc_weights, scatter_reference
from bokehnet.onnx_file.spread import spread_discs
from tests.unit.onnx_file.running import compiled, decibels, picture, steps


@pytest.fixture(scope="module")
def spread():
    """``spread(values (H, W, 4), defocus)`` to sums (H, W, 4)."""
    call = compiled(spread_discs, 3, 2)
    return lambda values, defocus: call(values.transpose(2, 0, 1), defocus).transpose(1, 2, 0)


def weighted(image):
    return np.dstack([image, np.ones(image.shape[:2], np.float32)])


@pytest.mark.parametrize("radius", [0.51, 1.0, 7.3, 31.875, 90.125])
def test_one_point_becomes_a_disc(spread, radius):
    """Authority: the oracle that cuts each pixel into thin lines."""
    reach = int(radius) + 2
    side = 2 * reach + 1
    values, defocus = np.zeros((side, side, 4), np.float32), np.zeros((side, side), np.float32)
    values[reach, reach], defocus[reach, reach] = 1, radius
    spread_values = spread(values, defocus)[..., 0]
    np.testing.assert_allclose(spread_values, disc_weights(radius, reach), rtol=0, atol=2e-3 / radius**2)
    assert spread_values.sum() == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("radius", [31.9, 100.2])
def test_between_the_radii_of_the_table_a_rim_is_hardly_softer(spread, radius):
    """Authority: the oracle; a tenth of a pixel's share is far below what a lens does to a rim."""
    reach = int(radius) + 2
    side = 2 * reach + 1
    values, defocus = np.zeros((side, side, 4), np.float32), np.zeros((side, side), np.float32)
    values[reach, reach], defocus[reach, reach] = 1, radius
    spread_values = spread(values, defocus)[..., 0]
    np.testing.assert_allclose(
        spread_values, disc_weights(radius, reach), rtol=0, atol=0.1 / (np.pi * radius**2)
    )


def test_a_picture_is_spread_as_by_the_double_loop(spread):
    """Authority: :func:`scatter_reference`."""
    image, defocus = picture(23, 31), steps(23, 31, 6)
    sums = spread(weighted(image), defocus)
    assert decibels(sums[..., :3] / sums[..., 3:], scatter_reference(image, defocus)) > 75


@pytest.mark.parametrize(
    ("height", "width", "radius"),
    [(1, 1, 3), (1, 70, 9), (70, 1, 9), (64, 20, 12), (65, 40, 0.3), (200, 90, 63.99)],
)
def test_every_size_gives_what_the_kernels_give(spread, height, width, radius):
    """Authority: the numba kernels, which use the same table; bands of 64 rows, canvases of other heights."""
    values, defocus = weighted(picture(height, width)), steps(height, width, radius)
    np.testing.assert_allclose(spread(values, defocus), scatter_forward(values, defocus), rtol=0, atol=1e-6)


def test_nothing_of_a_light_is_left_next_to_its_disc(spread):
    """Authority: sums in float64, whose rounding is 1e-16 of the light."""
    values, defocus = np.zeros((9, 200, 4), np.float32), np.full((9, 200), 3.0, np.float32)
    values[4, 20] = 1e7
    assert np.abs(spread(values, defocus)[:, 30:]).max() < 1e-7


def test_the_number_of_threads_changes_no_bit():
    """Indices repeat: an operator that adds from several threads at once would fail."""
    values, defocus = weighted(picture(200, 300)), steps(200, 300, 20)
    results = [
        compiled(spread_discs, 3, 2, threads=n)(values.transpose(2, 0, 1), defocus) for n in (1, 2, 2, 2)
    ]
    assert all(np.array_equal(results[0], other) for other in results[1:])
