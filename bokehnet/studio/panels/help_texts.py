"""Labels and help texts of the page, where those of the command line name options."""

from collections.abc import Mapping
from typing import Any

__all__ = ["HELP_TEXTS", "LABELS", "label_of", "words_of_change"]

LABELS = {
    "focus.value": "Focus, far to near",
    "focus.distance": "Focus distance",
    "focus.at": "Focus on a pixel",
    "focus.range": "Sharp from, to",
    "focus.plane": "Plane through three pixels",
    "camera.blur": "Blur radius",
    "camera.f_number": "F-number",
    "highlights.threshold": "Clipped lights",
    "highlights.strength": "Light of lamps",
    "highlights.gain": "Light of white",
    "lens.name": "Lens",
}
"""Labels of settings whose names need their group, by path."""

HELP_TEXTS = {
    "depth.unit": "Unit of a depth map: m, cm, mm, in, ft or 1/m, with a scale before it if needed: 1/256m.",
    "depth.kind": (
        "Distance in the map: planar (along the lens axis), ray (straight from the camera) or zbuffer (of"
        " a graphics card, with the near and far distance below)."
    ),
    "depth.near": "Distance of the stored value 0, metres.",
    "depth.far": "Distance of the stored value 1, metres.",
    "depth.invert": "The map shows far things bright.",
    "depth.value_range": (
        "Values of the map that count as farthest and nearest. Default: its lowest and highest."
    ),
    "depth.mixed": "Repair edge pixels whose depth lies between two surfaces. auto: where there are many.",
    "focus.value": "Where the picture is sharp, 0 (farthest) to 1 (nearest). For maps without a unit.",
    "focus.distance": "Distance at which the picture is sharp, metres. For maps in metres.",
    "focus.range": (
        "Everything between both ends stays sharp: metres, or 0 (farthest) to 1 (nearest). The studio "
        "starts with the range of the subject."
    ),
    "focus.tilt_x": (
        "Tilt of the plane in focus, degrees, as by a tilting lens: positive is sharp nearer at the top, "
        "negative nearer at the bottom. A negative tilt along the ground makes a miniature."
    ),
    "camera.blur": (
        "Radius of a point of light at the nearest point, with the focus at the farthest. For maps "
        "without a unit."
    ),
    "camera.strength": (
        "Blur strength, 0 to 100: at 50 the largest disc of light has a radius of 4 % of the longer side."
    ),
    "camera.focal_length": (
        "Focal length, mm: of the camera that took the picture, or of the full-frame camera whose "
        "f-number you set. Default: from the file."
    ),
    "camera.f_number": (
        "Aperture of the lens: f/1.4 blurs twice as much as f/2.8. For a map without a unit that of a "
        "full-frame camera with the nearest point at 1 m."
    ),
    "camera.sensor_width": "Width of the sensor, mm; 36 is full frame. Default: from the file.",
    "aperture.curvature": "Shape of the blades: 0 is a polygon, 1 a circle.",
    "aperture.onion_rings": (
        "Number of rings of the onion, as polished aspheres leave them in discs of light."
    ),
    "aperture.grain_seed": "Another number gives other grain inside the discs.",
    "lens.name": "A lens of the catalogue, with all its aberrations.",
    "lens.aberrations": (
        "Trace rays through the glass (traced), or use third-order theory (seidel), which is quicker."
    ),
    "lens.engine": (
        "Aberrations at every place of the picture (map), or those of its middle everywhere (profile)."
    ),
    "lens.f_number": "F-number of the chosen lens. Default: the camera's, else wide open.",
    "lens.distortion": "Bend straight lines as the chosen lens does, for a picture without distortion.",
    "lens.vignetting": "Darken the corners as the chosen lens does.",
    "lens.focusing": (
        "Focus where the blur is smallest (sharpest), or where rays near the axis meet (paraxial)."
    ),
    "lens.copy_to_copy": (
        "Misalignment of the elements as in one manufactured copy: 0 as designed, up to 10."
    ),
    "lens.copy_seed": "Number of the copy; each is misaligned in its own way.",
    "highlights.strength": (
        "Light of clipped lamps and windows: 0 leaves them as stored, 1 is the estimate, at most 4."
    ),
    "highlights.gain": "With a threshold above: light to which white is raised, in units of white.",
    "light.pixel_pitch": "Size of a pixel on the sensor, micrometres, for rings and stars of diffraction.",
    "light.ghosts": (
        "Reflections of lights between the surfaces of the chosen lens: coating none, single or ideal."
    ),
    "light.lamps": "Light from which a pixel counts as a lamp for rings, stars and ghosts; 1 is white.",
    "light.glare_core": "Radius of the flat core of the glare, percent of half the diagonal.",
    "light.glare_slope": "Falloff of the glare: 1 slow, 4 steep.",
    "effects.optical_vignetting": (
        "Darkening of the corners by the lens barrel; goes with cat's-eye discs of the same value."
    ),
    "effects.vignette_radius": "Beginning of the vignette: 0 in the middle, 1 in the corner.",
    "effects.vignette_softness": "Width of the transition of the vignette.",
    "effects.vignette_roundness": "Shape of the vignette: 1 is a circle, 0 an ellipse of the frame.",
    "effects.vignette_color_loss": "Loss of colour in the corners.",
    "effects.grain_size": "Size of the film grain, pixels.",
    "effects.grain_mono": "Grain without colour, as in film.",
    "effects.grain_seed": "Another number gives other grain.",
    "output.expected_error": "Store the expected error of each pixel beside an EXR picture.",
}
"""Help texts in the words of photography, by path."""


def label_of(path: str) -> str:
    """Return the label of a setting in the studio.

    Args:
        path: Group and field, such as ``camera.blur``.
    """
    return LABELS.get(path, path.partition(".")[2].replace("_", " ").capitalize())


def words_of_change(changes: Mapping[str, Any]) -> str:
    """Return words for a change of settings: the label of its control, or the name of its group."""
    paths = [f"{group}.{name}" for group, fields in changes.items() for name in fields]
    if "focus" in changes or not paths:
        return "Focus" if "focus" in changes else ", ".join(changes).capitalize()
    return label_of(paths[0])
