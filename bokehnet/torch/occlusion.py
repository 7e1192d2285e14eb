"""Bokeh with occlusion as torch operations: pupil rays through the picture and its hidden layers.

For each pupil sample, rays search for a surface in every slab of the defocus, without gradients
(:mod:`bokehnet.pupil_rays`). At the surface, defocus, colour and coverage of the four pixels around the ray
are interpolated, members of the slab only, and composited front to back by coverage. Colours, coverage and
hidden layers thus have gradients, and so has the defocus: it moves the surfaces under the ray, their outlines
included. Positions of the search are constant between two pixels, so derivatives are exact almost everywhere.

The authority is :func:`bokehnet.classical.rays_renderer.rays` with the same layers, samples and seed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from bokehnet.checks import check_whole
from bokehnet.classical.layered import layers as numba_layers
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture
from bokehnet.pupil_rays import TILE, Slab, find_surface, is_inside
from bokehnet.torch.aperture import PupilSamples, SmoothAperture, pupil_samples, vignetting_weight
from bokehnet.torch.checks import check_map, check_picture, compute_dtype
from bokehnet.torch.gradient_checks import watch_input, watch_output
from bokehnet.torch.slabs import find_slabs
from bokehnet.torch.window_means import GROUPS, SHARP_RADIUS_PX, average_windows

__all__ = ["Background", "layered", "pupil_sets", "split_layers"]

# Hidden layers, front to back: colours (B, C, H, W) and signed defocus (B, 1, H, W) of each.
Background = Sequence[tuple[Tensor, Tensor]]

# Number of slabs, and of rays per block: a block needs about 1 kB a ray with gradients.
_SLABS = 6
_RAYS_PER_BLOCK = 1 << 18

_SETS = 9
_EPSILON = 1e-6


class _Tables(NamedTuple):
    """Layers of all pixels as rows, (B H W, L) each; colours are (B H W, L, C)."""

    colors: Tensor
    defocus: Tensor
    coverage: Tensor


class _Job(NamedTuple):
    """Inputs of all blocks: layers, slabs by tile (B T, slabs, 4), pupil, and picture size."""

    tables: _Tables
    slabs: Tensor
    pupil: PupilSamples
    size: tuple[int, int]


def pupil_sets(height: int, width: int, count: int, seed: int, device: torch.device) -> Tensor:
    """Return the set of pupil samples of each pixel, (H, W), as the numba rays with this seed use it.

    The hash is that of :func:`bokehnet.classical.layered.march.ray_marching.scramble`.
    """
    mask = 0xFFFFFFFF
    y = torch.arange(height, device=device)[:, None]
    x = torch.arange(width, device=device)[None, :]
    h = ((x * 0x9E3779B1) ^ (y * 0x85EBCA77) ^ (seed * 0xC2B2AE3D & mask)) & mask
    h = h ^ (h >> 15)
    h = h * 0x2C1B3C6D & mask
    h = h ^ (h >> 12)
    h = h * 0x297A2D39 & mask
    h = h ^ (h >> 15)
    return h % (count // _SETS) * _SETS + y % 3 * 3 + x % 3


def _surface_at(tables: _Tables, index: Tensor, weight: Tensor, slab: Slab) -> tuple[Tensor, Tensor, Tensor]:
    """Return weighted coverage, defocus and colour of the layers in a slab, at pixels ``index``."""
    defocus, coverage = tables.defocus[index], tables.coverage[index]
    remaining, shares = weight, []
    for layer in range(defocus.shape[-1]):
        share = torch.where(is_inside(slab, defocus[..., layer]), remaining * coverage[..., layer], 0.0)
        remaining = remaining - share
        shares.append(share)
    stacked = torch.stack(shares, -1)
    color = (stacked[..., None] * tables.colors[index]).sum(-2)
    return stacked.sum(-1), (stacked * defocus).sum(-1), color


def _trace_block(job: _Job, pixels: Tensor, sets: Tensor, samples: slice) -> Tensor:
    """Return the sums over some samples of the rays of some pixels, (pixels, GROUPS, C + 2)."""
    tables, pupil = job.tables, job.pupil
    height, width = job.size
    start = pixels // (height * width) * (height * width)
    row, column = (pixels - start) // width, pixels % width
    tiles_down, tiles_across = -(-height // TILE), -(-width // TILE)
    tile = (start // (height * width) * tiles_down + row // TILE) * tiles_across + column // TILE
    slabs = job.slabs[tile]
    u, v = (axis[:, samples][sets].T for axis in pupil.points)
    front_weight, back_weight = (side[:, samples][sets].T for side in pupil.weights)
    x, y = (axis.to(u).expand_as(u) for axis in (column, row))
    if pupil.cats_eye is not None:
        passed = vignetting_weight(pupil, u, v, (x, y), job.size)
        front_weight, back_weight = front_weight * passed, back_weight * passed

    def index_at(column: Tensor, row: Tensor) -> Tensor:
        inside = row.clamp(0, height - 1) * width + column.clamp(0, width - 1)
        return start + inside.long()

    def defocus_at(column: Tensor, row: Tensor) -> Sequence[Tensor]:
        return tables.defocus[index_at(column.round(), row.round())].unbind(-1)

    transmitted = torch.ones_like(u)
    sums = [u.new_zeros(()) for _ in range(GROUPS)]
    for number in range(slabs.shape[1]):
        slab = Slab(*slabs[:, number].unbind(-1))
        s = find_surface(defocus_at, (x, y), (u, v), slab)
        to_x, to_y = x - s * u, y - s * v
        left, top = to_x.detach().floor(), to_y.detach().floor()
        part_x, part_y = to_x - left, to_y - top
        alpha, depth, color = u.new_zeros(()), u.new_zeros(()), u.new_zeros(())
        for i, share_y in ((0, 1 - part_y), (1, part_y)):
            for j, share_x in ((0, 1 - part_x), (1, part_x)):
                parts = _surface_at(tables, index_at(left + j, top + i), share_x * share_y, slab)
                alpha, depth, color = alpha + parts[0], depth + parts[1], color + parts[2]
        is_met = alpha > _EPSILON
        depth = torch.where(is_met, depth / alpha.clamp(min=_EPSILON), 0.0)
        side = torch.where(depth > 0, front_weight, back_weight) * transmitted
        transmitted = transmitted * (1 - alpha)
        radius = depth.abs()
        weight = side * alpha
        numbers = torch.cat(
            [side[..., None] * color, torch.stack([weight, weight / radius.clamp(min=SHARP_RADIUS_PX)], -1)],
            -1,
        )
        is_sharp = radius < SHARP_RADIUS_PX
        members = (~is_sharp & (depth > 0), is_sharp, ~is_sharp & (depth <= 0))
        sums = [
            total + torch.where(member[..., None], numbers, 0.0).sum(0)
            for total, member in zip(sums, members, strict=True)
        ]
    return torch.stack(sums, 1)


def _trace(job: _Job, sets: Tensor) -> Tensor:
    """Return the sums over all rays, (B H W, GROUPS, C + 2), block by block."""
    count, samples = len(job.tables.defocus), job.pupil.points.shape[2]
    pixels_per_block = min(count, _RAYS_PER_BLOCK)
    samples_per_block = max(1, _RAYS_PER_BLOCK // pixels_per_block)
    needs_gradients = torch.is_grad_enabled()
    blocks = []
    for first in range(0, count, pixels_per_block):
        pixels = torch.arange(first, min(count, first + pixels_per_block), device=sets.device)
        sums_of_samples = []
        for begin in range(0, samples, samples_per_block):
            arguments = (job, pixels, sets[pixels], slice(begin, begin + samples_per_block))
            if needs_gradients:  # recompute in the backward pass, so that one block's tensors are in memory
                sums = checkpoint(_trace_block, *arguments, use_reentrant=False)
            else:
                sums = _trace_block(*arguments)
            sums_of_samples.append(sums)
        blocks.append(torch.stack(sums_of_samples).sum(0))
    return torch.cat(blocks)


def layered(
    image: Tensor,
    defocus: Tensor,
    background: Background = (),
    coverage: Tensor | None = None,
    aperture: Aperture | SmoothAperture | None = None,
    *,
    samples: int = 32,
    seed: int = 0,
) -> Tensor:
    r"""Render bokeh with occlusion: foregrounds are translucent, sharp subjects keep clean edges.

    Rays see the picture and, behind its depth edges, the hidden layers; without ``background`` they see only
    the picture. The computation is in float32, in float64 if an input has it; autocast does not change it.

    Args:
        image: Scene-linear colours of the first layer with shape :math:`(B, C, H, W)`.
        defocus: Signed blur radius in pixels, positive in front of focus, with shape :math:`(B, 1, H, W)`.
        background: Colours :math:`(B, C, H, W)` and defocus :math:`(B, 1, H, W)` of each hidden layer, front
            to back; :func:`split_layers` estimates them. A hidden layer equals the picture where nothing is
            hidden.
        coverage: Fraction of the pixel that the first layer covers, :math:`(B, 1, H, W)` in [0, 1]; default:
            1.
        aperture: Fixed aperture, or one with gradients; default: a disc.
        samples: Pupil samples per pixel, 1 to 128; the 3x3 pixels of a block use different ones.
        seed: Seed of the noise.

    Returns:
        Bokeh with shape :math:`(B, C, H, W)`, in the dtype of ``image``.

    Raises:
        ShapeError: Sizes do not fit.
        ParameterError: Another dtype or device, or a parameter out of range.

    Source:
        Lee, Eisemann and Seidel, "Real-time lens blur effects and focus control", ACM TOG 2010.

    Examples:
        >>> image, defocus = torch.rand(1, 3, 24, 32), torch.full((1, 1, 24, 32), 3.0)
        >>> layered(image, defocus).shape
        torch.Size([1, 3, 24, 32])
    """
    check_picture("image", image)
    check_map("defocus", defocus, image)
    check_whole("seed", seed, 0)
    if coverage is None:
        coverage = torch.ones_like(defocus)
    check_map("coverage", coverage, image)
    colors, radii = [watch_input("layered", "image", image)], [watch_input("layered", "defocus", defocus)]
    coverage = watch_input("layered", "coverage", coverage)
    for number, (hidden, behind) in enumerate(background, 1):
        check_map(f"background colours {number}", hidden, image, image.shape[1])
        check_map(f"background defocus {number}", behind, image)
        colors.append(watch_input("layered", f"background colours {number}", hidden))
        radii.append(watch_input("layered", f"background defocus {number}", behind))
    dtype = compute_dtype(*colors, *radii, coverage)
    batch, channels, height, width = image.shape
    stacked_colors = torch.stack([color.to(dtype) for color in colors], 1)
    stacked_radii = torch.cat([radius.to(dtype) for radius in radii], 1)
    stacked_coverage = torch.cat([coverage.to(dtype), torch.ones_like(stacked_radii[:, 1:])], 1)
    pupil = pupil_samples(aperture, samples, stacked_radii)
    slabs = find_slabs(stacked_radii, stacked_coverage, _SLABS)
    sets = pupil_sets(height, width, pupil.points.shape[1], seed, image.device)
    tables = _Tables(
        stacked_colors.permute(0, 3, 4, 1, 2).flatten(0, 2),
        stacked_radii.permute(0, 2, 3, 1).flatten(0, 2),
        stacked_coverage.permute(0, 2, 3, 1).flatten(0, 2),
    )
    job = _Job(tables, slabs.permute(0, 3, 4, 1, 2).flatten(0, 2), pupil, (height, width))
    sums = _trace(job, sets.flatten().repeat(batch)).view(batch, height, width, GROUPS, channels + 2)
    return watch_output("layered", average_windows(sums.permute(0, 3, 4, 1, 2) / samples).to(image.dtype))


def split_layers(image: Tensor, defocus: Tensor) -> tuple[Tensor, Tensor, Background, Tensor]:
    """Estimate the layers of pictures for :func:`layered`; without gradients, on the CPU.

    The estimate is that of :func:`bokehnet.classical.layered.layers.split_layers`.

    Args:
        image: Scene-linear colours with shape (B, 3, H, W).
        defocus: Signed blur radius in pixels with shape (B, 1, H, W).

    Returns:
        Colours and defocus of the first layer, hidden layers, and coverage of the first layer, in the dtype
        and on the device of ``image``.

    Raises:
        ShapeError: Sizes do not fit.
        ParameterError: Another dtype or device, or NaN.
    """
    check_picture("image", image)
    check_map("defocus", defocus, image)
    if image.shape[1] != 3:
        raise ParameterError("image", "3 channels", shown=str(image.shape[1]), remedy="pass red, green, blue")
    stacks = []
    for picture, radius in zip(image.detach().float().cpu(), defocus.detach().float().cpu(), strict=True):
        stacks.append(numba_layers.split_layers(picture.movedim(0, 2).numpy(), radius[0].numpy()))
    count = max(stack.defocus.shape[2] for stack in stacks)

    def layer(name: str, number: int) -> Tensor:
        arrays = [getattr(stack, name)[:, :, min(number, stack.defocus.shape[2] - 1)] for stack in stacks]
        tensor = torch.stack([torch.from_numpy(array.copy()) for array in arrays]).to(image)
        return tensor.movedim(3, 1) if name == "colors" else tensor[:, None]

    hidden = [(layer("colors", number), layer("defocus", number)) for number in range(1, count)]
    return layer("colors", 0), layer("defocus", 0), hidden, layer("coverage", 0)
