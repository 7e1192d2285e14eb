"""What ARNet and IUNet are made of."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.errors import ParameterError
from bokehnet.optics.encoding import encode

__all__ = ["Backbone", "ResidualBlock", "UNet", "encode_features", "make_backbone"]


def encode_features(features: Tensor | None, seen: bool) -> list[Tensor]:
    """What to append to a network's inputs: features (B, 5, H, W) with their colours encoded, or nothing."""
    if not seen:
        return []
    assert features is not None, "this network was trained with features"
    return [encode(features[:, :3]), features[:, 3:]]


# How strongly a fresh residual block changes what passes through it: without normalisation, full strength in
# every block makes features grow a thousandfold through a U-Net.
_FRESH = 0.1


def _start_convolutions(network: nn.Module) -> None:
    """Draw the weights of all convolutions so that features keep their size on their way.

    Source:
        He et al., "Delving deep into rectifiers", ICCV 2015; PyTorch's default hardly learned.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="linear")
            assert layer.bias is not None
            nn.init.zeros_(layer.bias)
    for block in network.modules():
        if isinstance(block, ResidualBlock):
            nn.init.kaiming_normal_(block.first.weight, nonlinearity="relu")
            with torch.no_grad():
                block.second.weight.mul_(_FRESH)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions with ELU around a skip; (B, width, H, W) to the same."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(width, width, 3, padding=1)
        self.second = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, features: Tensor) -> Tensor:
        """Add a correction to ``features``."""
        return features + self.second(F.elu(self.first(F.elu(features))))


class Backbone(nn.Module):
    """3x3 convolution in, residual blocks, 3x3 convolution out, pixel shuffle by 2.

    Shape:
        features (B, in_channels, H/2, W/2) to (B, out_channels, H, W). The last convolution starts at
        zero, so that a fresh network leaves what it corrects as it is.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    def __init__(self, in_channels: int, out_channels: int, width: int, num_blocks: int) -> None:
        super().__init__()
        self.stem = nn.Conv2d(in_channels, width, 3, padding=1)
        self.blocks = nn.Sequential(*(ResidualBlock(width) for _ in range(num_blocks)))
        self.head = nn.Conv2d(width, 4 * out_channels, 3, padding=1)
        _start_convolutions(self)
        nn.init.zeros_(self.head.weight)

    def forward(self, features: Tensor) -> Tensor:
        """Map half-size features to full-size outputs."""
        return F.pixel_shuffle(self.head(F.elu(self.blocks(self.stem(features)))), 2)


# Added to the mean square of a pixel's features before they are divided by its root.
_SMALL = 1e-3


class _Stage(nn.Module):
    """A convolution to a new width, features brought to unit mean square, then residual blocks.

    Source:
        Zhang and Sennrich, "Root mean square layer normalization", NeurIPS 2019.
    """

    def __init__(self, in_channels: int, width: int, num_blocks: int, stride: int = 1) -> None:
        super().__init__()
        self.enter = nn.Conv2d(in_channels, width, 3, stride=stride, padding=1)
        self.blocks = nn.Sequential(*(ResidualBlock(width) for _ in range(num_blocks)))

    def forward(self, features: Tensor) -> Tensor:
        """(B, in_channels, H, W) to (B, width, H / stride, W / stride)."""
        return self.after_entering(self.enter(features))

    def after_entering(self, entered: Tensor) -> Tensor:
        """The same from what :attr:`enter` gives."""
        # Without a common scale of the features this network is not stable to train; per pixel, so that tiles
        # give what the whole picture gives.
        scale = torch.rsqrt(entered.square().mean(dim=1, keepdim=True) + _SMALL)
        result: Tensor = self.blocks(entered * scale)
        return result


def convolve_unshuffled(layer: nn.Conv2d, features: Tensor) -> Tensor:
    """What a 3x3 convolution makes of ``F.pixel_unshuffle(features, 2)``, without shuffling a pixel.

    It is a convolution of 6x6 pixels, two pixels on each time.

    Args:
        layer: From 4 C channels, with a padding of 1.
        features: (B, C, H, W), sides even.
    """
    weight = layer.weight.unflatten(1, (-1, 2, 2)).permute(0, 1, 4, 2, 5, 3).flatten(4).flatten(2, 3)
    return F.conv2d(features, weight, layer.bias, stride=2, padding=2)


def _double(features: Tensor) -> Tensor:
    return F.interpolate(features, scale_factor=2, mode="nearest")


class UNet(nn.Module):
    """Three sizes with skips between them, then a 3x3 convolution and a pixel shuffle by 2.

    Shape:
        features (B, in_channels, H/2, W/2), sides multiples of 4, to (B, out_channels, H, W). The last
        convolution starts at zero.

    Source:
        Ronneberger, Fischer and Brox, "U-Net: Convolutional networks for biomedical image segmentation",
        MICCAI 2015.
    """

    def __init__(self, in_channels: int, out_channels: int, widths: tuple[int, int, int]) -> None:
        super().__init__()
        fine, middle, coarse = widths
        self.fine = _Stage(in_channels, fine, 1)
        self.middle = _Stage(fine, middle, 1, stride=2)
        self.coarse = _Stage(middle, coarse, 2, stride=2)
        self.rise_middle = _Stage(coarse + middle, middle, 1)
        self.rise_fine = _Stage(middle + fine, fine, 1)
        self.head = nn.Conv2d(fine, 4 * out_channels, 3, padding=1)
        _start_convolutions(self)
        nn.init.zeros_(self.head.weight)

    def forward(self, features: Tensor) -> Tensor:
        """Map half-size features to full-size outputs."""
        return self._rest(self.fine(features))

    def from_full_size(self, features: Tensor) -> Tensor:
        """The same from (B, in_channels / 4, H, W), as from their pixel unshuffle by 2."""
        return self._rest(self.fine.after_entering(convolve_unshuffled(self.fine.enter, features)))

    def _rest(self, fine: Tensor) -> Tensor:
        middle = self.middle(fine)
        coarse = self.coarse(middle)
        middle = self.rise_middle(torch.cat([_double(coarse), middle], dim=1))
        fine = self.rise_fine(torch.cat([_double(middle), fine], dim=1))
        return F.pixel_shuffle(self.head(F.elu(fine)), 2)


def make_backbone(
    in_channels: int, out_channels: int, width: int, num_blocks: int, unet: tuple[int, ...]
) -> Backbone | UNet:
    """A U-Net of the widths ``unet``, or a row of blocks where that is empty."""
    if not unet:
        return Backbone(in_channels, out_channels, width, num_blocks)
    if len(unet) != 3:
        raise ParameterError("unet", "three widths", unet)
    fine, middle, coarse = unet
    return UNet(in_channels, out_channels, (fine, middle, coarse))
