"""Size of the render of supersampled scenes: twice that of the result.

Two surfaces in pixels at edges stand for the finer pixels.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.pyramid import downsample2
from bokehnet.checks import check_same_size
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.classical.layered.boundaries.supersampled import reduce_supersampled
from bokehnet.io.window import Window
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.scene.scene import RENDER_SUPERSAMPLING, Scene
from bokehnet.settings.settings import RenderSettings

__all__ = ["at_rendered_size", "divided_window", "rendered_surfaces", "settings_in_fine_pixels"]

Array = npt.NDArray[np.float32]


def at_rendered_size(scene: Scene) -> Scene:
    """Return the scene at the size of its render: twice that of the result if it is supersampled.

    Its picture and map contain one sample per pixel; :func:`rendered_surfaces` uses all samples.

    Raises:
        ShapeError: Map and picture differ in size.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.scene.scene import make_scene
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=4)
        >>> at_rendered_size(fine).image.shape  # of a result of 6x8 pixels
        (12, 16, 3)
    """
    factor = scene.supersampled // RENDER_SUPERSAMPLING
    if factor <= 1:
        return scene
    check_same_size("the picture", scene.image, "its map", scene.depth.values)
    one, alpha = slice(factor // 2, None, factor), scene.alpha
    for _ in range(factor.bit_length() - 1 if alpha is not None else 0):
        alpha = downsample2(alpha)
    return replace(
        scene,
        image=scene.image[one, one],
        alpha=alpha,
        depth=replace(scene.depth, values=np.ascontiguousarray(scene.depth.values[one, one]), filtered=None),
        window=divided_window(scene.window, factor),
        supersampled=RENDER_SUPERSAMPLING,
    )


def rendered_surfaces(
    scene: Scene, radii: Callable[[Array], Array], pixel_filter: PixelFilter | None
) -> tuple[Array, Array, KnownSurfaces]:
    """Return picture, defocus and both surfaces of pixels at edges, at the size of the render.

    Args:
        scene: Scene with a higher supersampling than the render.
        radii: Function from a map of that size to blur radii in its pixels.
        pixel_filter: Pixel filter of the fine picture; None if its pixels are single surfaces.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import DefocusMap
        >>> from bokehnet.scene.scene import make_scene
        >>> edge = np.repeat([[1, 1, 1, 1, 1, 8, 8, 8]], 4, axis=0)
        >>> fine = make_scene(np.ones((4, 8, 3)), DefocusMap(map=edge), supersampled=4)
        >>> _, defocus, known = rendered_surfaces(fine, lambda values: 2 * values, None)
        >>> defocus[0].tolist(), known.columns.tolist(), known.coverage.tolist()
        ([2.0, 2.0, 16.0, 16.0], [2, 2], [0.5, 0.5])
    """
    factor, values = scene.supersampled // RENDER_SUPERSAMPLING, scene.depth.values
    fine = np.empty(values.shape, np.float32)
    for i in range(factor):
        for j in range(factor):  # one map of the render's size each: a tilted focus depends on the pixel
            fine[i::factor, j::factor] = factor * radii(np.ascontiguousarray(values[i::factor, j::factor]))
    return reduce_supersampled(scene.image, fine, factor, pixel_filter)


def settings_in_fine_pixels(settings: RenderSettings, factor: int) -> RenderSettings:
    """Return the settings with lengths and positions in pixels of the scene instead of the result.

    Examples:
        >>> from bokehnet.settings.settings import CameraSettings
        >>> settings_in_fine_pixels(RenderSettings(camera=CameraSettings(blur=20)), 2).camera.blur
        40.0
    """
    if factor == 1:
        return settings
    focus, blur = settings.focus, settings.camera.blur
    changes: dict[str, dict[str, Any]] = {"focus": {}, "camera": {}}
    if focus.at is not None:
        changes["focus"]["at"] = _centre_of(focus.at, factor)
    if focus.plane is not None:
        changes["focus"]["plane"] = tuple(_centre_of(pixel, factor) for pixel in focus.plane)
    if blur is not None:
        changes["camera"]["blur"] = factor * blur
    return settings.updated(changes)


def _centre_of(pixel: tuple[int, int], factor: int) -> tuple[int, int]:
    return pixel[0] * factor + factor // 2, pixel[1] * factor + factor // 2


def divided_window(window: Window, factor: int) -> Window:
    """Return a window in pixels that are ``factor`` times as large.

    Examples:
        >>> divided_window(Window.whole(6, 4), 2).width
        3
    """
    return replace(
        window,
        x=window.x // factor,
        y=window.y // factor,
        width=window.width // factor,
        height=window.height // factor,
        display_width=window.display_width // factor,
        display_height=window.display_height // factor,
    )
