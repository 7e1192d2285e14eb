"""Samples where they are needed: pixels get the more of a tracer's samples the more theirs differ.

All pixels send ``_FIRST`` samples; then rounds of ``_BLOCK`` a pixel, in the mean, go where
:mod:`bokehnet.optics.pixels.sample_allocation` sends them. What counts is the variance of the luminance,
times the slope of the sRGB curve squared, which is noise as it is seen, and of the pixel and its neighbours
together: a pixel whose first samples agree by chance does not keep its error.

Source: Mitchell, "Generating antialiased images at low sampling densities", SIGGRAPH 1987; Kirk and Arvo,
"Unbiased sampling techniques for image synthesis", SIGGRAPH 1991, for the bias that counts bring which depend
on the samples themselves: here it is that of a round.
"""

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from bokehnet.optics.pixels.sample_allocation import Allocation, neyman
from bokehnet.raytrace.tracer import Accumulation, Tracer

__all__ = ["advance_adaptive"]

_FIRST, _BLOCK = 16, 8

_LUMINANCE = (0.2126, 0.7152, 0.0722)


@torch.no_grad()
def advance_adaptive(tracer: Tracer, so_far: Accumulation, allocation: Allocation = neyman) -> Accumulation:
    """Return ``so_far`` with another round of samples.

    Args:
        tracer: Of the same scene.
        so_far: From here, or from ``tracer.begin()``.
        allocation: Tells which pixels send them.
    """
    size = so_far.coverage.shape
    pixels = so_far.coverage.numel()
    device = so_far.coverage.device
    means = so_far.stacked().reshape(pixels, 7).clone()
    if so_far.counts is None or so_far.variance is None:
        counts = torch.zeros(pixels, dtype=torch.int64, device=device)
        variance = torch.zeros(pixels, device=device)
        blocks = torch.full_like(counts, _FIRST // _BLOCK)
    else:
        counts, variance = so_far.counts.flatten().clone(), so_far.variance.flatten().clone()
        seen = _visible(so_far.bokeh, so_far.variance)
        given = allocation(seen.flatten().cpu().numpy(), (counts // _BLOCK).cpu().numpy(), pixels)
        blocks = torch.from_numpy(given).to(device)
    while bool((blocks > 0).any()):
        waiting = (blocks > 0).nonzero()[:, 0]
        for start in counts[waiting].unique().tolist():
            for part, found in tracer.trace(waiting[counts[waiting] == start], start, _BLOCK):
                _add(means, variance, part, start, found)
        counts[waiting] += _BLOCK
        blocks[waiting] -= 1
    return Accumulation.from_stacked(
        means.reshape(*size, 7), int(counts.sum()) // pixels, counts.reshape(size), variance.reshape(size)
    )


def _add(means: Tensor, variance: Tensor, pixels: Tensor, start: int, found: Tensor) -> None:
    """Add samples ``found`` (S, Q, 7) to the means (P, 7) and variances (P,) of ``start`` samples.

    Source:
        Welford, "Note on a method for calculating corrected sums of squares and products", 1962.
    """
    weights = means.new_tensor(_LUMINANCE)
    for offset, values in enumerate(found):
        count = start + offset + 1
        before = means[pixels]
        after = before + (values - before) / count
        light = values[:, :3] @ weights
        square = (light - before[:, :3] @ weights) * (light - after[:, :3] @ weights)
        variance[pixels] += (square - variance[pixels]) / count
        means[pixels] = after


def _visible(light: Tensor, variance: Tensor) -> Tensor:
    """Variance (H, W) of one sample as it is seen, mean over a pixel and its neighbours."""
    mean = (light @ light.new_tensor(_LUMINANCE)).clamp(0, 1)
    slope = torch.where(mean <= 0.0031308, 12.92, 1.055 / 2.4 * mean.clamp_min(0.0031308) ** (1 / 2.4 - 1))
    seen = (slope**2 * variance)[None, None]
    return avg_pool2d(pad(seen, (1, 1, 1, 1), mode="replicate"), 3, 1)[0, 0]
