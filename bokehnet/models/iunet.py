"""IUNet: doubles the resolution of a bokeh picture with the sharp picture as guide."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import encode_features, make_backbone
from bokehnet.optics.encoding import decode, encode

__all__ = ["IUNet", "IUNetConfig"]


@dataclass(frozen=True, kw_only=True)
class IUNetConfig:
    """Shape of an IUNet.

    Attributes:
        width: Channels of the hidden layers.
        num_blocks: Residual blocks.
        unet: Channels of a U-Net, as in ``ARNetConfig``.
        network_max_radius: Defocus is clamped to this many pixels, as for ARNet.
        see_classical: True if the network also receives the classical render.
        see_features: True if the network also receives the features of the classical renderer.
        carry_detail: True if detail finer than ``coarse`` comes from the classical render, with a correction
            of every pixel. The published network interpolates ``coarse`` and corrects only where no nearby
            blur exceeds ``network_max_radius``.
    """

    width: int = 64
    num_blocks: int = 3
    unet: tuple[int, ...] = ()
    network_max_radius: float = 10.0
    see_classical: bool = True
    see_features: bool = False
    carry_detail: bool = False


class IUNet(nn.Module):
    """Iterative upsampling network: sharpens regions near focus, interpolates the others.

    Shape:
        image, classical (B, 3, H, W), scene-linear; defocus (B, 1, H, W), pixels of this size; coarse (B, 3,
        H/2, W/2), the bokeh at half the size; with ``see_features``, features (B, 5, H, W) as in ARNet. H and
        W even, multiples of 8 for a U-Net. Returns bokeh (B, 3, H, W), unclipped in training and at least 0
        in evaluation.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    config: IUNetConfig

    def __init__(self, config: IUNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 4 + 3 * config.see_classical + 5 * config.see_features
        self.backbone = make_backbone(4 * channels + 3, 3, config.width, config.num_blocks, config.unet)

    def correction_mask(self, defocus: Tensor) -> Tensor:
        """Return the mask that is 1 where all nearby blur is below ``network_max_radius``, feathered to 0."""
        near = F.max_pool2d(defocus.abs(), 5, stride=1, padding=2)
        return F.avg_pool2d(
            (near < self.config.network_max_radius).to(near.dtype), 5, 1, padding=2, count_include_pad=False
        )

    def forward(
        self,
        image: Tensor,
        defocus: Tensor,
        classical: Tensor,
        coarse: Tensor,
        features: Tensor | None = None,
    ) -> Tensor:
        """Return the bokeh at the size of ``image``."""
        encoded = [encode(image)]
        if self.config.see_classical:
            encoded.append(encode(classical))
        encoded += [
            (defocus / self.config.network_max_radius).clamp(-1, 1),
            *encode_features(features, self.config.see_features),
        ]
        small = encode(coarse)
        if self.config.carry_detail:
            small = small - encode(F.avg_pool2d(classical, 2))
        stacked = torch.cat([F.pixel_unshuffle(torch.cat(encoded, dim=1), 2), small], dim=1)
        correction = self.backbone(stacked).float()
        start = F.interpolate(small.float(), scale_factor=2, mode="bilinear", align_corners=False)
        if self.config.carry_detail:
            start = start + encode(classical).float()
        else:
            correction = correction * self.correction_mask(defocus)
        bokeh = decode(start + correction)
        return bokeh if self.training else bokeh.clamp(min=0)
