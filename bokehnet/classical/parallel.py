"""The one lock around parallel kernels."""

import sys

import numba

from bokehnet.errors import BokehnetError
from bokehnet.forking import ForkSafeLock

__all__ = ["parallel_region"]


class _ParallelRegion(ForkSafeLock):
    """Two threads inside one parallel region would abort the process on numba's workqueue layer."""

    _stranded = False

    def __enter__(self) -> None:
        if self._stranded:
            raise BokehnetError(
                "this process was forked after numba had run on GNU OpenMP, whose threads are "
                "not there any more; leave NUMBA_THREADING_LAYER alone, or start processes by spawn"
            )
        super().__enter__()

    def renew(self) -> None:
        super().renew()
        self._stranded = sys.platform.startswith("linux") and _layer() == "omp"


def _layer() -> str:
    """What runs numba's threads; empty before anything was parallel."""
    try:
        layer: str = numba.threading_layer()  # type: ignore[attr-defined]
    except ValueError:
        return ""
    return layer


parallel_region = _ParallelRegion()
