"""Methods of the literature, one a file, to hold ours against: none of them is meant to be used for pictures.

In goes what every engine takes, a scene-linear picture (H, W, 3), the signed blur radius in pixels (H, W), +
in front of focus, and an :class:`~bokehnet.optics.aperture.Aperture`; out comes the blurred picture. What a
method can be told beside stands in its own signature. ``bokehnet.baselines.NAME`` is the function, ``--engine
NAME`` the same for whole renderings. Each file tells paper, equation and known faults. Open first:
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
