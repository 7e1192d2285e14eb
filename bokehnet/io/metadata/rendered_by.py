"""Detect the renderer that wrote an EXR file from its header."""

import fnmatch
from collections.abc import Mapping

from bokehnet.io.exr.header import Value

__all__ = ["renderer_of"]

# Patterns of attribute names.
_ATTRIBUTE_PATTERNS = {
    "cycles.*.samples": "cycles",
    "BlenderMultiChannel": "blender",
    "arnold/*": "arnold",
}


def renderer_of(attributes: Mapping[str, Value]) -> str | None:
    """Return the renderer that wrote a header: "cycles", "blender", "arnold", or None if unknown.

    None of them stores its pixel filter, so the default filter is the best guess. Other renderers store
    their names too (``vrayInfo/``, ``rs/`` of Redshift, ``husk:`` of Karma), but their filters are unknown
    or vary between versions; RenderMan stores no name.

    Args:
        attributes: Attributes by name as stored.

    Source:
        Cycles, ``blender/session.cpp``, ``stamp_view_layer_metadata`` (``cycles.<view layer>.samples``).
        Blender, ``openexr_api.cpp`` (``BlenderMultiChannel``, in files of several layers). Arnold:
        headers of published files (``arnold/frame``, ``arnold/stats/...``).

    Examples:
        >>> renderer_of({"Camera": "Camera", "cycles.ViewLayer.samples": "16"})
        'cycles'
    """
    for pattern, renderer in _ATTRIBUTE_PATTERNS.items():
        if fnmatch.filter(attributes, pattern):
            return renderer
    return None
