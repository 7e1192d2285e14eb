"""IUNet: doubles the size of a bokeh picture with the sharp picture as its guide."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.models.blocks import Backbone, decode, encode

__all__ = ["IUNet", "IUNetConfig"]


@dataclass(frozen=True, kw_only=True)
class IUNetConfig:
    """Shape of an IUNet.

    Attributes:
        width: Channels of the hidden layers.
        num_blocks: Residual blocks.
        unit: Defocus is clamped to this many pixels, ARNet's unit.
        see_classical: Whether it also sees the classical render.
    """

    width: int = 64
    num_blocks: int = 3
    unit: float = 10.0
    see_classical: bool = True


class IUNet(nn.Module):
    """Iterative upsampling network: sharpens what is nearly in focus, interpolates what is not.

    Shape:
        image, classical (B, 3, H, W), scene-linear; defocus (B, 1, H, W), pixels of this size; coarse
        (B, 3, H/2, W/2), the bokeh at half the size. Returns bokeh (B, 3, H, W),
        unclipped in training and at least 0 in evaluation.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    config: IUNetConfig

    def __init__(self, config: IUNetConfig) -> None:
        super().__init__()
        self.config = config
        channels = 4 + 3 * config.see_classical
        self.backbone = Backbone(4 * channels + 3, 3, config.width, config.num_blocks)

    def keep_mask(self, defocus: Tensor) -> Tensor:
        """1 where all blur nearby is below one unit, feathered to 0 where there is nothing sharp to gain."""
        near = F.max_pool2d(defocus.abs(), 5, stride=1, padding=2)
        return F.avg_pool2d(
            (near < self.config.unit).to(near.dtype), 5, 1, padding=2, count_include_pad=False
        )

    def forward(self, image: Tensor, defocus: Tensor, classical: Tensor, coarse: Tensor) -> Tensor:
        """Return the bokeh at the size of ``image``."""
        pictures = [encode(image)]
        if self.config.see_classical:
            pictures.append(encode(classical))
        clamped = (defocus / self.config.unit).clamp(-1, 1)
        small = encode(coarse)
        features = torch.cat([F.pixel_unshuffle(torch.cat([*pictures, clamped], dim=1), 2), small], dim=1)
        correction = self.backbone(features).float() * self.keep_mask(defocus)
        upsampled = F.interpolate(small.float(), scale_factor=2, mode="bilinear", align_corners=False)
        bokeh = decode(upsampled + correction)
        return bokeh if self.training else bokeh.clamp(min=0)
