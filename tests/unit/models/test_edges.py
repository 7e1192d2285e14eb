"""EdgeNet: what holds for it whatever it has learned, and that its loss tells truth from error."""

import pytest
import torch
from torch import Tensor, nn

from bokehnet.models.edges import EdgeNet, EdgeNetConfig
from train.train_edges import edge_loss


def network() -> EdgeNet:
    torch.manual_seed(0)
    made = EdgeNet(EdgeNetConfig(widths=(8, 8, 8)))
    nn.init.normal_(made.unet.head.weight, std=0.3)
    return made.eval()


def inputs(height: int = 64, width: int = 96) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    disparity = torch.full((1, 1, height, width), 0.2)
    disparity[..., : width // 2] = 0.9
    return torch.rand(1, 3, height, width, generator=generator), disparity, torch.full((1, 1, 1, 1), 0.7)


def test_a_fresh_network_takes_the_extremes_nearby_for_the_surfaces():
    """The pixel belongs to the one that the map says."""
    image, disparity, span = inputs()
    near, far, evidence = EdgeNet(EdgeNetConfig())(image, disparity, span).split(1, dim=1)
    middle = slice(96 // 2 - 7, 96 // 2 + 7)
    torch.testing.assert_close(near[..., middle], torch.full_like(near[..., middle], 0.9), atol=1e-3, rtol=0)
    torch.testing.assert_close(far[..., middle], torch.full_like(far[..., middle], 0.2), atol=1e-3, rtol=0)
    assert (evidence[..., 41:48] > 3).all()
    assert (evidence[..., 48:55] < -3).all()


@pytest.mark.parametrize(("scale", "offset"), [(100.0, 0.0), (0.003, 5.0)])
def test_scale_and_offset_pass_through(scale, offset):
    image, disparity, span = inputs()
    made = network()
    plain = made(image, disparity, span)
    other = made(image, scale * disparity + offset, scale * span)
    torch.testing.assert_close(other[:, :2], scale * plain[:, :2] + offset, rtol=1e-3, atol=1e-3 * scale)
    torch.testing.assert_close(other[:, 2], plain[:, 2], rtol=1e-2, atol=0.1)


def test_surfaces_stay_within_what_the_wide_window_holds():
    """But for a tenth of its span on either side; a flat map stays what it is."""
    image, disparity, span = inputs()
    near, far, _ = network()(image, disparity, span).split(1, dim=1)
    for surface in (near, far):
        assert surface.min() > 0.2 - 0.11 * 0.71
        assert surface.max() < 0.9 + 0.11 * 0.71
    flat = network()(image, torch.full_like(disparity, 0.5), span)[:, :2]
    assert (flat - 0.5).abs().max() <= 0.011 * 0.7


def test_the_loss_falls_as_surfaces_and_shares_come_true():
    """Three quarters of each pixel near: the likelihood is largest at that share."""
    image, disparity, span = inputs()
    inside = torch.where(torch.arange(4).reshape(1, 4, 1, 1) < 3, 0.9, 0.2).expand(1, 4, 64, 96)
    batch = {"image": image, "disparity": disparity, "truth": disparity, "inside": inside, "span": span}

    class Fixed(EdgeNet):
        def __init__(self, share: float, near: float) -> None:
            super().__init__(EdgeNetConfig(widths=(8, 8, 8)))
            self.share, self.near_at = share, near

        def surfaces(self, image, disparity, span):
            found = super().surfaces(image, disparity, span)
            whole = torch.ones_like(disparity)
            return type(found)(
                near=self.near_at * whole,
                far=0.2 * whole,
                near_scale=0.01 * whole,
                far_scale=0.01 * whole,
                evidence=torch.logit(self.share * whole),
            )

    losses = {
        share: float(edge_loss(Fixed(share, 0.9), batch).detach()) for share in (0.5, 0.7, 0.75, 0.8, 0.95)
    }
    assert min(losses, key=lambda share: losses[share]) == 0.75
    assert losses[0.75] < float(edge_loss(Fixed(0.75, 0.8), batch).detach())
