"""Panel in the properties of the camera."""

import bpy

from .camera import HostError, camera_settings

__all__ = ["CLASSES"]


class BOKEHNET_PT_camera(bpy.types.Panel):
    """Options of the scene, camera data, and the operators."""

    bl_label = "Bokeh"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "data"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Return whether the active object is a camera."""
        return getattr(context, "camera", None) is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the panel."""
        layout, scene = self.layout, context.scene
        layout.use_property_split = True
        for name in ("engine", "lens", "cats_eye", "folder"):
            layout.prop(scene.bokehnet, name)
        if scene.camera is not None:
            try:
                settings = camera_settings(scene, scene.camera)
            except HostError as error:
                layout.label(text=str(error), icon="ERROR")
            else:
                lens, focus = settings["camera"], settings["focus"]
                stop = scene.camera.data.dof.aperture_fstop
                text = f"{lens['focal_length']:g} mm, f/{stop:g}, {focus['distance']:.2f} m"
                layout.label(text=text, icon="CAMERA_DATA")
        layout.operator("bokehnet.render")
        layout.operator("bokehnet.render_animation")
        layout.operator("bokehnet.to_compositor")


CLASSES = (BOKEHNET_PT_camera,)
