"""Decorator of kernels: precompiled machine code of the package, or numba with its cache and threads.

Every kernel of the package is decorated with :func:`njit` of this module, which has the options of
``numba.njit``.
"""

import logging
import multiprocessing
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
from numba.core.caching import FunctionCache

from bokehnet.precompiled.kernel import Kernel

__all__ = ["njit", "uncached_dispatcher"]

_log = logging.getLogger(__name__)

# GNU OpenMP, the default of numba, ends processes that were forked after a parallel kernel has run.
if numba.config.THREADING_LAYER == "default":  # type: ignore[attr-defined]
    numba.config.THREADING_LAYER = "forksafe"  # type: ignore[attr-defined]


def njit(function: Callable | None = None, *, cache: bool = False, **options: Any) -> Any:
    """Return a kernel: precompiled (:mod:`bokehnet.precompiled`), or compiled at its first call.

    Args:
        function: Function in the subset of Python that ``numba.njit`` supports.
        cache: True to store the machine code on disk for other processes. If no folder is writable, one
            warning is logged; without a logging configuration it appears on stderr.
        options: Options of ``numba.njit``.
    """
    if function is None:
        return partial(njit, cache=cache, **options)
    return Kernel(function, options, partial(_dispatcher, function, cache, options))


def uncached_dispatcher(kernel: Kernel) -> Any:
    """Return a numba dispatcher without cache files that only other kernels can call."""
    options: dict[str, Any] = kernel.options | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(**options)(kernel.function)


def _dispatcher(function: Callable, cache: bool, options: dict[str, Any]) -> Any:
    """Return the numba dispatcher of a function, with our cache."""
    dispatcher = numba.njit(**options)(function)
    if cache and hasattr(dispatcher, "enable_caching"):  # not with NUMBA_DISABLE_JIT
        try:
            dispatcher._cache = _Cache(function)
        except (RuntimeError, OSError):  # raised by numba if no folder is writable
            _warn_once("no folder for them can be written")
    return dispatcher


class _Cache(FunctionCache):  # type: ignore[misc]
    """Cache files of numba; missing or damaged files cause a new compilation."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the cached kernel for these types, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # damaged files make pickle and LLVM raise any exception
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the kernel for these types if possible."""
        try:
            try:
                super().save_overload(sig, data)
            except OSError:
                raise
            except Exception:  # a damaged index
                self.flush()
                super().save_overload(sig, data)
        except OSError as error:  # a full disk, a folder that is gone
            self.disable()
            _warn_once(error.strerror or str(error))


_has_warned = False


def _warn_once(reason: str) -> None:
    global _has_warned
    if not _has_warned and multiprocessing.parent_process() is None:  # the parent process logs the warning
        _log.warning(
            "bokehnet: compiled kernels cannot be kept (%s), so each program compiles them anew, which may "
            "take minutes; set NUMBA_CACHE_DIR to a folder that can be written",
            reason,
        )
    _has_warned = True
