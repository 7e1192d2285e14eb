"""Memory that a piece of work holds at its peak, beyond what was held before."""

import ctypes
import gc
from pathlib import Path

__all__ = ["PeakMemory", "memory_status"]

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class PeakMemory:
    """Starts to watch when it is made.

    Examples:
        >>> peak = PeakMemory()
        >>> one = bytearray(1 << 24)
        >>> peak.extra is None or peak.extra >= 0
        True
    """

    def __init__(self) -> None:
        gc.collect()
        try:
            ctypes.CDLL("libc.so.6").malloc_trim(0)  # what was freed before must not be had for nothing
            _RESET.write_text("5")  # the peak starts anew
            self._before: int | None = memory_status("VmRSS")
        except (OSError, AttributeError):
            self._before = None

    @property
    def extra(self) -> int | None:
        """Bytes of this process at the peak since then, beyond those at the start; None but on Linux."""
        return None if self._before is None else max(memory_status("VmHWM") - self._before, 0)


def memory_status(key: str) -> int:
    """A figure of this process in bytes, as Linux tells it.

    Args:
        key: Its name in ``/proc/self/status``, one that is told in kB.

    Raises:
        OSError: There is no such file, as on other systems.

    Examples:
        >>> memory_status("VmHWM") >= memory_status("VmRSS") > 0 if _STATUS.exists() else True
        True
    """
    lines = _STATUS.read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) * 1024
