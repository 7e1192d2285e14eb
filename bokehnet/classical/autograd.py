"""The scatter as a torch operation, with gradients for the image and the defocus. Needs torch."""

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from bokehnet.checks import check_rank, check_same_size
from bokehnet.classical.kernels import scatter_backward, scatter_forward

__all__ = ["scatter"]


class _Scatter(torch.autograd.Function):
    """Bind the NumPy kernels to autograd. Zero-copy, so CPU tensors only."""

    @staticmethod
    def forward(ctx: Any, image: Tensor, defocus: Tensor) -> tuple[Tensor, Tensor]:
        ctx.save_for_backward(image, defocus)
        total, weight = scatter_forward(image.detach().numpy(), defocus.detach().numpy())
        return torch.from_numpy(total), torch.from_numpy(weight)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_total: Tensor, grad_weight: Tensor) -> tuple[Tensor, Tensor]:
        image, defocus = (tensor.detach().numpy() for tensor in ctx.saved_tensors)
        gradients: tuple[np.ndarray, np.ndarray] = scatter_backward(
            image, defocus, grad_total.numpy(), grad_weight.numpy()
        )
        return torch.from_numpy(gradients[0]), torch.from_numpy(gradients[1])


@torch.compiler.disable  # Dynamo cannot trace a Numba dispatcher
def scatter(image: Tensor, defocus: Tensor) -> Tensor:
    """Render bokeh by scattering; differentiable in both arguments, once.

    Args:
        image: Scene-linear colours, (H, W, C) on the CPU, float32 or float64.
        defocus: Signed blur radius in pixels, (H, W), of the same dtype. Where its magnitude is 0.5 or
            less the picture does not depend on it, and the gradient is 0.

    Returns:
        Picture (H, W, C).

    Raises:
        ShapeError: The sizes do not fit.
    """
    check_rank("image", image, 3, "(H, W, C)")
    check_rank("defocus", defocus, 2, "(H, W)")
    check_same_size("image", image, "defocus", defocus)
    total, weight = _Scatter.apply(image.contiguous(), defocus.contiguous())
    return total / weight[..., None]
