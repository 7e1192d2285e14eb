"""The one lock around parallel kernels."""

import threading

__all__ = ["parallel_region"]

# Two Python threads inside one parallel region would abort the process on numba's workqueue layer.
parallel_region = threading.Lock()
