"""Memory that the process keeps: resident bytes after arrays are freed, as the system reports them."""

import sys

import numpy as np
import pytest

from bokehnet.inference.process_memory import freed_memory_kept, keeps_freed_memory, resident_bytes


@pytest.mark.skipif(sys.platform != "linux", reason="glibc")
def test_freed_memory_is_kept_inside_the_block_and_returned_after_it():
    size = 200_000_000

    def grown() -> int:
        before = resident_bytes()
        np.ones(size, np.uint8)  # freed at once
        return resident_bytes() - before

    assert grown() < size / 4
    with freed_memory_kept():
        assert keeps_freed_memory()
        assert grown() > size / 2
        assert grown() < size / 4  # the same memory again
    assert not keeps_freed_memory()
    assert grown() < size / 4
