"""Scatter as a torch operation, with gradients for the image and the defocus."""

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from bokehnet.arrays.viewport import Viewport
from bokehnet.checks import check_rank, check_same_size
from bokehnet.classical.scatter import pyramid_levels
from bokehnet.classical.scatter.disc_scatter import LARGEST_RADIUS
from bokehnet.classical.scatter.operators import scatter_operator
from bokehnet.classical.scatter.pyramid_levels import ScatterOperator
from bokehnet.classical.torch import pyramid_levels as torch_levels
from bokehnet.classical.torch.border import beyond_border, continuation_px, repeat_border
from bokehnet.classical.torch.not_compiled import not_compiled
from bokehnet.optics.aperture import Aperture

__all__ = ["scatter", "scatter_sums"]


class _Scatter(torch.autograd.Function):
    """Autograd function of the NumPy kernels; without copies, for CPU tensors only."""

    @staticmethod
    def forward(
        ctx: Any, values: Tensor, defocus: Tensor, operator: ScatterOperator, viewport: Viewport | None
    ) -> Tensor:
        ctx.save_for_backward(values, defocus)
        ctx.operator, ctx.viewport = operator, viewport
        sums = pyramid_levels.scatter_forward(
            values.detach().numpy(), defocus.detach().numpy(), operator, viewport=viewport
        )
        return torch.from_numpy(sums)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_sums: Tensor) -> tuple[Tensor, Tensor, None, None]:
        values, defocus = (tensor.detach().numpy() for tensor in ctx.saved_tensors)
        gradients: tuple[np.ndarray, np.ndarray] = pyramid_levels.scatter_backward(
            values, defocus, grad_sums.contiguous().numpy(), ctx.operator, viewport=ctx.viewport
        )
        return torch.from_numpy(gradients[0]), torch.from_numpy(gradients[1]), None, None


@not_compiled  # Dynamo cannot trace a Numba dispatcher
def scatter_sums(
    values: Tensor,
    defocus: Tensor,
    operator: ScatterOperator = pyramid_levels.DISC,
    viewport: Viewport | None = None,
) -> Tensor:
    """Return the sums of values scattered over shapes, by ``bokehnet.classical.scatter.pyramid_levels``.

    Args:
        values: Values of the pixels, (H, W, C), on the CPU, float32 or float64.
        defocus: Signed blur radius in pixels, (H, W), of the same dtype.
        operator: Shape of the blur; default: a disc.
        viewport: Position of the pixels in the full picture, for a cat's-eye; default: the whole picture.

    Returns:
        Sums (H, W, C), once differentiable in both tensors.
    """
    return _Scatter.apply(values.contiguous(), defocus.contiguous(), operator, viewport)


def scatter(image: Tensor, defocus: Tensor, aperture: Aperture | None = None) -> Tensor:
    """Render bokeh by scattering; differentiable in both tensors, once.

    Args:
        image: Scene-linear colours, (H, W, C), float32 or float64, on the CPU or a CUDA device.
        defocus: Signed blur radius in pixels, (H, W), of the same dtype and device. Where its magnitude is
            0.5 or less, the result does not depend on it and the gradient is 0.
        aperture: Shape of the aperture; default: a disc.

    Returns:
        Picture (H, W, C). It continues beyond its border as in every engine, see
        :mod:`bokehnet.arrays.beyond_border`.

    Raises:
        ShapeError: The sizes differ.
        ParameterError: The dtypes differ or are not supported.
    """
    check_rank("image", image, 3, "(H, W, C)")
    check_rank("defocus", defocus, 2, "(H, W)")
    check_same_size("image", image, "defocus", defocus)
    torch_levels.check_dtypes("image", image, defocus)
    defocus = defocus.clamp(-LARGEST_RADIUS, LARGEST_RADIUS)
    height, width = defocus.shape
    reach = continuation_px(defocus)
    light = beyond_border(image.movedim(2, 0), reach).movedim(0, 2)
    radii = repeat_border(defocus, reach)
    viewport = Viewport(height=height, width=width, left=-reach, top=-reach)
    values = torch.cat([light, torch.ones_like(light[..., :1])], -1)
    if image.is_cuda:
        sums = torch_levels.scatter_sums(values, radii, aperture, viewport)
    else:
        sums = scatter_sums(values, radii, scatter_operator(aperture), viewport)
    weight = sums[..., -1:]
    lit = weight > 0
    bokeh = torch.where(lit, sums[..., :-1] / torch.where(lit, weight, torch.ones_like(weight)), light)
    return bokeh[reach : reach + height, reach : reach + width]
