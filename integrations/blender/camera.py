"""What bokehnet is told of Blender's camera: the settings with which its blur is that of Cycles."""

import math

import bpy

__all__ = ["HostError", "camera_settings", "focus_distance"]


class HostError(Exception):
    """A scene that cannot be rendered: one line with what, expected, found, and the way out."""


def focus_distance(camera: bpy.types.Object) -> float:
    """Distance of the plane of focus along the camera's axis, in Blender's units, as Cycles measures it."""
    dof = camera.data.dof
    if dof.focus_object is None:
        return float(dof.focus_distance)
    target = dof.focus_object
    place = target.matrix_world.translation
    if target.type == "ARMATURE" and dof.focus_subtarget in target.pose.bones:
        place = (target.matrix_world @ target.pose.bones[dof.focus_subtarget].matrix).translation
    axis = camera.matrix_world.col[2].xyz.normalized()
    return abs(axis.dot(camera.matrix_world.translation - place))


def _sensor_width(camera: bpy.types.Camera, render: bpy.types.RenderSettings) -> float:
    """Millimetres of the sensor under the width of the picture."""
    width, height = render.resolution_x, render.resolution_y
    fit = camera.sensor_fit
    if fit == "AUTO":
        return float(camera.sensor_width) * min(1.0, width / height)
    if fit == "HORIZONTAL":
        return float(camera.sensor_width)
    return float(camera.sensor_height) * width / height


def camera_settings(scene: bpy.types.Scene, camera: bpy.types.Object) -> dict[str, dict[str, object]]:
    """Return the groups of bokehnet's settings for a camera; one unit of Blender is a metre, as for Cycles.

    Cycles blurs by the radius f / 2N of the opening and keeps the view of the pinhole camera, whatever the
    focus. A real lens moves away from the sensor to focus near, which its blur grows by; an f-number larger
    by as much makes both the same.

    Args:
        scene: Whose picture's size counts.
        camera: As evaluated for the frame.

    Raises:
        HostError: The camera is none that has such a blur.
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
