"""Bokeh without occlusion as torch operations: every pixel is spread over its disc, sums are normalised."""

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from bokehnet.checks import check_whole
from bokehnet.classical.torch import autograd
from bokehnet.classical.torch.border import beyond_border, continuation_px, repeat_border
from bokehnet.optics.aperture import Aperture
from bokehnet.torch.aperture import PupilSamples, SmoothAperture, pupil_samples, vignetting_weight
from bokehnet.torch.checks import check_map, check_picture, compute_dtype
from bokehnet.torch.gradient_checks import watch_input, watch_output
from bokehnet.torch.occlusion import pupil_sets

__all__ = ["scatter"]

# Pixels times samples per block, which bounds the memory.
_POINTS_PER_BLOCK = 1 << 18

_EPSILON = 1e-6


def _splat(
    values: Tensor, defocus: Tensor, pupil: PupilSamples, sets: Tensor, samples: slice, margin: int
) -> Tensor:
    """Return the sums (C + 1, H, W) of values (C + 1, H, W) that some samples move by ``defocus * a``.

    The ``margin`` pixels on each side are outside the picture, from whose centre a cat's-eye is measured.
    """
    height, width = defocus.shape
    u, v = (axis[:, samples][sets].movedim(-1, 0) for axis in pupil.points)
    front, back = (side[:, samples][sets].movedim(-1, 0) for side in pupil.weights)
    y = torch.arange(height, device=defocus.device).to(u)[:, None].expand(height, width)
    x = torch.arange(width, device=defocus.device).to(u)[None, :].expand(height, width)
    weight = torch.where(defocus > 0, front, back)
    if pupil.cats_eye is not None:
        weight = weight * vignetting_weight(
            pupil, u, v, (x - margin, y - margin), (height - 2 * margin, width - 2 * margin)
        )
    to_x, to_y = x + defocus * u, y + defocus * v
    left, top = to_x.detach().floor(), to_y.detach().floor()
    flat = values.flatten(1)
    sums = torch.zeros_like(flat)
    for i, share_y in ((0, 1 - (to_y - top)), (1, to_y - top)):
        for j, share_x in ((0, 1 - (to_x - left)), (1, to_x - left)):
            row, column = top + i, left + j
            inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
            share = torch.where(inside, weight * share_x * share_y, 0.0)
            index = torch.where(inside, row * width + column, 0.0).long()
            light = share.flatten(1)[None] * flat[:, None]
            sums = sums.index_add(1, index.flatten(), light.flatten(1))
    return sums.view_as(values)


def _sampled(image: Tensor, defocus: Tensor, pupil: PupilSamples, sets: Tensor, margin: int) -> Tensor:
    """Return the scatter of one picture (C, H, W) by samples of the pupil, without its margin."""
    values = torch.cat([image, torch.ones_like(image[:1])])
    step = max(1, _POINTS_PER_BLOCK // defocus.numel())
    sums = torch.zeros_like(values)
    for begin in range(0, pupil.points.shape[2], step):
        arguments = (values, defocus, pupil, sets, slice(begin, begin + step), margin)
        if torch.is_grad_enabled():  # recompute in the backward pass
            sums = sums + checkpoint(_splat, *arguments, use_reentrant=False)
        else:
            sums = sums + _splat(*arguments)
    weight = sums[-1:]
    bokeh = torch.where(weight > _EPSILON, sums[:-1] / weight.clamp(min=_EPSILON), image)
    height, width = defocus.shape
    return bokeh[:, margin : height - margin, margin : width - margin]


def scatter(
    image: Tensor,
    defocus: Tensor,
    aperture: Aperture | SmoothAperture | None = None,
    *,
    samples: int = 128,
    seed: int = 0,
) -> Tensor:
    r"""Render bokeh by spreading every pixel over its disc, without occlusion.

    Fixed apertures use the exact discs of :func:`bokehnet.classical.torch.autograd.scatter`, once
    differentiable. A :class:`SmoothAperture` is sampled, with gradients of any order, also for its numbers,
    and under ``torch.func.vmap``. The computation is in float32, in float64 if an input has it.

    Args:
        image: Scene-linear colours with shape :math:`(B, C, H, W)`.
        defocus: Signed blur radius in pixels, positive in front of focus, with shape :math:`(B, 1, H, W)`.
        aperture: Fixed aperture, or one with gradients; default: a disc.
        samples: Pupil samples per pixel of a smooth aperture, 1 to 128.
        seed: Seed of the samples' noise.

    Returns:
        Bokeh with shape :math:`(B, C, H, W)`, in the dtype of ``image``. Pictures continue beyond their
        border as in every engine, see :mod:`bokehnet.arrays.beyond_border`.

    Raises:
        ShapeError: Sizes do not fit.
        ParameterError: Another dtype or device, or a parameter out of range.

    Examples:
        >>> image, defocus = torch.rand(2, 3, 9, 12), torch.full((2, 1, 9, 12), 3.0)
        >>> scatter(image, defocus, SmoothAperture(blades=6)).shape
        torch.Size([2, 3, 9, 12])
    """
    check_picture("image", image)
    check_map("defocus", defocus, image)
    check_whole("seed", seed, 0)
    dtype = compute_dtype(image, defocus)
    pictures = watch_input("scatter", "image", image).to(dtype)
    radii = watch_input("scatter", "defocus", defocus).to(dtype)[:, 0]
    if isinstance(aperture, SmoothAperture):
        pupil = pupil_samples(aperture, samples, radii)
        reach = continuation_px(radii)
        height, width = (side + 2 * reach for side in image.shape[2:])
        sets = pupil_sets(height, width, pupil.points.shape[1], seed, image.device)
        results = [
            _sampled(beyond_border(picture, reach), repeat_border(radius, reach), pupil, sets, reach)
            for picture, radius in zip(pictures, radii, strict=True)
        ]
    else:
        results = [
            autograd.scatter(picture.movedim(0, 2), radius, aperture).movedim(2, 0)
            for picture, radius in zip(pictures, radii, strict=True)
        ]
    return watch_output("scatter", torch.stack(results).to(image.dtype))
