"""Machine code of the kernels, compiled when a wheel is built, so that the first render does not compile.

In: calls of kernels with NumPy arrays, numbers, tuples and ``None``. Out: the same results as from numba.

``machine_code/kernels.bin`` contains the object files that numba compiles for the kernels and argument types
that the commands of the package use; ``machine_code/kernels.json`` is the manifest. The build of a wheel
(``hatch_build.py``, ``tools/kernel_library.py``) writes both; they are never in git. If they are missing or
do not fit (another system, processor or version of Python or numba, other types, edited code), numba compiles
at the first call.

Open first: ``kernel.py``, then ``library.py``, ``code_key.py`` and ``machine.py``.
"""
