"""The rays on a CUDA device, by numba; the scatter there is that of ``classical.torch``.

In and out: what :mod:`bokehnet.classical.rays_renderer` takes and gives. Each thread follows the rays of one
pixel, by the walk of :mod:`bokehnet.classical.layered.march.intersection` for one ray in place of eight.

Open first: ``renderers.py``. ``ray_walk.py`` holds the walk in the part of Python that numba compiles for CPU
and device alike, so that it is tested where there is no device; ``march.py`` sends it there.
"""
