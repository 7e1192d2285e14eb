"""Machine code of the kernels, compiled when a wheel is built, so that no first picture waits for it.

In: calls of kernels with NumPy arrays, numbers, tuples and ``None``. Out: what numba would have returned.

``machine_code/kernels.bin`` holds the object files that numba makes of the kernels that the commands of the
package run, for the types that they run them with; ``kernels.json`` beside it is their manifest. Both are
made by the build of a wheel (``hatch_build.py``, ``tools/kernel_library.py``) and are never in git. Where
there are none or they do not fit (another system, processor or version of Python or numba, other types,
edited code), numba compiles at the first call.

Open first: ``kernel.py``, then ``library.py``, ``code_key.py`` and ``machine.py``.
"""
