"""Blender extension: the depth of field of the active camera, from a pinhole render and its depth.

A frame is rendered once without depth of field, with its Z, and written as EXR; a separate bokehnet process
renders the blur of the active camera from that file. No code of bokehnet runs inside Blender's own process.
"""

import bpy

from . import operators, panel, settings

_CLASSES = (*settings.CLASSES, *operators.CLASSES, *panel.CLASSES)


def register() -> None:
    """Register the operators, the panel and their settings."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.bokehnet = bpy.props.PointerProperty(type=settings.BokehnetSceneSettings)


def unregister() -> None:
    """Unregister them, and end the bokehnet process."""
    operators.stop_process()
    del bpy.types.Scene.bokehnet
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
