"""Operators that render a frame or an animation, and pass the result to the compositor."""

import os
import tempfile
from pathlib import Path

import bpy

from .camera import HostError, camera_settings
from .pinhole_pass import pixel_filter, render_pinhole_pass
from .process import WarmProcess

__all__ = ["CLASSES", "RESULT", "stop_process"]

RESULT = "Bokeh Result"  # the image for the compositor

_process: WarmProcess | None = None


def _warm_process(context: bpy.types.Context) -> WarmProcess:
    """Return the process, started with the interpreter of the preferences, otherwise of BOKEHNET_PYTHON."""
    global _process
    addon = context.preferences.addons.get(__package__)
    python = (addon.preferences.python if addon and addon.preferences else "") or os.environ.get(
        "BOKEHNET_PYTHON", ""
    )
    if _process is not None and _process.python != python:
        stop_process()
    if _process is None:
        _process = WarmProcess(python)
    return _process


def stop_process() -> None:
    """End the bokehnet process."""
    global _process
    if _process is not None:
        _process.stop()
    _process = None


def _frame_files(scene: bpy.types.Scene) -> tuple[Path, Path]:
    """Return the files of pinhole pass and result of this frame; unsaved scenes use a temporary folder."""
    folder = scene.bokehnet.folder
    if folder.startswith("//") and not bpy.data.filepath:
        folder = str(Path(tempfile.gettempdir()) / "bokehnet" / folder[2:])
    base = Path(bpy.path.abspath(folder))
    try:
        base.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HostError(
            f"folder: expected one to write into, found {base} ({error.strerror}); choose another"
        ) from error
    return base / f"pinhole.{scene.frame_current:04d}.exr", base / f"bokeh.{scene.frame_current:04d}.exr"


def render_frame(context: bpy.types.Context) -> tuple[Path, dict[str, object]]:
    """Render the current frame; return the file of the result, and the summary of the rendering.

    Raises:
        HostError: The scene cannot be rendered.
    """
    scene, manager = context.scene, context.window_manager
    if scene.camera is None:
        raise HostError("scene: expected an active camera, found none; add one")
    graph = context.evaluated_depsgraph_get()
    settings = camera_settings(scene, scene.camera.evaluated_get(graph))
    pinhole, output = _frame_files(scene)
    channel = render_pinhole_pass(scene, context.view_layer, pinhole)
    options = scene.bokehnet
    settings["input"] = {"depth": str(pinhole), "channel": channel}
    settings["depth"] = {"pixel_filter": pixel_filter(scene)}
    settings["engine"] = {"name": options.engine}
    settings["aperture"]["cats_eye"] = options.cats_eye
    if options.lens:
        settings["lens"] = {"name": options.lens}
    manager.progress_begin(0, 1)
    try:
        summary = _warm_process(context).render(pinhole, settings, output, manager.progress_update)
    finally:
        manager.progress_end()
    return output, summary


def load_result(path: Path, frames: int = 1) -> bpy.types.Image:
    """Return the image of the result, or of the sequence that begins with it; always the same data-block."""
    image = bpy.data.images.get(RESULT)
    if image is None:
        image = bpy.data.images.load(str(path))
        image.name = RESULT
    image.filepath = str(path)
    image.source = "SEQUENCE" if frames > 1 else "FILE"
    image.reload()
    return image


class BOKEHNET_OT_render(bpy.types.Operator):
    """Render this frame with a pinhole camera, and add the depth of field of the active camera."""

    bl_idname = "bokehnet.render"
    bl_label = "Render Bokeh"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the scene has a camera."""
        return context.scene is not None and context.scene.camera is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Render, and load the result as an image."""
        try:
            path, summary = render_frame(context)
        except HostError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        load_result(path)
        for note in summary["notes"]:
            self.report({"WARNING"}, str(note))
        self.report({"INFO"}, f"{path}: largest blur {summary['largest_blur']:.1f} pixels")
        return {"FINISHED"}


class BOKEHNET_OT_render_animation(bpy.types.Operator):
    """Render the depth of field of all frames of the scene; existing frames are skipped. Esc stops."""

    bl_idname = "bokehnet.render_animation"
    bl_label = "Render Bokeh Animation"

    overwrite: bpy.props.BoolProperty(
        name="Overwrite", description="Render existing frames again", default=False
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the scene has a camera."""
        return context.scene is not None and context.scene.camera is not None

    def _begin(self, context: bpy.types.Context) -> None:
        scene = context.scene
        self._frames = list(range(scene.frame_start, scene.frame_end + 1, scene.frame_step))
        self._done: list[Path] = []
        self._before = scene.frame_current

    def _next(self, context: bpy.types.Context) -> bool:
        """Render one frame; return whether frames remain."""
        scene = context.scene
        scene.frame_set(self._frames.pop(0))
        path = _frame_files(scene)[1]
        if self.overwrite or not path.exists():
            path, _ = render_frame(context)
        self._done.append(path)
        return bool(self._frames)

    def _end(self, context: bpy.types.Context) -> None:
        context.scene.frame_set(self._before)
        if self._done:
            load_result(self._done[0], len(self._done))

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Render all frames in one call, as in background mode."""
        self._begin(context)
        try:
            while self._next(context):
                pass
        except HostError as error:
            self.report({"ERROR"}, f"frame {context.scene.frame_current}: {error}")
            return {"CANCELLED"}
        finally:
            self._end(context)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Render one frame per timer event, so that Esc can interrupt between frames."""
        self._begin(context)
        self._timer = context.window_manager.event_timer_add(0.1, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Render the next frame."""
        if event.type == "ESC":
            return self._stopped(context, {"CANCELLED"})
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            more = self._next(context)
        except HostError as error:
            self.report({"ERROR"}, f"frame {context.scene.frame_current}: {error}")
            return self._stopped(context, {"CANCELLED"})
        return {"RUNNING_MODAL"} if more else self._stopped(context, {"FINISHED"})

    def _stopped(self, context: bpy.types.Context, outcome: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self._timer)
        self._end(context)
        return outcome


class BOKEHNET_OT_to_compositor(bpy.types.Operator):
    """Add an image node with the result to the scene's compositor."""

    bl_idname = "bokehnet.to_compositor"
    bl_label = "Result to Compositor"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether a result exists."""
        return RESULT in bpy.data.images

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Add the node, or reuse the existing one."""
        scene = context.scene
        if hasattr(scene, "compositing_node_group"):  # from Blender 5.0 on
            tree = scene.compositing_node_group
            if tree is None:
                tree = bpy.data.node_groups.new("Compositor", "CompositorNodeTree")
                scene.compositing_node_group = tree
        else:
            scene.use_nodes = True
            tree = scene.node_tree
        node = tree.nodes.get(RESULT) or tree.nodes.new("CompositorNodeImage")
        node.name = node.label = RESULT
        node.image = bpy.data.images[RESULT]
        if node.image.source == "SEQUENCE":
            node.frame_start, node.frame_duration = scene.frame_start, scene.frame_end - scene.frame_start + 1
        return {"FINISHED"}


CLASSES = (BOKEHNET_OT_render, BOKEHNET_OT_render_animation, BOKEHNET_OT_to_compositor)
