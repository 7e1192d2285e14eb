"""RepairNet: what holds for it whatever it has learned."""

import pytest
import torch
from scipy.ndimage import maximum_filter, minimum_filter
from torch import Tensor, nn

from bokehnet.models.repair import RepairNet, RepairNetConfig, color_similarity, extremes


def network() -> RepairNet:
    torch.manual_seed(0)
    result = RepairNet(RepairNetConfig(widths=(8, 8, 8)))
    nn.init.normal_(result.unet.head.weight, std=0.5)
    return result.eval()


def inputs(height: int = 48, width: int = 64) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    disparity = torch.full((1, 1, height, width), 0.2)
    disparity[..., : width // 2] = 0.9
    return torch.rand(1, 3, height, width, generator=generator), disparity, torch.full((1, 1, 1, 1), 0.7)


def test_extremes_are_those_of_square_windows():
    """Oracle: scipy's filters with the border repeated, window by window."""
    values = torch.rand(1, 1, 30, 40, generator=torch.Generator().manual_seed(1))
    radii = (1, 2, 5)
    for radius, window in zip(radii, extremes(values, radii), strict=True):
        for result, oracle in zip(window, (minimum_filter, maximum_filter), strict=True):
            expected = oracle(values[0, 0].numpy(), 2 * radius + 1, mode="nearest")
            torch.testing.assert_close(result[0, 0], torch.from_numpy(expected))


def test_a_fresh_network_leaves_the_map_as_it_is():
    image, disparity, span = inputs()
    torch.testing.assert_close(RepairNet(RepairNetConfig())(image, disparity, span)[0], disparity)


def test_nothing_changes_beyond_the_reach_of_steps():
    image, disparity, span = inputs()
    repaired, _ = network()(image, disparity, span)
    assert (repaired - disparity).abs()[..., 23:41].max() > 0.01
    torch.testing.assert_close(repaired[..., :22], disparity[..., :22])
    torch.testing.assert_close(repaired[..., 42:], disparity[..., 42:])
    assert repaired.min() >= 0.2
    assert repaired.max() <= 0.9


@pytest.mark.parametrize(("scale", "offset"), [(100.0, 0.0), (0.003, 5.0)])
def test_scale_and_offset_pass_through(scale, offset):
    image, disparity, span = inputs()
    result = network()
    other, other_votes = result(image, scale * disparity + offset, scale * span)
    plain, votes = result(image, disparity, span)
    torch.testing.assert_close(other, scale * plain + offset, rtol=1e-4, atol=1e-4 * scale)
    torch.testing.assert_close(other_votes, votes, rtol=0.02, atol=2)


def test_weak_evidence_moves_nothing_and_shrinking_needs_more_than_growing():
    """One logit to grow, three to shrink: a constant push on a map with one step."""
    image, disparity, span = inputs()
    result = RepairNet(RepairNetConfig(widths=(8, 8, 8))).eval()
    moved = {}
    for push in (-4.5, -2.5, 0.5, 2.5):
        nn.init.constant_(result.unet.head.bias, push)
        moved[push] = (result(image, disparity, span)[0] - disparity).abs().max().item()
    assert moved[0.5] == moved[-2.5] == 0
    assert moved[-4.5] > 0.01
    assert moved[2.5] > 0.01


def test_votes_count_the_pixels_of_both_sides_that_want_to_move():
    """A straight step: seven columns of either side see it; a constant push moves one side only."""
    image, disparity, span = inputs()
    result = RepairNet(RepairNetConfig(widths=(8, 8, 8))).eval()
    for push, expected in ((0.0, [0, 336, 0, 336]), (0.6, [336, 336, 0, 336]), (-0.6, [0, 336, 336, 336])):
        nn.init.constant_(result.unet.head.bias, push)
        assert result(image, disparity, span)[1].tolist() == [expected]


@pytest.mark.parametrize("cell", [2, 4])
def test_likeness_separates_near_from_far_by_colour(cell):
    """Red before blue: beside the edge each colour is separated, on both sides of a map that is off."""
    colors = torch.zeros(1, 3, 32, 32)
    colors[:, 0, :, :16], colors[:, 2, :, 16:] = 1.0, 1.0
    share = torch.zeros(1, 1, 32, 32)
    share[..., :18] = 1
    equal = color_similarity(colors, share, cell)[0, 0, 8:24]
    assert equal[:, 10:16].min() > 0.5
    assert equal[:, 16:20].max() < -0.5
