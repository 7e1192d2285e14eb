"""Rays on a CUDA device, compiled by numba; the scatter on the device is that of ``classical.torch``.

In and out: as for :mod:`bokehnet.classical.rays_renderer`. Each thread traces the rays of one pixel by the
algorithm of :mod:`bokehnet.classical.layered.march.intersection`, one ray at a time instead of eight.

Open first: ``renderers.py``. ``ray_walk.py`` contains the algorithm in the subset of Python that numba
compiles for CPU and device, so that tests need no device; ``march.py`` launches it on the device.
"""
