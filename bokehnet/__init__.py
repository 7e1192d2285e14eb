"""Bokeh from a picture and its depth: classical, neural and hybrid renderers.

Public names load on first use: importing the package imports neither torch nor onnxruntime. ``__init__.pyi``
lists them, with their modules. Open first: :mod:`bokehnet.render`.
"""

from typing import Any

import lazy_loader

from bokehnet.version import __version__ as __version__

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

# Names of earlier versions, which still work.
_OLD_NAMES = {"DisparityRefiner": "DisparityRepair", "hidden_layer": "occluded_background"}


def __getattr__(name: str) -> Any:
    name = _OLD_NAMES.get(name, name)
    if name not in __all__:  # and no package below, which Python sets as an attribute once imported
        raise AttributeError(f"module 'bokehnet' has no attribute {name!r}")
    return _load(name)
