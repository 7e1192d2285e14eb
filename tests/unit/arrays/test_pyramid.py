import numpy as np
import pytest
import torch
import torch.nn.functional as F
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.arrays.pyramid import count_halvings, crop_to, downsample2, pad_to_multiple, upsample2


@pytest.mark.parametrize("shape", [(1, 3, 8, 6), (2, 1, 2, 10), (1, 1, 1, 1)])
def test_upsampling_equals_torch_interpolate(shape):
    x = torch.rand(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    expected = F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
    assert_allclose(upsample2(x).numpy(), expected.numpy(), atol=1e-12)
    assert_allclose(upsample2(x.numpy()), expected.numpy(), atol=1e-12)


def test_downsampling_equals_torch_average_pooling():
    x = torch.rand(2, 3, 8, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    assert_allclose(downsample2(x.numpy()), F.avg_pool2d(x, 2).numpy(), atol=1e-12)


@pytest.mark.parametrize(("radius", "halvings"), [(0, 0), (10, 0), (10.01, 1), (20, 1), (21, 2), (80, 3)])
def test_halvings_bring_the_radius_below_the_unit(radius, halvings):
    assert count_halvings(radius, 10) == halvings


def test_padding_repeats_the_border_and_cropping_undoes_it():
    x = np.arange(15.0).reshape(1, 1, 3, 5)
    padded = pad_to_multiple(x, 4)
    assert padded.shape == (1, 1, 4, 8)
    assert_array_equal(padded[0, 0, 3, 4:], 14)
    assert_array_equal(crop_to(padded, 3, 5), x)
    assert pad_to_multiple(x, 1) is x
