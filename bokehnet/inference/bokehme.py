"""BokehMe's neural half as published: adaptive resizing, iterative upsampling and fusion.

The formulas are written once, on operators, for training (torch), for the baseline ``bokehme`` (NumPy) and
for its file (ONNX graph). They work on encoded pictures, ``light ** (1 / gamma)``, as the paper does. Not
published, and so chosen here: the filter of :func:`resize_matrix`, sizes rounded to even numbers, the feather
of :func:`refinement_mask`, and the shape of the highlight weighting.

Source:
    Peng et al., "BokehMe: When neural rendering meets classical rendering", CVPR 2022.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bokehnet.arrays.fusion import fuse
from bokehnet.checks import Array, array_namespace

__all__ = [
    "DISPLAY_GAMMA",
    "GAMMA_RANGE",
    "UNIT_PX",
    "BokehMeResult",
    "CoarseNetwork",
    "RefineNetwork",
    "dilated_radius",
    "highlight_gain",
    "normalised_gamma",
    "refine_to_full_size",
    "refinement_mask",
    "render_bokehme",
    "resize",
    "resize_matrix",
]

# Largest blur radius at ARNet's working size, pixels.
UNIT_PX = 10.0

# Range of the gamma input.
GAMMA_RANGE = (1.0, 5.0)

# Exponent between the encoded pictures of the paper and scene-linear light.
DISPLAY_GAMMA = 2.2

# Distance in pixels by which a disc may miss a pixel's centre: the largest radius is a whole number.
_TIE_PX = 0.01

# Blur radii in pixels between which the refined picture fades out, around ``UNIT_PX``.
_FEATHER_PX = 2.0

# Encoded value above which light counts as a highlight, the slopes of the two soft steps, and the gain.
_HIGHLIGHT_VALUE, _HIGHLIGHT_SLOPE, _BLUR_SLOPE, _HIGHLIGHT_GAIN = 0.86, 10.0, 2.0, 0.4


class CoarseNetwork(Protocol):
    """ARNet, as a torch module or an ONNX session."""

    def __call__(self, image: Array, defocus: Array, gamma: Array, /) -> tuple[Array, Array]:
        """Return encoded bokeh (B, 3, H, W) and error map (B, 1, H, W)."""
        ...


class RefineNetwork(Protocol):
    """IUNet, as a torch module or an ONNX session."""

    def __call__(self, image: Array, defocus: Array, coarse: Array, gamma: Array, /) -> Array:
        """Return encoded bokeh (B, 3, H, W) from the one at half the size."""
        ...


def normalised_gamma(gamma: Array) -> Array:
    """Return a gamma as the networks receive it, in [0, 1]."""
    low, high = GAMMA_RANGE
    return (gamma - low) / (high - low)


def highlight_gain(encoded: Array, defocus: Array) -> Array:
    """Return the factor that the highlight weighting applies to an encoded picture before the scatter.

    Clipped lights are too dark in 8-bit pictures; blurred ones above a threshold are raised by up to 40 %.

    Args:
        encoded: Encoded picture, (..., 3, H, W).
        defocus: Signed blur radius in pixels, broadcastable against it.
    """
    xp = array_namespace(encoded)
    bright = xp.tanh(((encoded - _HIGHLIGHT_VALUE) * _HIGHLIGHT_SLOPE).clip(min=0))
    return 1 + _HIGHLIGHT_GAIN * bright * xp.tanh(abs(defocus) * _BLUR_SLOPE)


def resize_matrix(out_positions: Array, in_positions: Array, scale: Array, width: Array) -> Array:
    """Return weights (n, m) of a resize by the triangle filter, widened when it shrinks.

    Args:
        out_positions: Indices of the output pixels, (n, 1), float.
        in_positions: Indices of the input pixels, (1, m), float.
        scale: Input pixels per output pixel.
        width: Half-width of the filter in input pixels: the larger of ``scale`` and 1.

    Returns:
        Weights; rows do not sum to 1 yet. Enlarged, this is bilinear interpolation.
    """
    centers = (out_positions + 0.5) * scale - 0.5
    return (1 - abs(centers - in_positions) / width).clip(min=0)


def _weights(size: int, old_size: int, like: Array) -> Array:
    rows, columns = np.arange(size, dtype=np.float32)[:, None], np.arange(old_size, dtype=np.float32)[None]
    scale = old_size / size
    matrix = resize_matrix(rows, columns, scale, max(scale, 1.0))
    matrix = np.asarray(matrix / matrix.sum(1, keepdims=True), np.float32)
    return matrix if array_namespace(like) is np else like.new_tensor(matrix)


def resize(x: Array, height: int, width: int) -> Array:
    """Resize (..., H, W) to (..., height, width): bilinear, with a wider filter where it shrinks."""
    if x.shape[-2:] == (height, width):
        return x
    columns = _weights(width, x.shape[-1], x)
    return _weights(height, x.shape[-2], x) @ (x @ array_namespace(x).swapaxes(columns, 0, 1))


def dilated_radius(shifted: Callable[[int, int], Array], reach: int) -> Array:
    """Return the largest blur radius among the discs that cover each pixel.

    Args:
        shifted: Function of an offset (rows, columns) that returns |defocus| moved by it, 0 outside.
        reach: Largest radius in pixels.
    """
    result = shifted(0, 0)
    xp = array_namespace(result)
    for row in range(-reach, reach + 1):
        for column in range(-reach, reach + 1):
            distance = math.hypot(row, column)
            if 0 < distance <= reach:
                neighbour = shifted(row, column)
                result = xp.maximum(result, xp.where(neighbour > distance - _TIE_PX, neighbour, 0.0))
    return result


def refinement_mask(radius: Array) -> Array:
    """Return the weight of the refined picture: 1 below one unit of blur, feathered to 0.

    Args:
        radius: :func:`dilated_radius` in pixels of this size.
    """
    return ((UNIT_PX - radius) / _FEATHER_PX + 0.5).clip(min=0, max=1)


def even(x: float) -> int:
    """Return the nearest even whole number, at least 2."""
    return 2 * max(1, round(0.5 * x))


@dataclass(frozen=True, kw_only=True, slots=True)
class BokehMeResult:
    """Neural half and fusion, encoded.

    Attributes:
        bokeh: Fusion, (B, 3, H, W).
        neural: Picture of the networks, (B, 3, H, W).
        error_map: (B, 1, H, W) in [0, 1].
        steps: Pictures of ARNet and of each step of IUNet, coarse to fine.
    """

    bokeh: Array
    neural: Array
    error_map: Array
    steps: list[Array]


def _zero_padded_window(radius: np.ndarray, reach: int) -> Callable[[int, int], np.ndarray]:
    height, width = radius.shape[-2:]
    margin = [(0, 0)] * (radius.ndim - 2) + [(reach, reach)] * 2
    padded = np.pad(radius, margin)

    def shifted(row: int, column: int) -> np.ndarray:
        return padded[..., reach + row : reach + row + height, reach + column : reach + column + width]

    return shifted


def coarse_dilation(defocus: np.ndarray) -> np.ndarray:
    """Return :func:`dilated_radius` of a defocus map (..., h, w) at ARNet's size."""
    reach = int(UNIT_PX)
    return np.asarray(dilated_radius(_zero_padded_window(abs(defocus), reach), reach), np.float32)


