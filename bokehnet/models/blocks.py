"""Building blocks of the networks."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.errors import ParameterError
from bokehnet.optics.encoding import encode

__all__ = ["Backbone", "ResidualBlock", "UNet", "encode_features", "make_backbone"]


def encode_features(features: Tensor | None, enabled: bool) -> list[Tensor]:
    """Return the feature inputs of a network, (B, 5, H, W) with encoded colours, or none."""
    if not enabled:
        return []
    assert features is not None, "this network was trained with features"
    return [encode(features[:, :3]), features[:, 3:]]


# Initial scale of residual blocks: without normalisation, full scale in every block makes features grow a
# thousandfold through a U-Net.
_INITIAL_RESIDUAL_SCALE = 0.1


def _initialize_convolutions(network: nn.Module) -> None:
    """Initialize the weights of all convolutions so that features keep their magnitude.

    Source:
        He et al., "Delving deep into rectifiers", ICCV 2015; with PyTorch's default the networks hardly
        learned.
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
                block.second.weight.mul_(_INITIAL_RESIDUAL_SCALE)


class ResidualBlock(nn.Module):
    """Two 3x3 convolutions with ELU and a skip connection; (B, width, H, W) to the same shape."""

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
        features (B, in_channels, H/2, W/2) to (B, out_channels, H, W). The last convolution starts at zero,
        so that an untrained network leaves its input unchanged.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    def __init__(self, in_channels: int, out_channels: int, width: int, num_blocks: int) -> None:
        super().__init__()
        self.stem = nn.Conv2d(in_channels, width, 3, padding=1)
        self.blocks = nn.Sequential(*(ResidualBlock(width) for _ in range(num_blocks)))
        self.head = nn.Conv2d(width, 4 * out_channels, 3, padding=1)
        _initialize_convolutions(self)
        nn.init.zeros_(self.head.weight)

    def forward(self, features: Tensor) -> Tensor:
        """Map half-size features to full-size outputs."""
        return F.pixel_shuffle(self.head(F.elu(self.blocks(self.stem(features)))), 2)


# Added to the mean square of a pixel's features before the normalisation by its root.
_NORMALISATION_EPSILON = 1e-3


class _Stage(nn.Module):
    """Convolution to a new width, normalisation to unit mean square, then residual blocks.

    Source:
        Zhang and Sennrich, "Root mean square layer normalization", NeurIPS 2019.
    """

    def __init__(self, in_channels: int, width: int, num_blocks: int, stride: int = 1) -> None:
        super().__init__()
        self.enter = nn.Conv2d(in_channels, width, 3, stride=stride, padding=1)
        self.blocks = nn.Sequential(*(ResidualBlock(width) for _ in range(num_blocks)))

    def forward(self, features: Tensor) -> Tensor:
        """Map (B, in_channels, H, W) to (B, width, H / stride, W / stride)."""
        return self.after_projection(self.enter(features))

    def after_projection(self, projected: Tensor) -> Tensor:
        """Apply normalisation and blocks to the output of :attr:`enter`."""
        # Training is unstable without a common scale of the features; the scale is per pixel, so that tiles
        # give the same result as the whole picture.
        scale = torch.rsqrt(projected.square().mean(dim=1, keepdim=True) + _NORMALISATION_EPSILON)
        result: Tensor = self.blocks(projected * scale)
        return result


def convolve_unshuffled(layer: nn.Conv2d, features: Tensor) -> Tensor:
    """Return a 3x3 convolution of ``F.pixel_unshuffle(features, 2)`` without the shuffle.

    This equals a 6x6 convolution with stride 2.

    Args:
        layer: Convolution from 4 C channels, with padding 1.
        features: Features (B, C, H, W) with even sides.
    """
    weight = layer.weight.unflatten(1, (-1, 2, 2)).permute(0, 1, 4, 2, 5, 3).flatten(4).flatten(2, 3)
    return F.conv2d(features, weight, layer.bias, stride=2, padding=2)


def _double(features: Tensor) -> Tensor:
    return F.interpolate(features, scale_factor=2, mode="nearest")


class UNet(nn.Module):
    """Three resolutions with skip connections, then a 3x3 convolution and a pixel shuffle by 2.

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
        _initialize_convolutions(self)
        nn.init.zeros_(self.head.weight)

    def forward(self, features: Tensor) -> Tensor:
        """Map half-size features to full-size outputs."""
        return self._rest(self.fine(features))

    def from_full_size(self, features: Tensor) -> Tensor:
        """Map full-size features (B, in_channels / 4, H, W), equivalent to their pixel unshuffle by 2."""
        return self._rest(self.fine.after_projection(convolve_unshuffled(self.fine.enter, features)))

    def _rest(self, fine: Tensor) -> Tensor:
        middle = self.middle(fine)
        coarse = self.coarse(middle)
        middle = self.rise_middle(torch.cat([_double(coarse), middle], dim=1))
        fine = self.rise_fine(torch.cat([_double(middle), fine], dim=1))
        return F.pixel_shuffle(self.head(F.elu(fine)), 2)


def make_backbone(
    in_channels: int, out_channels: int, width: int, num_blocks: int, unet: tuple[int, ...]
) -> Backbone | UNet:
    """Return a U-Net of the widths ``unet``, or a sequence of residual blocks if it is empty."""
    if not unet:
        return Backbone(in_channels, out_channels, width, num_blocks)
    if len(unet) != 3:
        raise ParameterError("unet", "three widths", unet)
    fine, middle, coarse = unet
    return UNet(in_channels, out_channels, (fine, middle, coarse))
