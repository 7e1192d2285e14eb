"""Machine code of the kernels, made ahead, so that the first picture waits for no compiler.

In: calls of kernels with NumPy arrays, numbers, tuples and ``None``. Out: what numba would have returned.

``kernels-CLASS-linux.so`` holds every kernel that the commands of the package run, for the types that they
run it with and for a class of processors; ``kernels-linux.json`` says which. It needs no version of
Python, NumPy or numba. Where nothing fits (another system, an older processor, other types, sources that have
changed since) numba compiles as ever. ``python -m benchmarks.precompile`` makes both files anew.

Open first: ``kernel.py``, then ``library.py``.
"""
