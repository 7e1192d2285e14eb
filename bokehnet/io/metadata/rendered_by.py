"""Which renderer wrote an EXR file, as its header tells."""

import fnmatch
from collections.abc import Mapping

from bokehnet.io.exr.header import Value

__all__ = ["renderer_of"]

# Patterns of attributes' names.
_SIGNS = {
    "cycles.*.samples": "cycles",
    "BlenderMultiChannel": "blender",
    "arnold/*": "arnold",
}


def renderer_of(attributes: Mapping[str, Value]) -> str | None:
    """Return the renderer that wrote a header: "cycles", "blender", "arnold", or None where none of them did.

    None of them tells its pixel filter, so that its usual one is the best guess. Others tell their names too
    (``vrayInfo/``, ``rs/`` of Redshift, ``husk:`` of Karma), but have filters that are not known here, or
    several from version to version; RenderMan tells no name.

    Args:
        attributes: By name as stored.

    Source:
        Cycles, ``blender/session.cpp``, ``stamp_view_layer_metadata`` (``cycles.<view layer>.samples``).
        Blender, ``openexr_api.cpp`` (``BlenderMultiChannel``, in files of several layers). Arnold:
        headers of published files (``arnold/frame``, ``arnold/stats/...``).

    Examples:
        >>> renderer_of({"Camera": "Camera", "cycles.ViewLayer.samples": "16"})
        'cycles'
    """
    for pattern, renderer in _SIGNS.items():
        if fnmatch.filter(attributes, pattern):
            return renderer
    return None
