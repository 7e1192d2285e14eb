"""Conversion of Blender's camera to bokehnet settings with the same blur as Cycles."""

import math

import bpy

__all__ = ["HostError", "camera_settings", "focus_distance"]


class HostError(Exception):
    """Raised for a scene that cannot be rendered: one line with subject, expected, found, way out."""


def focus_distance(camera: bpy.types.Object) -> float:
    """Return the distance of the focal plane along the camera's axis, in Blender's units, as in Cycles."""
    dof = camera.data.dof
    if dof.focus_object is None:
        return float(dof.focus_distance)
    target = dof.focus_object
    position = target.matrix_world.translation
    if target.type == "ARMATURE" and dof.focus_subtarget in target.pose.bones:
        position = (target.matrix_world @ target.pose.bones[dof.focus_subtarget].matrix).translation
    axis = camera.matrix_world.col[2].xyz.normalized()
    return abs(axis.dot(camera.matrix_world.translation - position))


def _sensor_width(camera: bpy.types.Camera, render: bpy.types.RenderSettings) -> float:
    """Return the width of the sensor that corresponds to the width of the picture, mm."""
    width, height = render.resolution_x, render.resolution_y
    fit = camera.sensor_fit
    if fit == "AUTO":
        return float(camera.sensor_width) * min(1.0, width / height)
    if fit == "HORIZONTAL":
        return float(camera.sensor_width)
    return float(camera.sensor_height) * width / height


def camera_settings(scene: bpy.types.Scene, camera: bpy.types.Object) -> dict[str, dict[str, object]]:
    """Return the groups of bokehnet's settings for a camera; one unit of Blender is a metre, as in Cycles.

    Cycles blurs with the aperture radius f / 2N and keeps the view of the pinhole camera at any focus
    distance. A real lens moves away from the sensor to focus near, which increases its blur; an f-number
    larger by the same factor makes both equal.

    Args:
        scene: Scene that defines the size of the picture.
        camera: Camera evaluated for the frame.

    Raises:
        HostError: The camera has no such blur.
    """
    data, render = camera.data, scene.render
    if data.type != "PERSP":
        raise HostError(f"camera {camera.name}: expected a perspective one, found {data.type}; make it one")
    if render.pixel_aspect_x != render.pixel_aspect_y:
        raise HostError(
            f"output: expected square pixels, found {render.pixel_aspect_x:g}:{render.pixel_aspect_y:g}; "
            "set both aspects to 1"
        )
    focal_length, distance, dof = data.lens / 1000, focus_distance(camera), data.dof
    if distance <= focal_length:
        raise HostError(
            f"camera {camera.name}: expected a focus farther than {focal_length:g} m, its focal length, "
            f"found {distance:g} m; move its focus away"
        )
    ratio = dof.aperture_ratio
    f_number = dof.aperture_fstop * distance / (distance - focal_length) * min(1.0, ratio)
    aperture: dict[str, object] = {}
    if dof.aperture_blades >= 3:
        rotation = math.degrees(dof.aperture_rotation)
        aperture = {"blades": min(dof.aperture_blades, 16), "rotation": rotation}
    if ratio != 1:
        aperture["squeeze"] = min(max(1 / ratio, 0.1), 10.0)
    return {
        "camera": {
            "focal_length": data.lens,
            "f_number": f_number,
            "sensor_width": _sensor_width(data, render),
        },
        "focus": {"distance": distance},
        "aperture": aperture,
    }
