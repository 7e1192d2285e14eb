"""Bokeh as torch operations: batches (B, C, H, W), gradients, any device. Needs the extra ``torch``.

In: pictures, signed defocus in pixels, and for occlusion the hidden layers with their coverage. Out: bokeh of
the same shape and dtype, differentiable.

Open first: ``occlusion.py``, rays through layers; then ``splatting.py``, without occlusion, and
``module.py``, the module for networks. ``aperture.py`` samples the pupil, ``slabs.py`` bounds the search of
the rays, and ``window_means.py`` averages the rays of blurred surfaces, and
``gradient_checks.py`` names an operation whose gradient is not finite.

Names are imported on first use, so that ``import bokehnet.torch`` does not import torch.
"""

from importlib import import_module
from typing import Any

_HOMES = {
    "BokehBlur": "module",
    "SmoothAperture": "aperture",
    "checked_gradients": "gradient_checks",
    "layered": "occlusion",
    "scatter": "splatting",
    "split_layers": "occlusion",
}

__all__ = ["BokehBlur", "SmoothAperture", "checked_gradients", "layered", "scatter", "split_layers"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from bokehnet.checks import require_extra

    require_extra("torch", "torch")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
