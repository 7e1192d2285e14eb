"""ARNet: coarse bokeh and error map at a resolution whose maximum blur radius it was trained for."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import encode_features, make_backbone
from bokehnet.optics.encoding import decode, encode

__all__ = ["ARNet", "ARNetConfig"]


@dataclass(frozen=True, kw_only=True)
class ARNetConfig:
    """Shape of an ARNet.

    Attributes:
        width: Channels of the hidden layers.
        num_blocks: Residual blocks.
        unet: Channels at 1/2, 1/4 and 1/8 of the resolution of a U-Net that replaces the published sequence
            of residual blocks; empty for that sequence.
        network_max_radius: Maximum blur radius, pixels.
        see_classical: True if the network receives and corrects the classical render; the published network
            receives only the all-in-focus picture.
        see_features: True if the network receives the features of the classical renderer
            (``bokehnet.inference.coarse_to_fine.Level``).
    """

    width: int = 128
    num_blocks: int = 3
    unet: tuple[int, ...] = ()
    network_max_radius: float = 10.0
    see_classical: bool = True
    see_features: bool = False


class ARNet(nn.Module):
    """Adaptive rendering network: bokeh, and an error map of the classical render.

    Shape:
        image, classical (B, 3, H, W), scene-linear; defocus (B, 1, H, W), pixels, at most
        ``network_max_radius``; H and W even, multiples of 8 for a U-Net. With ``see_features``, features (B,
        5, H, W): occluded background, disocclusion weight, error map. Returns bokeh (B, 3, H, W),
        scene-linear, unclipped in training and at least 0 in evaluation, and the error map (B, 1, H, W) in
        [0, 1], which can be exactly 0 and 1.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022. Changed: light
        is scene-linear, hence no gamma input; colours are encoded inside; the output is a correction.
    """

    config: ARNetConfig

    def __init__(self, config: ARNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 4 + 3 * config.see_classical + 5 * config.see_features
        self.backbone = make_backbone(4 * channels, 4, config.width, config.num_blocks, config.unet)

    def forward(
        self, image: Tensor, defocus: Tensor, classical: Tensor, features: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Return bokeh and error map."""
        pictures = [encode(image)]
        if self.config.see_classical:
            pictures.append(encode(classical))
        stacked = torch.cat(
            [
                *pictures,
                defocus / self.config.network_max_radius,
                *encode_features(features, self.config.see_features),
            ],
            dim=1,
        )
        output = self.backbone(F.pixel_unshuffle(stacked, 2)).float()
        correction, logit = output.split([3, 1], dim=1)
        bokeh = decode(pictures[-1].float() + correction)
        error_map = (1.1 * logit.sigmoid() - 0.05).clamp(0, 1)
        return bokeh if self.training else bokeh.clamp(min=0), error_map
