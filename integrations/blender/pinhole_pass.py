"""Render a frame with a pinhole camera, with its depth, as a multilayer EXR file; the scene is restored."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from .camera import HostError

__all__ = ["pixel_filter", "render_pinhole_pass"]


@contextmanager
def _changed(*changes: tuple[Any, str, object]) -> Iterator[None]:
    """Set attributes of Blender's data, and restore them in the same order: formats depend on the medium."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in changes]
    try:
        for owner, name, value in changes:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)


def pixel_filter(scene: bpy.types.Scene) -> str:
    """Return name and width of the pixel filter of the scene's renderer."""
    if scene.render.engine != "CYCLES":
        return "blender"
    names = {"BOX": "box", "GAUSSIAN": "gaussian", "BLACKMAN_HARRIS": "blackman-harris"}
    kind = scene.cycles.pixel_filter_type
    return names[kind] if kind == "BOX" else f"{names[kind]}:{scene.cycles.filter_width:g}"


def render_pinhole_pass(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, path: Path) -> str:
    """Render the current frame of one view layer without depth of field, and write it.

    Args:
        scene: Scene; its compositor, sequencer, other view layers and border are ignored.
        layer: View layer that provides Combined and Z.
        path: EXR file to write.

    Returns:
        Name of the depth channel.

    Raises:
        HostError: No picture was rendered.
    """
    render, image = scene.render, scene.render.image_settings
    changes: list[tuple[Any, str, object]] = [
        (scene.camera.data.dof, "use_dof", False),
        (layer, "use", True),
        (layer, "use_pass_combined", True),
        (layer, "use_pass_z", True),
        (render, "use_compositing", False),
        (render, "use_sequencer", False),
        (render, "use_border", False),
        (render, "use_multiview", False),
        (render, "use_file_extension", False),
        (render, "filepath", str(path)),
    ]
    changes += [(other, "use", False) for other in scene.view_layers if other != layer]
    if hasattr(image, "media_type"):  # from Blender 5.0 on
        changes.append((image, "media_type", "MULTI_LAYER_IMAGE"))
    changes += [
        (image, "file_format", "OPEN_EXR_MULTILAYER"),
        (image, "color_depth", "32"),
        (image, "exr_codec", "ZIP"),
    ]
    with _changed(*changes):
        bpy.ops.render.render(write_still=True, scene=scene.name)
    if not path.exists():
        raise HostError(
            f"render: expected the pinhole pass at {path}, found none; it was cancelled, or the disk is full"
        )
    return f"{layer.name}.Depth.Z" if bpy.app.version >= (4, 0) else "Z"
