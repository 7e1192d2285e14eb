"""Overlays of the preview: depth, focus plane, likely errors; and the aperture image."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ParameterError
from bokehnet.io.color.color_space import SRGB
from bokehnet.io.window import Window
from bokehnet.render.renderer import BokehRenderer
from bokehnet.scene.depth.depth_source import DefocusMap
from bokehnet.scene.scene import make_scene
from bokehnet.settings.settings import RenderSettings
from bokehnet.studio.opened import Opened
from bokehnet.studio.preview.display import to_rgba
from bokehnet.studio.preview.preview import Picture, quick_settings

__all__ = ["aperture_image", "overlay", "plain"]

Array = NDArray[np.float32]

_MAX_SHARP_RADIUS_PX = 0.75  # maximum blur radius of a pixel in focus

# From far to near: dark blue, teal, sand, white; uniform in lightness, so that grey prints work as well.
_DEPTH_COLORS = np.array([[20, 24, 70], [20, 110, 130], [200, 170, 110], [255, 250, 240]], np.float32)
_NEAR, _FAR, _IN_FOCUS, _LIKELY_ERROR = (235, 140, 40), (60, 120, 235), (70, 230, 120), (235, 60, 60)
_LIGHT = (255, 220, 40)

_FULL_LIGHT = 8.0  # estimated light at which the overlay is opaque, relative to white

_PSF_SIDE, _PSF_RADIUS = 96, 40  # pixels
_PSF_MARGIN = 64  # pixels around, to avoid effects of the border
_PSF_PICTURE = 4096  # size of the picture with the point, pixels


def plain(opened: Opened, size: tuple[int, int], shown: str) -> Picture:
    """Return the picture before any blur."""
    scene = opened.view(size, RenderSettings().updated({"highlights": {"threshold": "off"}}))
    return Picture(stage="plain", rgba=to_rgba(scene.image, opened.space, shown), facts={})


def overlay(opened: Opened, settings: RenderSettings, size: tuple[int, int], kind: str) -> Picture:
    """Return an overlay (H, W, 4) for the preview.

    Args:
        opened: Opened picture.
        settings: Settings with the focus.
        size: Width and height, pixels.
        kind: ``depth``: near is light; ``unrepaired``: the same for the map before its repair and without
            strokes; ``focus``: sharp is green, in front orange, behind blue;
            ``confidence``: red where depth edges or the repair of the map may be wrong; ``light``: yellow
            where clipped light was estimated, the brighter the denser.

    Raises:
        ParameterError: The kind is unknown.
    """
    overlays: dict[str, Callable[[Opened, RenderSettings, tuple[int, int]], NDArray[np.uint8]]] = {
        "depth": _depth,
        "unrepaired": _unrepaired_depth,
        "focus": _focus,
        "confidence": _confidence,
        "light": _light,
    }
    if kind not in overlays:
        raise ParameterError("kind", f"one of {', '.join(overlays)}", kind)
    return Picture(stage=kind, rgba=overlays[kind](opened, settings, size), facts={})


def aperture_image(settings: RenderSettings) -> Picture:
    """Return images of a point of light behind focus, in the middle and in the upper right corner.

    Engine scatter renders both; the brightest 1 % is white.
    """
    renderer, table = BokehRenderer("scatter"), quick_settings(settings).to_table()
    for group in ("focus", "camera", "input", "depth", "effects", "highlights"):
        table.pop(group, None)
    quick = RenderSettings().updated({**table, "depth": {"repair": "off"}})
    side, shown = _PSF_SIDE + 2 * _PSF_MARGIN, slice(_PSF_MARGIN, _PSF_MARGIN + _PSF_SIDE)
    radii = np.full((side, side), -_PSF_RADIUS, np.float32)
    point = np.zeros((side, side, 3), np.float32)
    point[side // 2, side // 2] = 1.0
    panels = []
    for left, top in (
        (_PSF_PICTURE // 2 - side // 2, _PSF_PICTURE // 2 - side // 2),
        (_PSF_PICTURE - side, 0),
    ):
        window = Window(
            x=left, y=top, width=side, height=side, display_width=_PSF_PICTURE, display_height=_PSF_PICTURE
        )
        light = renderer.render(make_scene(point, DefocusMap(map=radii), window=window), quick).bokeh
        bright = float(np.quantile(light[shown, shown], 0.99)) or 1.0
        panels.append(to_rgba(light[shown, shown] / np.float32(bright), SRGB))
    return Picture(stage="aperture", rgba=np.ascontiguousarray(np.concatenate(panels, axis=1)), facts={})


def _depth(opened: Opened, settings: RenderSettings, size: tuple[int, int]) -> NDArray[np.uint8]:
    values = opened.view(size, settings).depth.values
    low, high = float(values.min()), float(values.max())
    position = (values - low) / ((high - low) or 1.0) * (len(_DEPTH_COLORS) - 1)
    below = np.clip(position.astype(int), 0, len(_DEPTH_COLORS) - 2)
    weight = (position - below)[..., None]
    colors = _DEPTH_COLORS[below] * (1 - weight) + _DEPTH_COLORS[below + 1] * weight
    return _opaque(colors)


def _unrepaired_depth(opened: Opened, settings: RenderSettings, size: tuple[int, int]) -> NDArray[np.uint8]:
    return _depth(Opened(opened.path, opened.scene), settings, size)


def _focus(opened: Opened, settings: RenderSettings, size: tuple[int, int]) -> NDArray[np.uint8]:
    defocus = _defocus(opened, settings, size)
    strength = np.clip(np.abs(defocus) / max(float(np.abs(defocus).max()), 1e-6), 0, 1)
    result = np.zeros((*defocus.shape, 4), np.uint8)
    result[..., :3] = np.where(defocus[..., None] > 0, np.array(_NEAR, np.uint8), np.array(_FAR, np.uint8))
    result[..., 3] = np.rint(40 + 130 * strength)
    result[np.abs(defocus) <= _MAX_SHARP_RADIUS_PX] = (*_IN_FOCUS, 150)
    return result


def _confidence(opened: Opened, settings: RenderSettings, size: tuple[int, int]) -> NDArray[np.uint8]:
    quick = quick_settings(opened.at_size(settings, size[0] / opened.size[0]))
    scene = opened.view(size, settings)
    error_map = BokehRenderer("scatter").render(scene, quick).error_map
    if opened.repaired:  # moved edges were wrong before, and may still be
        original = Opened(opened.path, opened.scene).view(size, settings).depth.values
        span = float(np.ptp(original)) or 1.0
        moved = np.clip(4 * np.abs(original - scene.depth.values) / span, 0, 1)
        error_map = np.maximum(error_map, moved)
    result = np.zeros((*error_map.shape, 4), np.uint8)
    result[..., :3] = _LIKELY_ERROR
    result[..., 3] = np.rint(190 * np.clip(error_map, 0, 1))
    return result


def _light(opened: Opened, settings: RenderSettings, size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the places of estimated light, black elsewhere."""
    light = opened.view(size, settings).extra_light if settings.highlights.threshold == "auto" else None
    extra = np.zeros(size[::-1], np.float32) if light is None else light.max(axis=-1)
    extra = extra * np.float32(settings.highlights.strength)
    result = np.zeros((*extra.shape, 4), np.uint8)
    result[..., :3] = _LIGHT
    density = np.clip(np.log2(1 + np.maximum(extra, 0)) / np.log2(1 + _FULL_LIGHT), 0, 1)
    result[..., 3] = np.rint(np.where(extra > 0.01, 110 + 130 * density, 0))
    result[extra <= 0.01] = (0, 0, 0, 150)
    return result


def _defocus(opened: Opened, settings: RenderSettings, size: tuple[int, int]) -> Array:
    quick = quick_settings(opened.at_size(settings, size[0] / opened.size[0]))
    focused = BokehRenderer("scatter").prepare(opened.view(size, settings), quick)
    return focused.defocus


def _opaque(colors: NDArray[np.floating]) -> NDArray[np.uint8]:
    result = np.full((*colors.shape[:2], 4), 255, np.uint8)
    result[..., :3] = np.rint(colors)
    return result
