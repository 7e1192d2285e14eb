import math

import numba
import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.optics.coc import coc_radius, defocus_from_disparity, disparity_from_depth


def test_infinite_depth_is_disparity_zero():
    depth = np.array([500.0, math.inf])
    assert_allclose(disparity_from_depth(depth), [1 / 500, 0])
    assert_allclose(disparity_from_depth(torch.from_numpy(depth)).numpy(), [1 / 500, 0])


def test_defocus_is_positive_in_front_of_focus_and_zero_in_it():
    assert defocus_from_disparity(0.9, 60.0, 0.4) == pytest.approx(30)
    assert defocus_from_disparity(0.1, 60.0, 0.4) == pytest.approx(-18)
    assert defocus_from_disparity(0.4, 60.0, 0.4) == 0


def test_one_formula_serves_floats_arrays_tensors_and_kernels():
    @numba.njit
    def inside(x):
        return coc_radius(x, 0.001, 12.5, 52.0)

    disparity = np.linspace(0, 0.01, 7)
    expected = [coc_radius(float(x), 0.001, 12.5, 52.0) for x in disparity]
    assert_allclose(coc_radius(disparity, 0.001, 12.5, 52.0), expected)
    assert_allclose(coc_radius(torch.from_numpy(disparity), 0.001, 12.5, 52.0).numpy(), expected)
    assert_allclose([inside(x) for x in disparity], expected)


def test_coc_is_differentiable_in_torch():
    disparity = torch.rand(5, dtype=torch.float64, requires_grad=True)
    pupil = torch.tensor(12.5, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda d, p: coc_radius(d, 0.3, p, 52.0), (disparity, pupil))
