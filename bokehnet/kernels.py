"""How kernels come to run: as machine code of the package, or by numba, with its cache and its threads.

Every kernel of the package is made by :func:`njit` of this module, which takes what numba's own takes.
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

# numba's first choice, GNU OpenMP, kills processes that were forked after a parallel kernel has run.
if numba.config.THREADING_LAYER == "default":  # type: ignore[attr-defined]
    numba.config.THREADING_LAYER = "forksafe"  # type: ignore[attr-defined]


def njit(function: Callable | None = None, *, cache: bool = False, **options: Any) -> Any:
    """Make a kernel of a function: precompiled (:mod:`bokehnet.precompiled`), or compiled at its first call.

    Args:
        function: In the part of Python that ``numba.njit`` takes.
        cache: Whether the machine code is kept for the next program, where a folder can be written. Where
            none can, one line says so, by ``logging``: on stderr unless the program wants it elsewhere.
        options: As numba's.
    """
    if function is None:
        return partial(njit, cache=cache, **options)
    return Kernel(function, options, partial(_dispatcher, function, cache, options))


def uncached_dispatcher(kernel: Kernel) -> Any:
    """Return numba's dispatcher of a kernel for calls by other kernels alone, which keeps no files."""
    options: dict[str, Any] = kernel.options | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return numba.njit(**options)(kernel.function)


def _dispatcher(function: Callable, cache: bool, options: dict[str, Any]) -> Any:
    """What ``numba.njit`` makes of a function, with our cache."""
    made = numba.njit(**options)(function)
    if cache and hasattr(made, "enable_caching"):  # not with NUMBA_DISABLE_JIT
        try:
            made._cache = _Cache(function)
        except (RuntimeError, OSError):  # numba's word for: no folder can be written
            _tell_once("no folder for them can be written")
    return made


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's files of machine code; without them, or with damaged ones, kernels are compiled anew."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the kernel for these types, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # damaged files make pickle and LLVM raise what they like
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the kernel for these types, if it can be."""
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
            _tell_once(error.strerror or str(error))


_told = False


def _tell_once(reason: str) -> None:
    global _told
    if not _told and multiprocessing.parent_process() is None:  # which has said it
        _log.warning(
            "bokehnet: compiled kernels cannot be kept (%s), so each program compiles them anew, which may "
            "take minutes; set NUMBA_CACHE_DIR to a folder that can be written",
            reason,
        )
    _told = True
