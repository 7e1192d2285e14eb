"""Filters over square windows. Authority: the same filters of SciPy."""

import numpy as np
import pytest
from scipy import ndimage

from bokehnet.arrays.square_windows import dilated, eroded, reduce_windows


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (40, 31)])
@pytest.mark.parametrize("radius", [0, 1, 2, 7, 40])
def test_windows_give_the_extremes_of_the_oracle(shape, radius):
    values = np.random.default_rng(0).random(shape, dtype=np.float32)
    mask, size = values > 0.9, 2 * radius + 1
    for reduce, oracle in ((np.minimum, ndimage.minimum_filter), (np.maximum, ndimage.maximum_filter)):
        result = reduce_windows(values, radius, reduce)
        assert result.dtype == np.float32
        np.testing.assert_array_equal(result, oracle(values, size, mode="nearest"))
    np.testing.assert_array_equal(dilated(mask, radius), ndimage.maximum_filter(mask, size))
    np.testing.assert_array_equal(eroded(~mask, radius), ~dilated(mask, radius))


def test_the_input_does_not_change():
    mask = np.zeros((5, 5), np.bool_)
    mask[2, 2] = True
    dilated(mask, 0)[0, 0] = True
    assert mask.sum() == 1
