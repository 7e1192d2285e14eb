"""Conversion of pictures of other libraries to scene-linear arrays."""

import io
import sys
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bokehnet.checks import check_choice, check_image
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.io.color.srgb import srgb_to_linear
from bokehnet.io.files.buffers import is_buffer
from bokehnet.io.image import read_image

__all__ = ["as_image"]

Array = NDArray[np.float32]

_CHANNELS = (1, 3, 4)

# Largest value of integer types.
_WHITES = {"uint8": 255, "uint16": 65535}


def as_image(
    picture: Any,
    *,
    bgr: bool = False,
    transfer: Literal["auto", "srgb", "linear"] = "auto",
    layout: Literal["auto", "hwc", "chw"] = "auto",
) -> Array:
    """Return a picture of another library as scene-linear light, (H, W, 3), for ``make_scene``.

    Accepts pictures of PIL (with their colour profile), arrays of OpenCV, imageio and scikit-image, tensors
    of torch on any device, files, and encoded pictures as bytes or as a binary stream. Grey becomes three
    equal channels. Alpha is straight and is composited over black, in linear light, as by ``read_image``.

    Args:
        picture: PIL picture; array or tensor of shape (H, W), (H, W, C) or (C, H, W) with 1, 3 or 4 channels,
            or a batch of one; path; bytes or binary stream of an encoded picture.
        bgr: True if the channels are blue, green and red, as OpenCV returns them.
        transfer: Encoding of the values: "srgb" decodes, "linear" only scales integers to [0, 1]. "auto"
            decodes uint8 and uint16 as sRGB and takes floats as linear. Files and PIL know theirs.
        layout: Order of the axes. "auto" follows the number of channels; a tensor whose first and last axis
            could both be channels counts as (C, H, W).

    Raises:
        ParameterError: Integers of another type, NaN or infinity, floats of 0 to 255, or an ambiguous layout.
        ShapeError: The array has no such shape.
        ImageFileError: The encoded picture cannot be read.

    Examples:
        >>> codes = np.full((2, 4, 3), 188, np.uint8)
        >>> as_image(codes).round(2)[0, 0].tolist()  # scene-linear
        [0.5, 0.5, 0.5]
        >>> as_image(np.zeros((3, 20, 30), np.float32)).shape
        (20, 30, 3)
    """
    check_choice("transfer", transfer, ("auto", "srgb", "linear"))
    check_choice("layout", layout, ("auto", "hwc", "chw"))
    if isinstance(picture, str | Path) or is_buffer(picture):
        return read_image(picture)
    is_pil = hasattr(picture, "getbands") and hasattr(picture, "save")
    if is_pil and picture.info.get("icc_profile") and picture.mode in ("RGB", "RGBA", "L", "I;16"):
        return _by_file(picture)
    torch = sys.modules.get("torch")
    is_tensor = torch is not None and isinstance(picture, torch.Tensor)
    if is_pil:
        array = _pil_array(picture)
    elif is_tensor:
        array = picture.detach().cpu()
        array = (array.float() if array.dtype.is_floating_point else array).numpy()
    else:
        array = np.asarray(picture)
    array = _channels_last(array, layout, is_tensor)
    light = _linear(array, transfer)
    if bgr and light.shape[-1] >= 3:
        light = np.concatenate([light[..., 2::-1], light[..., 3:]], axis=-1)
    if light.shape[-1] == 4:
        light = light[..., :3] * light[..., 3:]
    if light.shape[-1] == 1:
        light = np.repeat(light, 3, axis=-1)
    light = np.ascontiguousarray(light, np.float32)
    check_image("picture", light)
    return light


def _pil_array(picture: Any) -> NDArray[Any]:
    """Return the code values of a PIL picture: 8 bits, or more where it has more."""
    if picture.mode in ("I", "I;16", "I;16B", "I;16L", "I;16N"):
        return np.asarray(picture).astype(np.uint16)
    if picture.mode in ("RGB", "RGBA", "L", "F"):
        return np.asarray(picture)
    has_alpha = picture.mode in ("LA", "PA", "La") or "transparency" in picture.info
    return np.asarray(picture.convert("RGBA" if has_alpha else "RGB"))


def _by_file(picture: Any) -> Array:
    """Return the light of a PIL picture with a colour profile, through the reader of files."""
    stream = io.BytesIO()
    picture.save(stream, "PNG", icc_profile=picture.info["icc_profile"], compress_level=0)
    return read_image(stream.getvalue())


def _channels_last(array: NDArray[Any], layout: str, is_tensor: bool) -> NDArray[Any]:
    """Return an array as (H, W, C)."""
    shape = array.shape
    if array.ndim == 4 and shape[0] == 1:
        array = array[0]
    if array.ndim == 2:
        array = array[..., None]
    if array.ndim != 3 or 0 in array.shape:
        expected = "(H, W), (H, W, C) or (C, H, W)"
        raise ShapeError(f"picture: expected shape {expected} with no empty side, got {shape}")
    first, last = array.shape[0] in _CHANNELS, array.shape[-1] in _CHANNELS
    if layout == "auto":
        if not (first or last):
            raise ShapeError(f"picture: expected 1, 3 or 4 channels, first or last, got shape {shape}")
        if first and last and not is_tensor and array.shape[0] != 1:
            raise ParameterError(
                "layout", "hwc or chw, as both axes of the picture could be channels", shown=str(shape)
            )
        layout = "chw" if first and (is_tensor or not last) else "hwc"
    if layout == "chw":
        array = np.moveaxis(array, 0, -1)
    if array.shape[-1] not in _CHANNELS:
        raise ShapeError(f"picture: expected 1, 3 or 4 channels, got {array.shape[-1]} of shape {shape}")
    return array


def _linear(array: NDArray[Any], transfer: str) -> Array:
    """Return values as scene-linear float32; alpha, the fourth channel, is only scaled."""
    white = _WHITES.get(array.dtype.name)
    if array.dtype == bool:
        return array.astype(np.float32)
    if white is None and array.dtype.kind != "f":
        raise ParameterError(
            "picture",
            "uint8, uint16 or floating-point numbers",
            shown=f"an array of {array.dtype}",
            remedy="divide it by the value of white",
        )
    values = array.astype(np.float32) if white is None else array / np.float32(white)
    if white is None and transfer != "linear" and 2 < values.max() <= 65535 and not np.any(values % 1):
        raise ParameterError(
            "picture",
            "floats with white at 1",
            shown=f"whole numbers up to {values.max():g}",
            remedy='divide it by the value of white, or set transfer="linear" if it is linear light',
        )
    if transfer == "srgb" or (transfer == "auto" and white is not None):
        values = np.concatenate([srgb_to_linear(values[..., :3]), values[..., 3:]], axis=-1)
    return np.asarray(values, np.float32)
