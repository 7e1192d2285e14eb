"""Networks of BokehMe as published: gamma as input, pictures as output."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from bokehnet.inference.bokehme import UNIT_PX
from bokehnet.models.blocks import Backbone

__all__ = ["BokehMeARNet", "BokehMeConfig", "BokehMeIUNet"]


@dataclass(frozen=True, kw_only=True)
class BokehMeConfig:
    """Shape of one of the networks; the published widths are 128 for ARNet and 64 for IUNet.

    Attributes:
        width: Channels of the hidden layers.
        num_blocks: Residual blocks.
    """

    width: int = 128
    num_blocks: int = 3


def _half_size(pictures: list[Tensor], gamma: Tensor) -> Tensor:
    """Return pictures and defocus as channels of half the size, with gamma as one constant channel."""
    unshuffled = F.pixel_unshuffle(torch.cat(pictures, dim=1), 2)
    return torch.cat([unshuffled, gamma.expand(-1, -1, *unshuffled.shape[-2:])], dim=1)


class BokehMeARNet(nn.Module):
    """Adaptive rendering network: bokeh at a working size and the error map of the scatter.

    Shape:
        image (B, 3, H, W), encoded; defocus (B, 1, H, W), pixels, at most 10; gamma (B, 1, 1, 1), normalised
        to [0, 1]; H and W even. Returns encoded bokeh (B, 3, H, W), unclipped in training and at least 0 in
        evaluation, and the error map (B, 1, H, W) in (0, 1).

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    config: BokehMeConfig

    def __init__(self, config: BokehMeConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = Backbone(4 * 4 + 1, 4, config.width, config.num_blocks)

    def forward(self, image: Tensor, defocus: Tensor, gamma: Tensor) -> tuple[Tensor, Tensor]:
        """Return bokeh and error map."""
        output = self.backbone(_half_size([image, defocus / UNIT_PX], gamma)).float()
        bokeh, logit = output.split([3, 1], dim=1)
        return bokeh if self.training else bokeh.clamp(min=0), logit.sigmoid()


class BokehMeIUNet(nn.Module):
    """Iterative upsampling network: bokeh at twice the size, with the sharp picture as guide.

    Shape:
        image (B, 3, H, W), encoded; defocus (B, 1, H, W), pixels of this size; coarse (B, 3, H/2, W/2); gamma
        (B, 1, 1, 1), normalised. Returns encoded bokeh (B, 3, H, W), as :class:`BokehMeARNet`.

    Source:
        Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
    """

    config: BokehMeConfig

    def __init__(self, config: BokehMeConfig) -> None:
        super().__init__()
        self.config = config
        self.backbone = Backbone(4 * 4 + 3 + 1, 3, config.width, config.num_blocks)

    def forward(self, image: Tensor, defocus: Tensor, coarse: Tensor, gamma: Tensor) -> Tensor:
        """Return the bokeh at the size of ``image``."""
        guide = _half_size([image, (defocus / UNIT_PX).clamp(-1, 1)], gamma)
        bokeh: Tensor = self.backbone(torch.cat([guide, coarse], dim=1)).float()
        return bokeh if self.training else bokeh.clamp(min=0)
