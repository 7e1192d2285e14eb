"""Options of the panel, and preferences of the extension."""

import bpy

__all__ = ["CLASSES", "BokehnetPreferences", "BokehnetSceneSettings"]


class BokehnetSceneSettings(bpy.types.PropertyGroup):
    """Options of a scene; all other settings come from its camera."""

    engine: bpy.props.EnumProperty(
        name="Engine",
        items=(
            ("rays", "Rays", "Handles occlusion at depth edges"),
            ("scatter", "Scatter", "Faster, wrong at depth edges"),
        ),
        default="rays",
    )
    lens: bpy.props.StringProperty(
        name="Lens", description="Lens to render through, from bokehnet lens list; empty for an ideal lens"
    )
    cats_eye: bpy.props.FloatProperty(
        name="Cat's-Eye", description="Clipping of blur discs towards the corners", min=0, max=1.5, default=0
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="Folder of the pinhole pass and the result of each frame",
        subtype="DIR_PATH",
        default="//bokeh/",
    )


class BokehnetPreferences(bpy.types.AddonPreferences):
    """Preferences for this computer."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python with bokehnet",
        description="Empty: Blender's own if the extension has wheels, else that of the command bokehnet",
        subtype="FILE_PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the preferences."""
        self.layout.prop(self, "python")


CLASSES = (BokehnetSceneSettings, BokehnetPreferences)
