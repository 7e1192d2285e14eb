"""Cache of what depends on a picture and its map alone: repaired map, pixel filter, subject.

Keys contain digests of the arrays, so that a picture that is read again, or sent again to a service, hits the
cache, and an array that was changed in place misses it.
"""

import hashlib
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from bokehnet.processes.forking import ForkSafeLock

__all__ = ["DEFAULT_CACHE_BYTES", "PictureCache", "array_digest"]

# Default upper bound of the kept maps of a renderer, bytes: one map of 64 million pixels.
DEFAULT_CACHE_BYTES = 256 * 2**20

# Bytes of an entry beyond its arrays, for small results.
_ENTRY_BYTES = 1024

Value = TypeVar("Value")


def array_digest(array: npt.NDArray[Any]) -> bytes:
    """Return a digest of shape, type and content of an array, 16 bytes.

    Examples:
        >>> import numpy as np
        >>> one, other = np.zeros((2, 3), np.float32), np.zeros((3, 2), np.float32)
        >>> array_digest(one) == array_digest(one.copy()), array_digest(one) == array_digest(other)
        (True, False)
    """
    digest = hashlib.blake2b(f"{array.shape}{array.dtype.str}".encode(), digest_size=16)
    digest.update(np.ascontiguousarray(array).data.cast("B") if array.size else b"")
    return digest.digest()


class PictureCache:
    """Thread-safe least-recently-used cache with an upper bound in bytes.

    Two threads that miss the same key both compute its value, and the cache keeps the later one.

    Args:
        max_bytes: Upper bound of the kept arrays, bytes; 0 keeps nothing.

    Examples:
        >>> import numpy as np
        >>> cache = PictureCache(10_000)
        >>> cache.get("squares", lambda: np.arange(4) ** 2).tolist()
        [0, 1, 4, 9]
        >>> cache.get("squares", lambda: 1 / 0).tolist(), cache.nbytes
        ([0, 1, 4, 9], 1056)
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = max_bytes
        self._lock = ForkSafeLock()
        self._entries: dict[Any, tuple[Any, int]] = {}

    @property
    def nbytes(self) -> int:
        """Bytes of the kept entries."""
        with self._lock:
            return sum(size for _, size in self._entries.values())

    def get(
        self, key: Any, make: Callable[[], Value], arrays: Callable[[Value], Any] = lambda value: value
    ) -> Value:
        """Return the value of a key, from the cache or from ``make``; callers must not change it.

        Args:
            key: Hashable key.
            make: Function that computes the value; what it raises is passed on.
            arrays: Function from the value to the array that counts; others count as small.
        """
        with self._lock:
            if key in self._entries:
                entry = self._entries[key] = self._entries.pop(key)
                value: Value = entry[0]
                return value
        value = make()
        size = _ENTRY_BYTES + int(getattr(arrays(value), "nbytes", 0))
        if size <= self.max_bytes:
            with self._lock:
                self._entries[key] = value, size
            self.trim(self.max_bytes)
        return value

    def trim(self, max_bytes: int) -> None:
        """Remove the entries that were not used for longest, until the rest fits into ``max_bytes``."""
        with self._lock:
            while self._entries and self.nbytes > max_bytes:
                del self._entries[next(iter(self._entries))]
