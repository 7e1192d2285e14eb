"""Authorities: difference quotients for gradients, the numba kernels for values."""

import numpy as np
import pytest
import torch

from bokehnet.classical.layered.boundaries import unmixing as numba_side
from bokehnet.classical.layered.depth_discontinuities import discontinuity_sides
from bokehnet.classical.torch.unmixing import Unmixed, unmix
from bokehnet.errors import ShapeError
from bokehnet.optics.pixels.pixel_filter import parse_pixel_filter


def scene(height: int, width: int, seed: int, least: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Two pictures of three textured surfaces each, with edges of any form; float32 numbers as float64."""
    rng = np.random.default_rng(seed)
    labels = rng.integers(0, 3, (2, -(-height // 4), -(-width // 4))).repeat(4, 1).repeat(4, 2)
    labels = labels[:, :height, :width]
    colors = least + np.array([[0.7, 0.2, 0.1], [0.1, 0.3, 0.9], [0.4, 0.6, 0.2]])
    image = colors[labels] + 0.15 * rng.random((2, height, width, 3))
    defocus = np.array([8.0, -3.0, -11.0])[labels] + 0.2 * rng.random((2, height, width))
    image, defocus = image.astype(np.float32), defocus.astype(np.float32)
    return torch.from_numpy(image).double().movedim(-1, 1), torch.from_numpy(defocus).double()[:, None]


def surfaces(found: Unmixed) -> tuple[torch.Tensor, ...]:
    return found.front, found.back, found.coverage


@pytest.mark.parametrize("name", ["blackman-harris", "box", "gaussian:3.4"])
@pytest.mark.parametrize("least", [0.0, -0.3])
def test_values_are_those_of_the_kernels(name, least):
    pixel_filter = parse_pixel_filter(name)
    images, defocus = scene(21, 26, 0, least)
    spared = np.random.default_rng(1).random((2, 1, 21, 26)) < 0.04
    found = unmix(images, defocus, spared=torch.from_numpy(spared), pixel_filter=pixel_filter)
    for number in range(2):
        image = images[number].movedim(0, -1).numpy().astype(np.float32)
        depth = np.ascontiguousarray(defocus[number, 0].numpy().astype(np.float32))
        sides = discontinuity_sides(depth, len(pixel_filter.weights()) // 2)
        wanted = numba_side.unmix(image, depth, sides, spared[number, 0], pixel_filter)
        places = wanted.rows, wanted.columns
        assert len(wanted.rows) == int(found.mixed[number].sum()) > 100
        for name_of in ("front", "back"):
            got = getattr(found, name_of)[number].movedim(0, -1).numpy()[places]
            np.testing.assert_allclose(got, getattr(wanted, name_of), atol=1e-5)
        for name_of in ("coverage", "near", "far", "is_front"):
            got = getattr(found, name_of)[number, 0].numpy()[places]
            np.testing.assert_allclose(got, getattr(wanted, name_of), atol=1e-5)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_gradients_are_difference_quotients(seed):
    image, defocus = scene(6, 7, seed)
    share = 0.2 + 0.6 * torch.rand(
        2, 1, 6, 7, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)
    )

    def colors(image, share):
        return surfaces(unmix(image, defocus, share))

    assert torch.autograd.gradcheck(colors, (image.requires_grad_(), share.requires_grad_()), atol=1e-6)


def test_gradients_without_a_share_are_difference_quotients():
    image, defocus = scene(6, 7, 3)
    assert torch.autograd.gradcheck(lambda image: surfaces(unmix(image, defocus)), (image.requires_grad_(),))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_both_surfaces_add_up_to_the_picture(dtype):
    image, defocus = (tensor.to(dtype) for tensor in scene(20, 24, 4))
    share = torch.rand(2, 1, 20, 24, dtype=dtype, generator=torch.Generator().manual_seed(0))
    found = unmix(image, defocus, share)
    added = found.coverage * found.front + (1 - found.coverage) * found.back
    torch.testing.assert_close(added, image, atol=2e-6, rtol=0)
    assert found.front.dtype == dtype
    assert (found.near >= found.far).all()


def test_a_better_share_is_found_by_its_gradient():
    """Truth: the share of which the picture was mixed. Steps down the gradient of the colours find it."""
    front, back = torch.tensor([0.8, 0.3, 0.1]), torch.tensor([0.1, 0.4, 0.7])
    columns = torch.arange(12)
    truth = torch.where(columns < 6, 1.0, 0.0)
    truth[5] = 0.6
    image = (truth[:, None] * front + (1 - truth[:, None]) * back).T[None, :, None].expand(1, 3, 9, 12)
    defocus = torch.where(columns < 6, 7.0, -7.0).expand(1, 1, 9, 12)
    share = torch.full((1, 1, 9, 12), 0.9, requires_grad=True)
    losses = []
    for _ in range(80):
        found = unmix(image, defocus, share)
        loss = ((found.front[..., 5] - front[:, None]) ** 2).sum() + (
            (found.back[..., 5] - back[:, None]) ** 2
        ).sum()
        (slope,) = torch.autograd.grad(loss, share)
        share = (share - 0.1 * slope).clamp(0, 1).detach().requires_grad_()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.2 * losses[0]
    assert (found.coverage[..., 5] - 0.6).abs().max() < 0.04


def test_one_pixel_and_no_edge_are_the_picture():
    for height, width in ((1, 1), (1, 5), (4, 4)):
        image = torch.rand(1, 3, height, width, generator=torch.Generator().manual_seed(0))
        found = unmix(image, torch.zeros(1, 1, height, width))
        assert torch.equal(found.front, image)
        assert torch.equal(found.coverage, torch.ones(1, 1, height, width))
        assert not found.mixed.any()


def test_sizes_that_do_not_fit_are_refused():
    image = torch.zeros(1, 3, 4, 5)
    with pytest.raises(ShapeError, match="defocus"):
        unmix(image, torch.zeros(1, 1, 4, 4))
    with pytest.raises(ShapeError, match="share"):
        unmix(image, torch.zeros(1, 1, 4, 5), torch.zeros(1, 4, 5))
