import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.optics.coc import defocus_from_disparity, defocus_outside_range

BLUR = 60.0
UNIT = st.floats(0, 1)


@given(UNIT, UNIT, UNIT)
def test_all_between_is_sharp_and_the_rest_blurs_as_from_the_nearer_end(disparity, one, other):
    """Authority: distance of the disparity to the interval, with its sign, times the blur."""
    far, near = sorted((one, other))
    ends = (defocus_from_disparity(disparity, BLUR, end) for end in (near, far))
    result = defocus_outside_range(*ends)
    assert_allclose(result, BLUR * (disparity - np.clip(disparity, far, near)), atol=1e-12)
    if far <= disparity <= near:
        assert result == 0


def test_a_range_without_width_is_the_focus():
    defocus = defocus_from_disparity(np.linspace(0, 1, 9), BLUR, 0.25)
    assert_array_equal(defocus_outside_range(defocus, defocus), defocus)


def test_behind_a_lens_blur_is_continuous_and_rises_towards_the_camera():
    """Two lenses of different sensor distance meet at 0: no jump, no step back, over finely spaced depths."""
    disparity = np.linspace(0, 1 / 400, 20001)[None]
    near, far = (
        defocus_map(disparity, ThinLens(focal_length=50, f_number=2, focus_distance=z), 0.01)
        for z in (800, 3000)
    )
    result = defocus_outside_range(near, far)[0]
    steps = np.diff(result)
    assert steps.min() >= 0
    assert steps.max() < 1.001 * np.diff(near[0]).max()
    inside = (disparity[0] > 1 / 3000 + 1e-9) & (disparity[0] < 1 / 800 - 1e-9)
    assert_array_equal(result[inside], 0)
    assert (result[~inside] != 0).mean() > 0.999


def test_tensors_give_the_same_with_gradients():
    near = torch.linspace(-2, 1, 7, dtype=torch.float64, requires_grad=True)
    far = (near.detach() + 1.5).requires_grad_()
    result = defocus_outside_range(near, far)
    assert_allclose(
        result.detach().numpy(), defocus_outside_range(near.detach().numpy(), far.detach().numpy())
    )
    result.sum().backward()
    assert_array_equal(near.grad.numpy(), (near.detach() >= 0).double().numpy())
