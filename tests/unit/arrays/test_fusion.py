import numpy as np
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.arrays.fusion import fuse


def test_the_ends_of_the_error_map_choose_one_side():
    classical, neural = np.full((2, 2, 3), 1000.0), np.full((2, 2, 3), 0.25)
    assert_array_equal(fuse(classical, neural, np.zeros((2, 2, 1))), classical)
    assert_array_equal(fuse(classical, neural, np.ones((2, 2, 1))), neural)


def test_between_the_ends_the_map_is_the_weight_of_the_network():
    """Peng et al., "BokehMe", CVPR 2022: (1 - E) times the classical picture plus E times the neural one."""
    assert_allclose(fuse(np.full((1, 1, 3), 8.0), np.full((1, 1, 3), 4.0), np.full((1, 1, 1), 0.25)), 7.0)


def test_arrays_and_tensors_give_the_same():
    rng = np.random.default_rng(0)
    a, b, e = rng.random((4, 5, 3)), rng.random((4, 5, 3)), rng.random((4, 5, 1))
    assert_allclose(fuse(*map(torch.from_numpy, (a, b, e))).numpy(), fuse(a, b, e), rtol=1e-15)
