"""Distribution ray tracer in torch, on any device.

Two renderers: a fast one for training data, with emissive planes in front of a background (:class:`Scene`);
    and a general one, :class:`Tracer`, for worlds of shapes, materials and lights (:class:`World`).
"""

from bokehnet.checks import require_extra

require_extra("torch", "trace")

from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.geometry.meshes import Mesh, read_mesh
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.integrator import render_all_in_focus, render_bokeh, render_disparity
from bokehnet.raytrace.peeling import Peeled, peel
from bokehnet.raytrace.scene import Background, Plane, Scene, background_from, plane_texture
from bokehnet.raytrace.surfaces.lights import Environment, PointLight
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import Accumulation, Maps, Tracer
from bokehnet.raytrace.views import accumulate_views
from bokehnet.raytrace.world import Body, World, world_from_scene

__all__ = [
    "Accumulation",
    "Background",
    "Body",
    "Camera",
    "Environment",
    "Maps",
    "Material",
    "Mesh",
    "Peeled",
    "Plane",
    "PointLight",
    "Quad",
    "Scene",
    "Sphere",
    "Tracer",
    "World",
    "accumulate_views",
    "background_from",
    "peel",
    "plane_texture",
    "read_mesh",
    "render_all_in_focus",
    "render_bokeh",
    "render_disparity",
    "world_from_scene",
]
