"""GEGL's lens blur as a function of a case: ``--function gegl_lens_blur:lens_blur``.

Needs GEGL (Debian: ``apt install libgegl-0.4-0``) and the root of the repository in ``PYTHONPATH``. The
operation blurs by one map of radii without order or sign, and by a disc alone.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from bokeh_bench.dataset import Case
from bokeh_bench.files import BenchError

from benchmarks.methods.rivals import open_lens_blur


@cache
def _blur() -> Callable[[np.ndarray, np.ndarray], Callable[[], np.ndarray]]:
    blur = open_lens_blur(threads=2)
    if blur is None:
        raise BenchError("gegl_lens_blur: expected the library of GEGL; Debian: apt install libgegl-0.4-0")
    return blur


def lens_blur(case: Case) -> np.ndarray:
    """Return GEGL's picture of a case."""
    return np.asarray(_blur()(case.image.astype(np.float32), case.defocus.astype(np.float32))())
