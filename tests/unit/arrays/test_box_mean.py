"""Means over square windows equal the means of the values that a slow loop reads."""

import numpy as np

from bokehnet.arrays.box_mean import box_mean


def test_box_means_are_those_of_a_loop_with_the_border_repeated() -> None:
    values = np.random.default_rng(3).random((7, 11), np.float32)
    for radius in (1, 3, 9):
        around = np.pad(values, radius, "edge").astype(np.float64)
        size = 2 * radius + 1
        expected = [[around[y : y + size, x : x + size].mean() for x in range(11)] for y in range(7)]
        np.testing.assert_allclose(box_mean(values, radius), expected, atol=1e-6)
