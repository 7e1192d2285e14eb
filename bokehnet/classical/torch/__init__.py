"""All of the classical renderers that needs torch: the scatter with gradients, and on CUDA devices.

In: tensors, image (H, W, C) and signed defocus in pixels (H, W). Out: the same numbers as ``scatter`` gives
for arrays, once differentiable.

Open first: ``autograd.py``, the public functions; on the CPU they call the numba kernels of ``scatter`` and
their adjoints. On other devices ``pyramid_levels.py`` does the levels, ``span_scatter.py`` one level by
differences along rows, ``scanline_spans.py`` lists the spans of all sources, ``cats_eye.py`` clips them.

The only room of ``classical`` that imports torch, so one line of the import contracts is enough.
"""
