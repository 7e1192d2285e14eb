"""The distribution ray tracer: scenes of textured planes, seen through a lens, in torch on any device."""

from bokehnet.checks import require_extra

require_extra("torch", "train")

from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.integrator import render_all_in_focus, render_bokeh, render_disparity
from bokehnet.raytrace.scene import Background, Plane, Scene, background_from, plane_texture

__all__ = [
    "Background",
    "Camera",
    "Plane",
    "Scene",
    "background_from",
    "plane_texture",
    "render_all_in_focus",
    "render_bokeh",
    "render_disparity",
]
