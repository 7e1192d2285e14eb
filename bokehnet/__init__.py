"""Bokeh from a picture and its depth: classical, neural and hybrid renderers.

The public names load on first use: importing the package imports neither torch nor onnxruntime.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "Aperture": "bokehnet.optics.aperture",
    "BokehRenderer": "bokehnet.inference.pipeline",
    "BokehnetError": "bokehnet.errors",
    "DisparityRepair": "bokehnet.inference.disparity_repair",
    "Highlights": "bokehnet.optics.tone",
    "Layers": "bokehnet.classical.layered.layers",
    "RenderResult": "bokehnet.inference.pipeline",
    "ThinLens": "bokehnet.lenses.thin",
    "defocus_from_disparity": "bokehnet.optics.coc",
    "defocus_map": "bokehnet.lenses.base",
    "disparity_from_depth": "bokehnet.optics.coc",
    "occluded_background": "bokehnet.classical.layered.occluded_background",
    "rays": "bokehnet.classical.rays_renderer",
    "read_image": "bokehnet.io.image",
    "scatter": "bokehnet.classical.scatter_renderer",
    "split_layers": "bokehnet.classical.layered.layers",
    "write_image": "bokehnet.io.image",
}

# Names of earlier versions, which still work.
_OLD_NAMES = {
    "DisparityRefiner": "DisparityRepair",
    "hidden_layer": "occluded_background",
}

__all__ = [*_HOME, "__version__"]


def __getattr__(name: str) -> Any:
    name = _OLD_NAMES.get(name, name)
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module 'bokehnet' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
