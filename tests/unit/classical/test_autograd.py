import numpy as np
import pytest
import torch
from numpy.testing import assert_array_equal

from bokehnet.classical import scatter as numpy_side
from bokehnet.classical.autograd import scatter


def random_inputs(height: int, width: int, largest: float) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(height, width, 2, dtype=torch.float64, generator=generator)
    defocus = largest * (2 * torch.rand(height, width, dtype=torch.float64, generator=generator) - 1)
    return image.requires_grad_(), defocus.requires_grad_()


@pytest.mark.parametrize(("height", "width", "largest"), [(5, 6, 2.5), (7, 4, 6.0), (1, 9, 3.0)])
def test_scatter_gradients_match_finite_differences(height, width, largest):
    assert torch.autograd.gradcheck(scatter, random_inputs(height, width, largest))


def test_gradient_of_a_sharp_picture_by_its_defocus_is_zero():
    image, _ = random_inputs(4, 4, 0)
    defocus = torch.zeros(4, 4, dtype=torch.float64, requires_grad=True)
    scatter(image, defocus).square().sum().backward()
    assert float(defocus.grad.abs().max()) == 0


def test_torch_and_numpy_share_one_kernel():
    image = np.random.default_rng(0).random((9, 11, 3), dtype=np.float32)
    defocus = np.linspace(-4, 4, 99, dtype=np.float32).reshape(9, 11)
    result = scatter(torch.from_numpy(image), torch.from_numpy(defocus)).numpy()
    assert_array_equal(result, numpy_side.scatter(image, defocus))


def test_gradient_descent_on_the_blur_finds_the_blur_that_made_a_picture():
    """The derivative by the defocus is useful, not only right: recover K of a known render."""
    generator = torch.Generator().manual_seed(1)
    image = torch.rand(24, 24, 3, dtype=torch.float64, generator=generator)
    disparity = torch.linspace(0, 1, 24, dtype=torch.float64).expand(24, 24)
    target = scatter(image, 6.0 * (disparity - 0.3))
    blur = torch.tensor(4.0, dtype=torch.float64, requires_grad=True)
    optimizer = torch.optim.Adam([blur], lr=0.1)
    for _ in range(120):
        optimizer.zero_grad()
        (scatter(image, blur * (disparity - 0.3)) - target).square().mean().backward()
        optimizer.step()
    assert blur.item() == pytest.approx(6.0, abs=0.05)
