"""Blender extension: the depth of field of the active camera, from a pinhole render and its depth.

A frame is rendered once without depth of field, with its Z, and written as EXR; a warm bokehnet process
beside Blender renders the blur of the active camera from that file. Nothing of bokehnet runs inside Blender's
own process.
"""

import bpy

from . import operators, panel, settings

_CLASSES = (*settings.CLASSES, *operators.CLASSES, *panel.CLASSES)


def register() -> None:
    """Make the operators, the panel and their settings known to Blender."""
    for each in _CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.bokehnet = bpy.props.PointerProperty(type=settings.BokehnetSceneSettings)


def unregister() -> None:
    """Take them away again, and end the process beside Blender."""
    operators.stop_process()
    del bpy.types.Scene.bokehnet
    for each in reversed(_CLASSES):
        bpy.utils.unregister_class(each)
