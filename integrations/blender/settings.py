"""What the panel lets choose, and the preferences of the extension."""

import bpy

__all__ = ["CLASSES", "BokehnetPreferences", "BokehnetSceneSettings"]


class BokehnetSceneSettings(bpy.types.PropertyGroup):
    """Of a scene: all else is its camera's."""

    engine: bpy.props.EnumProperty(
        name="Engine",
        items=(
            ("rays", "Rays", "Sees what stands before what"),
            ("scatter", "Scatter", "Faster, wrong at depth edges"),
        ),
        default="rays",
    )
    lens: bpy.props.StringProperty(
        name="Lens", description="Glass to render through, as bokehnet lens lists it; empty is a perfect lens"
    )
    cats_eye: bpy.props.FloatProperty(
        name="Cat's-Eye", description="Clipping of discs towards the corners", min=0, max=1.5, default=0
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="Where the pinhole pass and the result of each frame go",
        subtype="DIR_PATH",
        default="//bokeh/",
    )


class BokehnetPreferences(bpy.types.AddonPreferences):
    """Of this computer."""

    bl_idname = __package__

    python: bpy.props.StringProperty(
        name="Python with bokehnet",
        description="Empty: Blender's own, with the wheels that the extension brings",
        subtype="FILE_PATH",
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Show them."""
        self.layout.prop(self, "python")


CLASSES = (BokehnetSceneSettings, BokehnetPreferences)
