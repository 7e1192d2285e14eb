"""One level of the scatter: discs of any radius on one grid, and what must hold of any spread."""

import math

import numba
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.scatter.disc_scatter import BLOCK_ROWS, scatter_backward, scatter_forward
from bokehnet.classical.scatter.disc_table import TABLE_RADIUS
from bokehnet.classical.scatter.oracle import disc_weights


def point(height: int, width: int, value: float = 1.0, channels: int = 4) -> np.ndarray:
    values = np.zeros((height, width, channels))
    values[height // 2, width // 2] = value
    return values


def random_inputs(
    height: int, width: int, largest: float, channels: int = 4
) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(height * width)
    return rng.random((height, width, channels)), rng.uniform(-largest, largest, (height, width))


def written_out(values: np.ndarray, defocus: np.ndarray) -> np.ndarray:
    """Every source adds its whole window of exact weights."""
    height, width = defocus.shape
    reach = math.ceil(np.abs(defocus).max()) + 2
    out = np.zeros((height + 2 * reach, width + 2 * reach, values.shape[2]))
    for y in range(height):
        for x in range(width):
            weights = disc_weights(abs(defocus[y, x]), reach)
            out[y : y + 2 * reach + 1, x : x + 2 * reach + 1] += weights[..., None] * values[y, x]
    return out[reach : reach + height, reach : reach + width]


@pytest.mark.parametrize("shape", [(17, 23), (40, 9), (1, 12), (12, 1), (1, 1), (BLOCK_ROWS + 6, 12)])
def test_spread_equals_the_sum_of_all_windows(shape):
    values, defocus = random_inputs(*shape, 7)
    assert_allclose(scatter_forward(values, defocus), written_out(values, defocus), rtol=1e-3, atol=2e-4)


@pytest.mark.parametrize("channels", [1, 3, 4, 5, 9])
def test_any_number_of_channels_is_spread_equally(channels):
    values, defocus = random_inputs(30, 20, 6, channels)
    together = scatter_forward(values, defocus)
    for c in range(channels):
        assert_array_equal(together[..., c], scatter_forward(values[..., c : c + 1], defocus)[..., 0])


@pytest.mark.parametrize("radius", [0.0, 0.3, 0.5, 0.501, 0.7, 1.0, 2.5, 8.3, 40.0, 63.9, 64.0, 90.4, 300.0])
def test_weights_of_one_point_sum_to_one(radius):
    size = 2 * math.ceil(radius) + 5
    sums = scatter_forward(point(size, size), np.full((size, size), radius))
    assert_allclose(sums.sum(axis=(0, 1)), 1, atol=1e-9)


def test_disc_hardly_changes_where_the_table_ends():
    """Authority: the formula behind the table, which serves beyond it."""
    inside, outside = (
        scatter_forward(point(140, 140), np.full((140, 140), radius))[..., 0]
        for radius in (TABLE_RADIUS - 1e-9, TABLE_RADIUS)
    )
    assert np.abs(inside - outside).sum() / 2 < 1e-3


def test_no_light_is_left_behind_a_bright_disc():
    """Differences cancel to the rounding of float64, and what is left never goes below nothing."""
    values = point(201, 201, 1e6)
    values[100, 60] = 1e6
    sums = scatter_forward(values.astype(np.float32), np.full((201, 201), 20.3, np.float32))
    y, x = np.mgrid[:201, :201] - 100
    behind = (np.hypot(x, y) > 22) & (np.hypot(x + 40, y) > 22)
    own = 1e6 / (math.pi * 20.3**2)
    assert sums[behind].max() <= 1e-12 * own
    assert sums.min() == 0


def test_any_number_of_threads_gives_the_same_bits():
    values, defocus = random_inputs(3 * BLOCK_ROWS + 5, 70, 80)
    gradient = np.random.default_rng(1).random(values.shape)
    before, results = numba.get_num_threads(), []
    for threads in sorted({1, before}):
        numba.set_num_threads(threads)
        results.append((scatter_forward(values, defocus), *scatter_backward(values, defocus, gradient)))
    numba.set_num_threads(before)
    for result in results:
        for array, first in zip(result, results[0], strict=True):
            assert_array_equal(array, first)


@pytest.mark.parametrize(
    ("shape", "largest"), [((9, 14), 5.0), ((70, 33), 40.0), ((20, 90), 150.0), ((1, 1), 3.0)]
)
def test_backward_is_the_adjoint_of_the_forward(shape, largest):
    """Authority: <spread(v), g> = <v, spread^T(g)> for any v and g."""
    values, defocus = random_inputs(*shape, largest)
    gradient = np.random.default_rng(1).standard_normal(values.shape)
    there = (scatter_forward(values, defocus) * gradient).sum()
    back = (values * scatter_backward(values, defocus, gradient)[0]).sum()
    assert back == pytest.approx(there, rel=1e-12)


@pytest.mark.parametrize(("shape", "largest"), [((12, 15), 6.0), ((20, 90), 150.0)])
def test_gradient_for_the_defocus_is_the_difference_quotient(shape, largest):
    values, defocus = random_inputs(*shape, largest)
    rng = np.random.default_rng(2)
    gradient, direction = rng.standard_normal(values.shape), rng.standard_normal(shape)
    ahead, behind = (scatter_forward(values, defocus + step * direction) for step in (1e-7, -1e-7))
    quotient = ((ahead - behind) * gradient).sum() / 2e-7
    slope = (scatter_backward(values, defocus, gradient)[1] * direction).sum()
    assert slope == pytest.approx(quotient, rel=1e-5)