def refine_to_full_size(
    iunet: RefineNetwork, image: Array, defocus: Array, gamma: Array, coarse: Array, dilated: Array
) -> list[Array]:
    """Double ``coarse`` until it has the size of ``image``; return the picture of every step.

    Args:
        iunet: Refining network.
        image: Encoded picture, (B, 3, H, W), even sides.
        defocus: Signed blur radius in pixels, (B, 1, H, W).
        gamma: Normalised gamma, (B, 1, 1, 1).
        coarse: Picture of ARNet, (B, 3, h, w).
        dilated: Dilated blur radius in pixels of ARNet's size, (B, 1, h, w).
    """
    full, size = tuple(image.shape[-2:]), tuple(coarse.shape[-2:])
    start, steps = size, []
    while size != full:
        size = tuple(
            whole if 2 * side >= whole else even(2 * side) for side, whole in zip(size, full, strict=True)
        )
        ratio = size[0] / full[0]
        half = resize(coarse, size[0] // 2, size[1] // 2)
        at_size = resize(image, *size), ratio * resize(defocus, *size)
        refined = iunet(*at_size, half, gamma)
        mask = refinement_mask(resize(dilated, *size) * (size[0] / start[0]))
        coarse = fuse(resize(coarse, *size), refined, mask)
        steps.append(coarse)
    return steps


def render_bokehme(
    image: Array,
    defocus: Array,
    classical: Array,
    gamma: Array,
    *,
    arnet: CoarseNetwork,
    iunet: RefineNetwork,
    dilate: Callable[[Array], Array] = coarse_dilation,
) -> BokehMeResult:
    """Render the neural half and fuse it with the classical one.

    Args:
        image: Encoded picture, (B, 3, H, W).
        defocus: Signed blur radius in pixels, (B, 1, H, W).
        classical: Encoded render of the scatter, (B, 3, H, W).
        gamma: Gamma of each picture in ``GAMMA_RANGE``, (B, 1, 1, 1).
        arnet: Coarse network.
        iunet: Refining network.
        dilate: Function that returns the dilated radius of a defocus map.
    """
    height, width = image.shape[-2:]
    padded = height + height % 2, width + width % 2
    image, defocus = (resize(x, *padded) for x in (image, defocus))
    factor = max(1.0, float(abs(defocus).max()) / UNIT_PX)
    size = (even(padded[0] / factor), even(padded[1] / factor)) if factor > 1 else padded
    small_defocus = resize(defocus, *size) / factor
    gamma = normalised_gamma(gamma)
    coarse, error_map = arnet(resize(image, *size), small_defocus, gamma)
    steps = [coarse, *refine_to_full_size(iunet, image, defocus, gamma, coarse, dilate(small_defocus))]
    neural, error_map = resize(steps[-1], height, width), resize(error_map, height, width)
    bokeh = fuse(classical, neural, error_map)
    return BokehMeResult(bokeh=bokeh, neural=neural, error_map=error_map, steps=steps)
