"""Memory that a process keeps: resident bytes after an array is freed, as the system reports them."""

import json
import subprocess
import sys

import pytest

# In a process of its own: another test may leave free memory, which the array would take.
_PROGRAM = """
import json
import numpy as np
from bokehnet.inference.process_memory import freed_memory_kept, keeps_freed_memory, resident_bytes

def grown():
    before = resident_bytes()
    np.ones(200_000_000, np.uint8)  # freed at once
    return resident_bytes() - before

outside = grown()
with freed_memory_kept():
    kept, inside, again = keeps_freed_memory(), grown(), grown()
print(json.dumps([outside, kept, inside, again, keeps_freed_memory(), grown()]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="glibc")
def test_freed_memory_is_kept_inside_the_block_and_returned_after_it():
    done = subprocess.run([sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=True)
    outside, kept, inside, again, kept_afterwards, afterwards = json.loads(done.stdout)
    assert kept
    assert not kept_afterwards
    assert inside > 150_000_000
    assert max(outside, again, afterwards) < 50_000_000
