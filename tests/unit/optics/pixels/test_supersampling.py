"""Authority: sums written out, and SciPy's window."""

import numpy as np
import pytest
from scipy.signal.windows import blackmanharris

from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter
from bokehnet.optics.pixels.supersampling import downsample

FILTERS = [
    DEFAULT_FILTER,
    PixelFilter("box", 1),
    PixelFilter("box", 1.5),
    PixelFilter("gaussian", 2.4),
    PixelFilter("mitchell", 4),
]


@pytest.mark.parametrize("pixel_filter", FILTERS, ids=str)
@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_reduction_is_a_weighted_mean(factor, pixel_filter):
    """Oracle: one pixel after the other, samples beyond the border left out."""
    rng = np.random.default_rng(1)
    fine = rng.random((5 * factor, 4 * factor, 2), dtype=np.float32)
    weights = pixel_filter.fine_weights(factor)
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(weights, weights[::-1], atol=1e-12)
    beyond = (len(weights) - factor) // 2
    result = downsample(fine, factor, pixel_filter)
    for y in range(5):
        for x in range(4):
            total, light = 0.0, np.zeros(2)
            for i, v in enumerate(range(y * factor - beyond, (y + 1) * factor + beyond)):
                for j, u in enumerate(range(x * factor - beyond, (x + 1) * factor + beyond)):
                    if 0 <= v < 5 * factor and 0 <= u < 4 * factor:
                        total += weights[i] * weights[j]
                        light += weights[i] * weights[j] * fine[v, u]
            np.testing.assert_allclose(result[y, x], light / total, atol=1e-6)


def test_the_filter_is_that_of_blender():
    """Authority: SciPy's window over three pixels, at the middles of the samples."""
    window = blackmanharris(2 * 3 * 4 + 1)[1::2]
    np.testing.assert_allclose(DEFAULT_FILTER.fine_weights(4), window / window.sum(), atol=1e-12)


def test_plain_means_take_the_pixel_alone():
    fine = np.random.default_rng(0).random((6, 8), dtype=np.float32)
    expected = fine.reshape(3, 2, 4, 2).mean((1, 3))
    np.testing.assert_allclose(downsample(fine, 2, PixelFilter("box", 1)), expected, atol=1e-7)
