"""Pixel filter of a picture: set by the user, known from its file, or estimated from its edges."""

from bokehnet.classical.layered.boundaries.edge_spread import estimate_filter
from bokehnet.optics.pixels.pixel_filter import FilterChoice, parse_pixel_filter
from bokehnet.scene.scene import Scene

__all__ = ["choose_filter"]


def choose_filter(scene: Scene, setting: str) -> FilterChoice:
    """Return the pixel filter of a scene's picture.

    Args:
        scene: Scene of the picture.
        setting: Name of a filter or a renderer, or ``auto``: the filter of the renderer that wrote the file,
            else an estimate from the edges of the picture and of its map.

    Examples:
        >>> import numpy as np
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> flat = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25))
        >>> str(choose_filter(flat, "arnold"))
        'gaussian:2 (as set)'
        >>> str(choose_filter(flat, "auto"))
        'blackman-harris:1.5 (by default: 0 clear edges)'
    """
    if setting != "auto":
        return FilterChoice(pixel_filter=parse_pixel_filter(setting), reason="as set")
    renderer = None if scene.frame is None else scene.frame.renderer
    if renderer is not None:
        reason = f"of {renderer}, which wrote the file"
        return FilterChoice(pixel_filter=parse_pixel_filter(renderer), reason=reason)
    values = scene.depth.values
    return estimate_filter(scene.image, values if values.shape == scene.image.shape[:2] else None)
