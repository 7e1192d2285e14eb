"""Supersampled scenes: picture and map at a multiple of the result's size.

They are rendered at twice the size of the result, with two surfaces in pixels at edges, and filtered down.
Edges thus keep their subpixel positions at a fraction of the cost of rendering all fine pixels.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from bokehnet.engines.engine import EngineResult
from bokehnet.io.frame import Frame
from bokehnet.optics.pixels.pixel_filter import PixelFilter
from bokehnet.optics.pixels.supersampling import downsample
from bokehnet.scene.preparation.rendered_size import divided_window
from bokehnet.scene.scene import FocusedScene

__all__ = [
    "RAY_FRACTION",
    "reduced_defocus",
    "reduced_result",
    "reduced_scene",
]

# Rays per pixel relative to the usual number; each pixel of the result still gets twice as many.
RAY_FRACTION = 0.5

Array = npt.NDArray[np.float32]


def reduced_scene(scene: FocusedScene, bokeh: Array, alpha: Array | None) -> FocusedScene:
    """Return the scene with window and frame of the reduced result.

    Examples:
        >>> from bokehnet.io.window import Window
        >>> image, window = np.ones((4, 6, 3), np.float32), Window.whole(6, 4)
        >>> scene = FocusedScene(
        ...     image=image, defocus=image[..., 0], alpha=None, window=window, number=0, frame=None,
        ...     lens=None, supersampled=2
        ... )
        >>> reduced_scene(scene, image[::2, ::2], None).window.width
        3
    """
    window = divided_window(scene.window, scene.supersampled)
    frame: Frame | None = scene.frame
    if frame is not None:
        frame = replace(frame, image=bokeh, alpha=alpha, window=window)
    return replace(scene, window=window, frame=frame)


def reduced_result(rendered: EngineResult, factor: int, pixel_filter: PixelFilter) -> EngineResult:
    """Return the result of an engine, filtered down to the size of the result.

    Examples:
        >>> from bokehnet.engines.engine import Engine
        >>> rendered = Engine("scatter").render(np.ones((8, 8, 3)), np.full((8, 8), 4.0))
        >>> small = reduced_result(rendered, 2, PixelFilter("box", 1))
        >>> small.bokeh.shape, small.largest_blur
        ((4, 4, 3), 2.0)
    """
    bokeh = downsample(rendered.bokeh, factor, pixel_filter)
    classical = rendered.classical
    if classical is not None:
        classical = bokeh if classical is rendered.bokeh else downsample(classical, factor, pixel_filter)
    neural, expected = rendered.neural, rendered.expected_error
    return replace(
        rendered,
        bokeh=bokeh,
        classical=classical,
        neural=None if neural is None else downsample(neural, factor, pixel_filter),
        error_map=downsample(rendered.error_map, factor, pixel_filter),
        expected_error=None
        if expected is None
        else np.maximum(downsample(expected, factor, pixel_filter), 0),
        largest_blur=rendered.largest_blur / factor,
    )


def reduced_defocus(defocus: Array, factor: int) -> Array:
    """Return blur radii in pixels of the result, (H, W), sampled at one fine pixel each.

    Examples:
        >>> reduced_defocus(np.array([[1, 2], [3, 4]], np.float32), 2).tolist()
        [[2.0]]
    """
    return np.ascontiguousarray(defocus[factor // 2 :: factor, factor // 2 :: factor]) / np.float32(factor)
