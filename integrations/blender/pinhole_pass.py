"""A frame as through a pinhole, with its depth, as a multilayer EXR file; the scene is left as it was."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from .camera import HostError

__all__ = ["pixel_filter", "render_pinhole_pass"]


@contextmanager
def _changed(*changes: tuple[Any, str, object]) -> Iterator[None]:
    """Set attributes of Blender's data, and back in the same order: a format needs its medium first."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in changes]
    try:
        for owner, name, value in changes:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)


def pixel_filter(scene: bpy.types.Scene) -> str:
    """Name and width of the filter by which the scene's renderer mixes both sides of an edge."""
    if scene.render.engine != "CYCLES":
        return "blender"
    names = {"BOX": "box", "GAUSSIAN": "gaussian", "BLACKMAN_HARRIS": "blackman-harris"}
    kind = scene.cycles.pixel_filter_type
    return names[kind] if kind == "BOX" else f"{names[kind]}:{scene.cycles.filter_width:g}"


def render_pinhole_pass(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, path: Path) -> str:
    """Render the current frame of one view layer without depth of field, and write it.

    Args:
        scene: Its compositor and sequencer, other view layers and the border are left out.
        layer: Whose Combined and Z are wanted.
        path: An EXR file.

    Returns:
        Name of the channel of the depth.

    Raises:
        HostError: Nothing was rendered.
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
