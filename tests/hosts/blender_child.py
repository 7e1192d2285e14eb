"""Runs in Blender, or in a Python that has bpy: builds a scene, renders it by Cycles and by the extension.

Arguments, in Blender behind ``--``: the extension's zip, a folder for files, and what to do.
"""

import json
import math
import sys
from pathlib import Path

import bpy

SIZE = (192, 144)


def install(archive: str) -> None:
    """Install the extension as a user does, from its zip."""
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)


def material(name, color, glow=0.0):
    result = bpy.data.materials.new(name)
    result.use_nodes = True
    nodes, links = result.node_tree.nodes, result.node_tree.links
    nodes.clear()
    output, shader = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeEmission")
    shader.inputs["Strength"].default_value = glow or 1.0
    if isinstance(color, tuple):
        shader.inputs["Color"].default_value = (*color, 1)
    else:  # a checker
        checker = nodes.new("ShaderNodeTexChecker")
        checker.inputs["Scale"].default_value = color
        checker.inputs["Color1"].default_value = (0.8, 0.5, 0.2, 1)
        checker.inputs["Color2"].default_value = (0.1, 0.2, 0.3, 1)
        coordinates = nodes.new("ShaderNodeTexCoord")
        links.new(coordinates.outputs["Object"], checker.inputs["Vector"])
        links.new(checker.outputs["Color"], shader.inputs["Color"])
    links.new(shader.outputs["Emission"], output.inputs["Surface"])
    return result


def add(shape, place, size, made):
    if shape == "plane":
        bpy.ops.mesh.primitive_plane_add(size=size, location=place, rotation=(math.pi / 2, 0, 0))
    else:
        bpy.ops.mesh.primitive_uv_sphere_add(radius=size, location=place, segments=48, ring_count=24)
    bpy.context.object.data.materials.append(made)
    return bpy.context.object


def build(blades=0, rotation=0.0, ratio=1.0):
    """Balls before a checkered wall, lit by themselves; the camera looks along +y."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add("plane", (0, 6, 0), 12, material("wall", 1.3))
    add("ball", (-0.55, 2.4, 0.1), 0.35, material("near", 5.0))
    middle = add("ball", (0.25, 3.4, -0.1), 0.4, material("middle", 4.0))
    for place in ((1.1, 5.5, 0.7), (-1.2, 5.6, 0.9), (0.3, 5.7, 1.0)):
        add("ball", place, 0.03, material("lamp", (1.0, 0.9, 0.7), 30.0))
    camera = bpy.data.cameras.new("camera")
    holder = bpy.data.objects.new("camera", camera)
    holder.rotation_euler = (math.pi / 2, 0, 0)
    scene.collection.objects.link(holder)
    scene.camera = holder
    camera.lens, camera.sensor_width = 50, 36
    camera.dof.use_dof = True
    camera.dof.focus_object = middle
    camera.dof.aperture_fstop = 0.12
    camera.dof.aperture_blades, camera.dof.aperture_rotation, camera.dof.aperture_ratio = (
        blades,
        rotation,
        ratio,
    )
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 0
    scene.render.threads_mode, scene.render.threads = "FIXED", 2
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    return scene


def render_truth(scene, path, seed, samples):
    """Cycles's own depth of field."""
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.cycles.use_adaptive_sampling = False
    image = scene.render.image_settings
    if hasattr(image, "media_type"):
        image.media_type = "IMAGE"
    image.file_format, image.color_depth = "OPEN_EXR", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def pixels_of(name):
    image = bpy.data.images[name]
    values = list(image.pixels)  # none of a sequence whose first file is no picture
    return {"size": list(image.size), "mean": sum(values) / max(len(values), 1), "source": image.source}


def main() -> None:
    words = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    archive, folder, task = words[0], Path(words[1]), json.loads(words[2])
    reports = {"version": bpy.app.version_string}
    scene = build(**task.get("camera", {}))
    install(archive)  # after the factory settings, which take extensions away
    if task.get("truth"):
        for seed in (1, 2):
            render_truth(scene, folder / f"truth{seed}.exr", seed, task["truth"])
    scene.bokehnet.folder = str(folder)
    scene.bokehnet.engine = task.get("engine", "rays")
    scene.cycles.samples = task.get("samples", 16)
    dof = scene.camera.data.dof
    for name, value in task.get("change", {}).items():
        owner = scene.camera.data if name != "pixel_aspect_x" else scene.render
        setattr(owner, name, value)
    if task.get("no_camera"):
        scene.camera = None
    if task.get("frames"):
        scene.frame_start, scene.frame_end = task["frames"]
        dof.focus_object = None
        for frame, distance in zip(task["frames"], (2.4, 5.0), strict=True):
            dof.focus_distance = distance
            dof.keyframe_insert("focus_distance", frame=frame)
    before = scene.render.filepath, scene.render.image_settings.file_format, dof.use_dof
    try:
        if task.get("frames"):
            bpy.ops.bokehnet.render_animation()
        else:
            bpy.ops.bokehnet.render()
    except RuntimeError as error:  # how Blender reports an error to scripts
        reports["error"] = str(error).strip()
    else:
        bpy.ops.bokehnet.to_compositor()
        tree = getattr(scene, "compositing_node_group", None) or scene.node_tree
        reports["node"] = tree.nodes["Bokeh Result"].image.name
        reports["image"] = pixels_of("Bokeh Result")
    reports["unchanged"] = before == (
        scene.render.filepath,
        scene.render.image_settings.file_format,
        dof.use_dof,
    )
    bpy.ops.preferences.addon_disable(module="bl_ext.user_default.bokehnet")
    print("TOLD " + json.dumps(reports))


main()
