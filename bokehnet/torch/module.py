"""Bokeh as a layer of a network."""

import torch
from torch import Tensor, nn

from bokehnet.checks import check_choice
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.coc import defocus_from_disparity
from bokehnet.torch.aperture import SmoothAperture
from bokehnet.torch.checks import check_map, check_picture
from bokehnet.torch.occlusion import Background, layered
from bokehnet.torch.splatting import scatter

__all__ = ["BokehBlur"]


class BokehBlur(nn.Module):
    r"""Render bokeh from a picture and its disparity; blur and focus are parameters.

    The signed defocus is ``blur * (disparity - focus)``, in pixels.

    Args:
        blur: Blur radius of a point one unit of disparity from focus, pixels.
        focus: Disparity in focus.
        aperture: Fixed aperture, or one with gradients; default: a disc.
        mode: ``"layered"``, with occlusion, or ``"scatter"``.
        samples: Pupil samples per pixel; not used by the scatter of a fixed aperture.

    Shape:
        image :math:`(B, C, H, W)`, scene-linear; disparity :math:`(B, 1, H, W)`, near is large. Returns
        :math:`(B, C, H, W)`.

    Raises:
        ParameterError: ``mode`` is neither of both.

    Examples:
        >>> blurred = BokehBlur(blur=8.0, focus=0.5)(torch.rand(1, 3, 24, 32), torch.rand(1, 1, 24, 32))
        >>> blurred.shape
        torch.Size([1, 3, 24, 32])
    """

    def __init__(
        self,
        blur: float,
        focus: float = 0.0,
        aperture: Aperture | SmoothAperture | None = None,
        *,
        mode: str = "layered",
        samples: int = 32,
    ) -> None:
        super().__init__()
        check_choice("mode", mode, ("layered", "scatter"))
        self.blur = nn.Parameter(torch.tensor(float(blur)))
        self.focus = nn.Parameter(torch.tensor(float(focus)))
        self.aperture, self.mode, self.samples = aperture, mode, samples

    def forward(
        self,
        image: Tensor,
        disparity: Tensor,
        background: Background = (),
        coverage: Tensor | None = None,
    ) -> Tensor:
        """Return the bokeh; ``background`` holds colours and *disparity* of each hidden layer."""
        check_picture("image", image)
        check_map("disparity", disparity, image)
        defocus = defocus_from_disparity(disparity, self.blur, self.focus)
        if self.mode == "scatter":
            return scatter(image, defocus, self.aperture, samples=self.samples)
        hidden = [
            (color, defocus_from_disparity(behind, self.blur, self.focus)) for color, behind in background
        ]
        return layered(image, defocus, hidden, coverage, self.aperture, samples=self.samples)
