"""Lock around parallel kernels."""

import sys

import numba

from bokehnet.errors import BokehnetError
from bokehnet.processes.forking import ForkSafeLock

__all__ = ["parallel_region"]


class _ParallelRegion(ForkSafeLock):
    """Lock that keeps two threads out of numba's workqueue layer, which would abort the process."""

    _stranded = False

    def __enter__(self) -> None:
        if self._stranded:
            raise BokehnetError(
                "this process was forked after numba ran on GNU OpenMP, whose threads do not "
                "survive a fork; leave NUMBA_THREADING_LAYER unset, or start processes by spawn"
            )
        super().__enter__()

    def renew(self) -> None:
        super().renew()
        self._stranded = sys.platform.startswith("linux") and _layer() == "omp"


def _layer() -> str:
    """Return the name of numba's threading layer; an empty string before the first parallel kernel."""
    try:
        layer: str = numba.threading_layer()  # type: ignore[attr-defined]
    except ValueError:
        return ""
    return layer


parallel_region = _ParallelRegion()
