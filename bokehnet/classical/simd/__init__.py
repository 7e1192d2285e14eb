"""SIMD helpers for numba kernels: eight numbers, or four, in one register.

For: inner loops that the compiler does not turn into vector instructions by itself.
In: contiguous arrays and scalars of a kernel. Out: vectors (``Float8``, ``Mask8``, ``Double4``) that live in
registers inside of a kernel only, and functions on them; nothing here knows pictures or light.

Open first: ``float8.py``, eight neighbouring pixels or rays and masks of them. ``double4.py`` holds the four
float64 channels of a pixel.

Imports nothing else of the package.
"""
