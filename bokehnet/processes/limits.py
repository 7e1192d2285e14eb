"""Resource limits of worker processes: what a file makes them take ends at them, not at the machine."""

import os
import sys
from pathlib import Path

__all__ = ["address_space_limit", "limit_address_space", "limit_cpu_time"]


def address_space_limit() -> int | None:
    """Return the limit of this process's address space in bytes (``ulimit -v``); None if there is none."""
    if os.name != "posix":
        return None
    import resource

    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit


def limit_address_space(extra: int) -> None:
    """Let this process map at most ``extra`` bytes more than now; a request beyond fails with MemoryError.

    No effect outside Linux.
    """
    if sys.platform != "linux":
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + extra
    _, highest = resource.getrlimit(resource.RLIMIT_AS)
    if highest == resource.RLIM_INFINITY or limit < highest:
        resource.setrlimit(resource.RLIMIT_AS, (limit, highest))


def limit_cpu_time(seconds: float | None) -> None:
    """Let this process use ``seconds`` more of processor time, all threads together, before it is killed.

    Args:
        seconds: Processor time from now; None for no limit.
    """
    if os.name != "posix":
        return
    import resource

    _, highest = resource.getrlimit(resource.RLIMIT_CPU)
    limit = highest
    if seconds is not None:
        times = os.times()
        limit = int(times.user + times.system + seconds) + 1
    if highest == resource.RLIM_INFINITY or limit < highest:
        resource.setrlimit(resource.RLIMIT_CPU, (limit, highest))
