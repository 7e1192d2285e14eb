"""Adaptive sampling: pixels with a larger variance receive more samples.

Every pixel starts with ``_INITIAL_SAMPLES`` samples; then :mod:`bokehnet.optics.pixels.sample_allocation`
distributes rounds of ``_BLOCK_SAMPLES`` per pixel on average. The criterion is the variance of the luminance
times the squared slope of the sRGB curve, which is visible noise, averaged over the pixel and its neighbours,
so that a pixel whose first samples agree by chance does not keep its error.

Source: Mitchell, "Generating antialiased images at low sampling densities", SIGGRAPH 1987; Kirk and Arvo,
"Unbiased sampling techniques for image synthesis", SIGGRAPH 1991, for the bias of sample counts that depend
on the samples: here that of one round.
"""

import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from bokehnet.optics.pixels.sample_allocation import Allocation, neyman
from bokehnet.raytrace.tracer import Accumulation, Tracer

__all__ = ["advance_adaptive"]

_INITIAL_SAMPLES, _BLOCK_SAMPLES = 16, 8

_LUMINANCE = (0.2126, 0.7152, 0.0722)


@torch.no_grad()
def advance_adaptive(tracer: Tracer, state: Accumulation, allocation: Allocation = neyman) -> Accumulation:
    """Return ``state`` with another round of samples.

    Args:
        tracer: Tracer of the same scene.
        state: Result of an earlier round, or of ``tracer.begin()``.
        allocation: Rule that distributes the samples among the pixels.
    """
    size = state.coverage.shape
    pixels = state.coverage.numel()
    device = state.coverage.device
    means = state.stacked().reshape(pixels, 7).clone()
    if state.counts is None or state.variance is None:
        counts = torch.zeros(pixels, dtype=torch.int64, device=device)
        variance = torch.zeros(pixels, device=device)
        blocks = torch.full_like(counts, _INITIAL_SAMPLES // _BLOCK_SAMPLES)
    else:
        counts, variance = state.counts.flatten().clone(), state.variance.flatten().clone()
        noise = _visible_variance(state.bokeh, state.variance)
        allocated = allocation(
            noise.flatten().cpu().numpy(), (counts // _BLOCK_SAMPLES).cpu().numpy(), pixels
        )
        blocks = torch.from_numpy(allocated).to(device)
    while bool((blocks > 0).any()):
        pending = (blocks > 0).nonzero()[:, 0]
        for start in counts[pending].unique().tolist():
            for part, values in tracer.trace(pending[counts[pending] == start], start, _BLOCK_SAMPLES):
                _add(means, variance, part, start, values)
        counts[pending] += _BLOCK_SAMPLES
        blocks[pending] -= 1
    return Accumulation.from_stacked(
        means.reshape(*size, 7), int(counts.sum()) // pixels, counts.reshape(size), variance.reshape(size)
    )


def _add(means: Tensor, variance: Tensor, pixels: Tensor, start: int, samples: Tensor) -> None:
    """Add ``samples`` (S, Q, 7) to the means (P, 7) and variances (P,) of ``start`` samples.

    Source:
        Welford, "Note on a method for calculating corrected sums of squares and products", 1962.
    """
    weights = means.new_tensor(_LUMINANCE)
    for offset, sample in enumerate(samples):
        count = start + offset + 1
        before = means[pixels]
        after = before + (sample - before) / count
        light = sample[:, :3] @ weights
        square = (light - before[:, :3] @ weights) * (light - after[:, :3] @ weights)
        variance[pixels] += (square - variance[pixels]) / count
        means[pixels] = after


def _visible_variance(light: Tensor, variance: Tensor) -> Tensor:
    """Return the visible variance (H, W) of one sample, mean over a pixel and its neighbours."""
    mean = (light @ light.new_tensor(_LUMINANCE)).clamp(0, 1)
    slope = torch.where(mean <= 0.0031308, 12.92, 1.055 / 2.4 * mean.clamp_min(0.0031308) ** (1 / 2.4 - 1))
    visible = (slope**2 * variance)[None, None]
    return avg_pool2d(pad(visible, (1, 1, 1, 1), mode="replicate"), 3, 1)[0, 0]
