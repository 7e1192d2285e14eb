"""Peak memory of a computation, beyond the memory in use before."""

import ctypes
import gc
from pathlib import Path

__all__ = ["PeakMemory", "memory_status"]

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class PeakMemory:
    """Measures peak memory from its construction on.

    Examples:
        >>> peak = PeakMemory()
        >>> one = bytearray(1 << 24)
        >>> peak.extra is None or peak.extra >= 0
        True
    """

    def __init__(self) -> None:
        gc.collect()
        try:
            ctypes.CDLL("libc.so.6").malloc_trim(0)  # otherwise freed memory would be reused unnoticed
            _RESET.write_text("5")  # resets the recorded peak
            self._before: int | None = memory_status("VmRSS")
        except (OSError, AttributeError):
            self._before = None

    @property
    def extra(self) -> int | None:
        """Peak memory since construction, beyond that at the start, bytes; None except on Linux."""
        return None if self._before is None else max(memory_status("VmHWM") - self._before, 0)


def memory_status(key: str) -> int:
    """Return a memory figure of this process in bytes, from Linux.

    Args:
        key: Name in ``/proc/self/status`` of a figure in kB.

    Raises:
        OSError: The file does not exist, as on other systems.

    Examples:
        >>> memory_status("VmHWM") >= memory_status("VmRSS") > 0 if _STATUS.exists() else True
        True
    """
    lines = _STATUS.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) * 1024
