"""SIMD helpers for numba kernels: eight numbers, or four, in one register.

Purpose: inner loops that the compiler does not vectorise by itself.
In: contiguous arrays and scalars of a kernel. Out: vectors (``Float8``, ``Mask8``, ``Double4``) that exist in
registers inside a kernel only, and functions on them; independent of pictures and light.

Open first: ``float8.py``, eight adjacent pixels or rays and masks of them. ``double4.py`` has the four
float64 channels of a pixel.

Imports nothing else of the package.
"""
