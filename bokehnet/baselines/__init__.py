"""Methods of the literature, one per file, for comparison only.

Inputs are those of every engine: a scene-linear picture (H, W, 3), the signed blur radius in pixels (H, W), +
    in front of focus, and an :class:`~bokehnet.optics.aperture.Aperture`. The output is the blurred picture.
    A method's own parameters are in its signature. ``bokehnet.baselines.NAME`` is the function, ``--engine
    NAME`` uses it in whole renderings. Each file states paper, equation and known faults. Open first:
    :data:`BASELINES`.
"""

from importlib import import_module
from typing import Any

from bokehnet.baselines.registry import BASELINES as BASELINES
from bokehnet.baselines.registry import Baseline as Baseline

__all__ = ["BASELINES", "Baseline", *BASELINES]


def __getattr__(name: str) -> Any:
    if name in BASELINES:
        return getattr(import_module(BASELINES[name].module), name)
    raise AttributeError(f"module 'bokehnet.baselines' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
