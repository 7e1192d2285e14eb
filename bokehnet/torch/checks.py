"""Checks of tensors at the public functions; each error states expected, actual and remedy in one line."""

import torch
from torch import Tensor

from bokehnet.checks import check_rank
from bokehnet.errors import ParameterError, ShapeError

__all__ = ["check_map", "check_picture", "compute_dtype"]

_DTYPES = (torch.float64, torch.float32, torch.float16, torch.bfloat16)


def check_picture(name: str, picture: Tensor) -> None:
    """Raise an error unless a tensor is a floating-point (B, C, H, W).

    Raises:
        ShapeError: Another number of axes, or an empty axis.
        ParameterError: No tensor, or another dtype.
    """
    if not isinstance(picture, Tensor):
        raise ParameterError(
            name, "a torch tensor", shown=type(picture).__name__, remedy="torch.from_numpy converts arrays"
        )
    check_rank(name, picture, 4, "(B, C, H, W)")
    if 0 in picture.shape:
        raise ShapeError(f"{name}: expected (B, C, H, W) without empty axes, got {tuple(picture.shape)}")
    if picture.dtype not in _DTYPES:
        raise ParameterError(
            name, "a floating-point dtype", shown=str(picture.dtype), remedy="convert with .float()"
        )


def check_map(name: str, values: Tensor, picture: Tensor, channels: int = 1) -> None:
    """Raise an error unless a tensor is (B, channels, H, W) like a picture, on its device.

    Raises:
        ShapeError: Another shape.
        ParameterError: No tensor, another dtype, or another device.
    """
    check_picture(name, values)
    expected = (len(picture), channels, *picture.shape[2:])
    if tuple(values.shape) != expected:
        raise ShapeError(f"{name}: expected {expected} to fit the image, got {tuple(values.shape)}")
    if values.device != picture.device:
        raise ParameterError(
            name,
            f"a tensor on {picture.device} like the image",
            shown=str(values.device),
            remedy="move it with .to(image.device)",
        )


def compute_dtype(*tensors: Tensor) -> torch.dtype:
    """Return the dtype for positions and sums: float64 if any tensor has it, else float32."""
    is_double = any(tensor.dtype == torch.float64 for tensor in tensors)
    return torch.float64 if is_double else torch.float32
