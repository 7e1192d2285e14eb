"""The networks: their sizes, what a fresh one does, and that nothing is clipped."""

import pytest
import torch
from torch import Tensor, nn

from bokehnet.errors import ParameterError
from bokehnet.models.arnet import ARNet, ARNetConfig
from bokehnet.models.blocks import UNet
from bokehnet.models.iunet import IUNet, IUNetConfig
from bokehnet.optics.encoding import decode, encode


def inputs(height: int = 12, width: int = 16) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(2, 3, height, width, generator=generator)
    defocus = 10 * (2 * torch.rand(2, 1, height, width, generator=generator) - 1)
    return image, defocus, torch.rand(2, 3, height, width, generator=generator)


def weights_of(network: nn.Module) -> int:
    return sum(parameter.numel() for parameter in network.parameters())


def test_sizes_are_those_of_the_published_networks():
    """Peng et al. 2022: about 0.92 M and 0.24 M; ours see the classical render as well by default."""
    assert weights_of(ARNet(ARNetConfig(see_classical=False))) == pytest.approx(0.92e6, rel=0.03)
    assert weights_of(IUNet(IUNetConfig(see_classical=False))) == pytest.approx(0.24e6, rel=0.05)


def test_encoding_is_inverted_by_decoding_over_the_whole_range_of_light():
    light = torch.tensor([0, 1e-4, 0.18, 1, 50, 1000], dtype=torch.float64)
    torch.testing.assert_close(decode(encode(light)), light)
    assert encode(torch.ones(1)).item() == pytest.approx(1)
    assert encode(torch.full((1,), -1.0)).item() == 0


def test_a_fresh_arnet_leaves_what_it_corrects_as_it_is():
    image, defocus, classical = inputs()
    bokeh, error_map = ARNet(ARNetConfig(width=8)).eval()(image, defocus, classical)
    torch.testing.assert_close(bokeh, classical)
    torch.testing.assert_close(error_map, torch.full_like(error_map, 0.5))
    bokeh, _ = ARNet(ARNetConfig(width=8, see_classical=False)).eval()(image, defocus, classical)
    torch.testing.assert_close(bokeh, image)


def test_a_fresh_iunet_interpolates():
    image, defocus, classical = inputs()
    coarse = torch.rand(2, 3, 6, 8, generator=torch.Generator().manual_seed(1))
    bokeh = IUNet(IUNetConfig(width=8)).eval()(image, defocus, classical, coarse)
    expected = nn.functional.interpolate(encode(coarse), scale_factor=2, mode="bilinear")
    torch.testing.assert_close(encode(bokeh), expected)


def test_a_fresh_iunet_that_carries_detail_takes_it_from_the_classical_render():
    """A coarse bokeh that is the halved classical render gives the classical render back."""
    image, defocus, classical = inputs()
    features = torch.rand(2, 5, 12, 16)
    network = IUNet(IUNetConfig(width=8, see_features=True, carry_detail=True)).eval()
    coarse = nn.functional.avg_pool2d(classical, 2)
    torch.testing.assert_close(network(image, defocus, classical, coarse, features), classical)
    brighter = network(image, defocus, classical, 2 * coarse, features)
    assert (brighter > classical).all()


def test_features_keep_their_size_through_a_fresh_unet():
    """Without that, training stood still: outputs of stages stay near one, whatever the input's scale."""
    torch.manual_seed(0)
    network, sizes = UNet(32, 4, (16, 24, 32)), []
    for stage in (network.fine, network.coarse, network.rise_fine):
        stage.register_forward_hook(lambda module, args, output: sizes.append(output.abs().mean().item()))
    for scale in (0.3, 30.0):
        sizes.clear()
        network(scale * torch.randn(2, 32, 16, 24))
        assert 0.3 < min(sizes) < max(sizes) < 3


def test_a_unet_takes_full_size_features_as_it_takes_unshuffled_ones():
    torch.manual_seed(0)
    network = UNet(4 * 3, 1, (8, 12, 16)).double().eval()
    nn.init.normal_(network.head.weight)
    features = torch.rand(2, 3, 24, 32, dtype=torch.float64)
    expected = network(nn.functional.pixel_unshuffle(features, 2))
    torch.testing.assert_close(network.from_full_size(features), expected, rtol=1e-10, atol=1e-10)
    assert expected.abs().max() > 0.1


def test_a_unet_takes_the_place_of_the_row_of_blocks():
    network = ARNet(ARNetConfig(unet=(8, 12, 16), see_features=True)).eval()
    image, defocus, classical = inputs(24, 32)
    bokeh, error_map = network(image, defocus, classical, torch.rand(2, 5, 24, 32))
    torch.testing.assert_close(bokeh, classical)
    assert error_map.shape == (2, 1, 24, 32)
    with pytest.raises(ParameterError, match=r"unet: expected three widths, got \(8, 8\)"):
        ARNet(ARNetConfig(unet=(8, 8)))


def test_error_map_reaches_zero_and_one_exactly():
    network = ARNet(ARNetConfig(width=8)).eval()
    for bias, expected in ((-9.0, 0.0), (9.0, 1.0)):
        nn.init.constant_(network.backbone.head.bias[12:], bias)
        _, error_map = network(*inputs())
        assert error_map.unique().tolist() == [expected]


def test_highlights_pass_unclipped_and_nothing_is_negative_in_evaluation():
    image, defocus, classical = inputs()
    network = ARNet(ARNetConfig(width=8)).eval()
    assert network(image, defocus, 1000 * classical)[0].max() > 900
    nn.init.constant_(network.backbone.head.bias, -3.0)
    assert network(image, defocus, classical)[0].min() >= 0
    assert network.train()(image, defocus, classical)[0].min() < 0


def test_iunet_keeps_the_interpolation_where_the_blur_is_large():
    image, _, classical = inputs(24, 24)
    network = IUNet(IUNetConfig(width=8))
    nn.init.normal_(network.backbone.head.weight, std=0.1)
    coarse = torch.rand(2, 3, 12, 12)
    defocus = torch.zeros(2, 1, 24, 24)
    defocus[..., 12:] = 30.0
    bokeh = network.eval()(image, defocus, classical, coarse)
    plain = decode(nn.functional.interpolate(encode(coarse), scale_factor=2, mode="bilinear"))
    torch.testing.assert_close(bokeh[..., 12:], plain[..., 12:])
    assert (bokeh[..., :8] - plain[..., :8]).abs().max() > 1e-3
