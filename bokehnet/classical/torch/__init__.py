"""Scatter with gradients and on CUDA devices; the only part of the classical renderers that needs torch.

In: tensors, image (H, W, C) and signed defocus in pixels (H, W). Out: the same values as ``scatter`` returns
for arrays, once differentiable.

Open first: ``autograd.py``, the public functions. On the CPU they call the numba kernels of ``scatter`` and
their adjoints. On other devices ``pyramid_levels.py`` computes the pyramid, ``span_scatter.py`` one level by
differences along rows; ``scanline_spans.py`` lists the spans of all sources and ``cats_eye.py`` clips them.

No other package of ``classical`` imports torch, so one line of the import contracts suffices.
"""
