import numpy as np
import pytest
import torch
from numpy.testing import assert_array_equal

from bokehnet.classical import scatter_renderer as numpy_side
from bokehnet.classical.scatter import pyramid_levels
from bokehnet.classical.scatter.disc_scatter import scatter_forward as spread_on_one_level
from bokehnet.classical.torch.autograd import scatter


def random_inputs(height: int, width: int, largest: float) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(height, width, 2, dtype=torch.float64, generator=generator)
    defocus = largest * (2 * torch.rand(height, width, dtype=torch.float64, generator=generator) - 1)
    return image.requires_grad_(), defocus.requires_grad_()


@pytest.mark.parametrize(("height", "width", "largest"), [(5, 6, 2.5), (7, 4, 6.0), (1, 9, 3.0)])
def test_scatter_gradients_match_finite_differences(height, width, largest):
    assert torch.autograd.gradcheck(scatter, random_inputs(height, width, largest))


def test_gradients_through_merged_levels_match_finite_differences():
    """A slope of radii around 30, alike within blocks: two levels; an odd side and a sharp column."""
    generator = torch.Generator().manual_seed(2)
    image = 0.5 + 0.5 * torch.rand(9, 8, 1, dtype=torch.float64, generator=generator)
    slope = torch.linspace(28, 34, 8, dtype=torch.float64).expand(9, 8)
    defocus = slope + 0.3 * torch.rand(9, 8, dtype=torch.float64, generator=generator)
    defocus[:, 5] = 0.2
    values = torch.cat([image, torch.ones_like(image)], -1).detach().numpy()
    merged = pyramid_levels.scatter_forward(values, defocus.numpy())
    assert not np.allclose(merged, spread_on_one_level(values, defocus.numpy()), rtol=1e-6)
    assert torch.autograd.gradcheck(scatter, (image.requires_grad_(), defocus.requires_grad_()))


@pytest.mark.parametrize("size", [17.3, -15.6])
def test_gradient_for_the_size_of_the_blur_is_the_difference_quotient(size):
    """K, focus and aperture size act through the defocus: the slope of a loss along one of them.

    At whole radii the continuation beyond the border grows by a pixel, so the loss has a small jump there.
    """
    generator = torch.Generator().manual_seed(3)
    image = torch.rand(40, 37, 3, dtype=torch.float64, generator=generator)
    target = torch.rand(40, 37, 3, dtype=torch.float64, generator=generator)
    shape = torch.linspace(0.3, 1, 37, dtype=torch.float64).expand(40, 37)

    def loss(blur: torch.Tensor) -> torch.Tensor:
        return (scatter(image, blur * shape) * target).sum()

    blur = torch.tensor(size, dtype=torch.float64, requires_grad=True)
    loss(blur).backward()
    quotient = (loss(blur.detach() + 1e-7) - loss(blur.detach() - 1e-7)) / 2e-7
    assert float(blur.grad) == pytest.approx(float(quotient), rel=1e-4)


def test_radius_beyond_the_largest_has_no_gradient():
    image, _ = random_inputs(4, 4, 0)
    defocus = torch.full((4, 4), 1e6, dtype=torch.float64, requires_grad=True)
    scatter(image, defocus).square().sum().backward()
    assert float(defocus.grad.abs().max()) == 0


def test_gradient_of_a_sharp_picture_by_its_defocus_is_zero():
    image, _ = random_inputs(4, 4, 0)
    defocus = torch.zeros(4, 4, dtype=torch.float64, requires_grad=True)
    scatter(image, defocus).square().sum().backward()
    assert float(defocus.grad.abs().max()) == 0


def test_torch_and_numpy_share_one_kernel():
    image = np.random.default_rng(0).random((9, 11, 3), dtype=np.float32)
    defocus = np.linspace(-24, 24, 99, dtype=np.float32).reshape(9, 11)
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
