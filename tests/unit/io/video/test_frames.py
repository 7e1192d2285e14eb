"""Segments of pictures narrower than x265's assembly expects."""

import sys

import pytest

pytest.importorskip("av", reason="videos need the extra video")

_WRITE_SEGMENTS = """
import sys
from fractions import Fraction
from pathlib import Path
import numpy as np
from bokehnet.io.color.color_space import SRGB
from bokehnet.io.video.frames import VideoInfo, write_segment

path = Path(sys.argv[1])
for width in 10 * (16, 34, 48):
    info = VideoInfo(
        path=path, width=width, height=32, times=(0, 1), time_base=Fraction(1, 24), rate=Fraction(24),
        pixels="yuv420p10le", codes=(1, 1, 1), full=False, space=SRGB,
    )
    light = np.full((32, width, 3), 0.2, np.float32)
    write_segment(path, info, [(time, light) for time in info.times], "h265")
print("written")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs the heap checks of the GNU C library")
def test_narrow_pictures_leave_the_heap_intact(tmp_path, python_process):
    """Authority: the C library, which ends a process at a block whose size was overwritten."""
    done = python_process(_WRITE_SEGMENTS, tmp_path / "segment.npz")
    assert (done.code, done.out, done.err) == (0, "written\n", "")
