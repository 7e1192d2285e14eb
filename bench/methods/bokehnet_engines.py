"""Engines and baselines of bokehnet as functions of a case: ``--function bokehnet_engines:rays``.

Needs bokehnet beside the benchmark, and this folder in ``PYTHONPATH``.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from bokeh_bench.dataset import Case

from bokehnet import baselines
from bokehnet.engines.engine import Engine
from bokehnet.engines.options import RenderOptions
from bokehnet.errors import ParameterError
from bokehnet.optics.aperture import Aperture

_ENGINES = ("scatter", "fast", "neural", "hybrid", "rays")


@cache
def _engine(name: str) -> Engine:
    return Engine(name)


def _baseline(name: str, image: np.ndarray, defocus: np.ndarray, aperture: Aperture) -> np.ndarray:
    function = getattr(baselines, name)
    try:
        return np.asarray(function(image, defocus, aperture))
    except ParameterError as error:
        if error.parameter != "aperture":
            raise
        return np.asarray(function(image, defocus))


def __getattr__(name: str) -> Callable[[Case], Any]:
    if name not in _ENGINES and name not in baselines.BASELINES:
        raise AttributeError(f"no engine or baseline {name}")

    def method(case: Case) -> np.ndarray:
        image, defocus = case.image.astype(np.float32), case.defocus.astype(np.float32)
        # A corner of the benchmark's polygon points to the right, the middle of an edge in bokehnet.
        aperture = Aperture(blades=case.blades, rotation=180 / case.blades if case.blades else 0.0)
        if name in _ENGINES:
            return _engine(name).render(image, defocus, options=RenderOptions(aperture=aperture)).bokeh
        return _baseline(name, image, defocus, aperture)

    return method
