"""Opened picture with its map, painted strokes, and cached views at screen sizes."""

import os
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.resample import resample
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.errors import BokehnetError, ShapeError
from bokehnet.io.color.color_space import LINEAR_REC709, ColorSpace
from bokehnet.io.maps import resize_map
from bokehnet.io.window import Window
from bokehnet.progress import Progress
from bokehnet.scene.blur_strength import completed_blur, equivalent_f_number
from bokehnet.scene.depth.depth_source import depth_source
from bokehnet.scene.focus import disparity_at_pixel
from bokehnet.scene.preparation.recovered_light import is_photograph, recovered_light
from bokehnet.scene.scene import Scene, is_exact, map_at_picture_size, read_scene
from bokehnet.scene.subject import Subject, find_subject
from bokehnet.settings.settings import (
    CameraSettings,
    DepthSettings,
    FocusSettings,
    HighlightSettings,
    InputSettings,
    OutputSettings,
    RenderSettings,
)
from bokehnet.studio.strokes import Stroke, painted

__all__ = ["FLAT_DISPARITY", "ExtraLight", "Opened", "Region", "extra_light", "open_picture", "repaired_map"]

Array = NDArray[np.float32]

_MAX_CACHED_VIEWS = 6

# Environment variable with the maximum number of pixels of a file, and its default.
MAX_PIXELS = ("BOKEHNET_MAX_PIXELS", "64000000")

# Relative difference between the ratios of sides of map and picture above which the map is refused: networks
# round the sides of their maps.
_MAX_SHAPE_DIFFERENCE = 0.03

# Extensions of exports by those of pictures.
_EXPORT_SUFFIXES = {
    **{suffix: suffix for suffix in (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".webp", ".jxl")},
    **dict.fromkeys((".heic", ".heif", ".avif"), ".jpg"),
    **dict.fromkeys((".hdr", ".pfm"), ".exr"),
}

FLAT_DISPARITY = 0.5
"""Relative disparity of a picture without depth."""
_DEFAULT_CAMERA = {"focal_length": 50.0, "f_number": 1.8, "sensor_width": 36.0}


@dataclass(frozen=True, kw_only=True, slots=True)
class Region:
    """Rectangle of the picture, in pixels of the file."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ExtraLight:
    """Estimated light above the stored one in clipped pixels of a photograph.

    Attributes:
        pixels: Indices of these pixels in the flattened picture, (N,).
        light: Scene-linear light to add at strength 1, (N, 3).
        note: Summary in a few words; empty without such pixels.
    """

    pixels: NDArray[np.intp]
    light: Array
    note: str


def open_picture(
    path: Path, settings: RenderSettings, fallback: RenderSettings | None = None, *, report: Progress
) -> tuple[Scene, RenderSettings, RenderSettings]:
    """Read a picture and its map, resized to the picture; a task of the background process.

    Args:
        path: File of the picture. A picture without depth gets a flat map to paint on.
        settings: Settings of the render.
        fallback: Settings to try if the picture cannot be opened with ``settings``.
        report: Progress callback.

    Returns:
        Scene, the settings that it was opened with, and these with the defaults that the picture needs.
    """
    try:
        return _opened_with(path, settings, report)
    except BokehnetError:
        if fallback is None:
            raise
    return _opened_with(path, fallback, report)


def _opened_with(
    path: Path, settings: RenderSettings, report: Progress
) -> tuple[Scene, RenderSettings, RenderSettings]:
    """Read a picture with one choice of settings; see :func:`open_picture`."""
    os.environ.setdefault(*MAX_PIXELS)
    try:
        scene = read_scene(path, settings, source=depth_source(settings), progress=report)
    except BokehnetError:  # no depth; any other error is raised again below
        if any(getattr(settings.input, name) is not None for name in InputSettings.ONE_OF):
            raise
        flat = InputSettings(constant_disparity=FLAT_DISPARITY)
        settings = replace(settings, input=flat, camera=CameraSettings(blur=settings.camera.blur))
        scene = read_scene(path, settings, source=depth_source(settings), progress=report)
    if scene.depth.values.shape != scene.image.shape[:2] and not scene.depth.fits_any_size:
        if not settings.depth.resize:
            _check_shape(scene)
        settings = replace(settings, depth=replace(settings.depth, resize=True))
    values = map_at_picture_size(scene, replace(settings.depth, repair="off"))
    depth = replace(scene.depth, values=values, filtered=None, fits_any_size=False)
    return replace(scene, depth=depth), settings, _completed(settings, scene)


def _check_shape(scene: Scene) -> None:
    """Raise ``ShapeError`` if the map belongs to another picture: if their sides have other ratios."""
    (height, width), (rows, columns) = scene.image.shape[:2], scene.depth.values.shape
    if abs(columns * height / (rows * width) - 1) > _MAX_SHAPE_DIFFERENCE:
        raise ShapeError(
            f"the depth map has {columns}x{rows} pixels, the picture {width}x{height}: expected a map of the "
            "same shape; choose the map of this picture"
        )


def _completed(settings: RenderSettings, scene: Scene) -> RenderSettings:
    """Return the settings with defaults for a missing camera and a missing focus."""
    focus, camera, depth = settings.focus, settings.camera, scene.depth
    if depth.kind == "defocus":
        return settings
    changes: dict[str, dict[str, Any]] = {"camera": {}, "focus": {}}
    near, far = (1.0, 1.0) if focus.value is None else (focus.value, focus.value)
    has_focus = depth.focus is not None or getattr(depth.camera, "focus_distance", None) is not None
    is_set = any(getattr(focus, name) not in (None, "off") for name in FocusSettings.ONE_OF)
    if not has_focus and not is_set:
        subject = find_subject(scene.image, depth.values)
        changes["focus"], near, far = _subject_focus(focus, scene, subject), subject.near, subject.far
    if depth.kind == "relative" and camera.blur is None and camera.f_number is None:
        # A strength becomes a radius with the focus of the opened picture; it stays as the focus moves.
        blur = completed_blur(camera, depth, near, far, _result_window(scene))[0].blur
        assert blur is not None
        changes["camera"] = {"blur": round(blur, 1), "strength": None}
    for name, default in _DEFAULT_CAMERA.items() if depth.kind == "metric" else ():
        if getattr(camera, name) is None and getattr(depth.camera, name, None) is None:
            changes["camera"][name] = default
    return settings.updated(changes)


def _subject_focus(focus: FocusSettings, scene: Scene, subject: Subject) -> dict[str, Any]:
    """Return changes that focus on a subject: its range of depth, or one pixel of it."""
    if focus.tilt_x or focus.tilt_y or focus.range == "off":
        (height, width), (rows, columns) = scene.image.shape[:2], scene.depth.values.shape
        position = zip(subject.position, (width, height), (columns, rows), strict=True)
        return {
            "range": None,
            "at": [x * side // stored // scene.supersampled for x, side, stored in position],
        }
    ends = [subject.far, subject.near]
    if ends[0] == ends[1] and scene.depth.kind == "relative":
        return {"value": ends[0], "range": None}
    if scene.depth.kind == "metric":
        return {"range": [float(f"{1 / (1000 * end):.4g}") for end in reversed(ends) if end > 0]}
    return {"range": [round(min(max(end, 0.0), 1.0), 4) for end in ends]}


def _result_window(scene: Scene) -> Window:
    """Return the window of a scene in pixels of the result."""
    window, factor = scene.window, scene.supersampled
    shown = window.display_width // factor, window.display_height // factor
    return replace(window, display_width=shown[0], display_height=shown[1])


def repaired_map(scene: Scene, mode: Any, *, report: Progress) -> tuple[Array, bool, str]:
    """Return the repaired map, whether edges were moved, and the reason; a task of the background process."""
    repair = DisparityRepair().repair(scene.image, scene.depth.values, mode, report)
    return repair.disparity, repair.repaired, repair.reason


def extra_light(scene: Scene, values: Array, *, report: Progress) -> ExtraLight:
    """Return the estimated light of clipped pixels, as for a render; a task of the background process."""
    recovered = recovered_light(scene, values, HighlightSettings())
    report(1, 1)
    difference = (recovered.image - scene.image).reshape(-1, 3)
    pixels = np.flatnonzero(difference.any(axis=-1))
    return ExtraLight(pixels=pixels, light=difference[pixels], note=recovered.note)


class Opened:
    """Opened picture with its map and strokes.

    Args:
        path: File of the picture.
        scene: Scene from :func:`open_picture`.
        requested: Settings that it was opened with.
        complete: These with defaults.

    Attributes:
        path: File of the picture.
        scene: Scene of the picture.
        strokes: Strokes on the map.
        values: Map (H, W), repaired when the repair has finished.
        repaired: True if edges were moved; None before the repair.
        repair_reason: Reason of the repair or its absence.
        light: Estimated light of clipped pixels; None before its estimate, or without one.
        version: Counter of changes of map and light.
        thumbnails: Cache of thumbnails for the page.
    """

    def __init__(
        self,
        path: Path,
        scene: Scene,
        requested: RenderSettings | None = None,
        complete: RenderSettings | None = None,
    ) -> None:
        self.path, self.scene = path, scene
        self._requested, self._complete = requested, complete
        self.strokes: list[Stroke] = []
        self.values = scene.depth.values
        self.repaired: bool | None = None
        self.repair_reason = ""
        self.light: ExtraLight | None = None
        self.version = 0
        self.thumbnails: OrderedDict[Any, Any] = OrderedDict()
        self._lock = threading.Lock()
        self._views: OrderedDict[Any, tuple[Array, Array, Array | None]] = OrderedDict()

    @property
    def space(self) -> ColorSpace:
        """Colour space of the picture."""
        return LINEAR_REC709 if self.scene.frame is None else self.scene.frame.space

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture, pixels."""
        return self.scene.image.shape[1], self.scene.image.shape[0]

    @property
    def can_be_repaired(self) -> bool:
        """True if the edges of the map may be misaligned."""
        return self.scene.depth.kind != "defocus" and not is_exact(self.scene)

    @property
    def has_clipped_light(self) -> bool:
        """True if a render may estimate clipped light: in photographs, not in files of scene-linear light."""
        return is_photograph(self.scene)

    @property
    def export_suffix(self) -> str:
        """Extension of an export in the format of the picture, ``.png`` if that cannot be written."""
        suffix = self.path.suffix.lower()
        return _EXPORT_SUFFIXES.get(suffix, ".png")

    def equivalents(self, settings: RenderSettings, near: float | None) -> dict[str, float | None]:
        """Return blur radius and full-frame f-number of a relative map, whichever the settings contain.

        Args:
            settings: Settings of the render.
            near: Largest disparity in focus.
        """
        camera, depth = settings.camera, self.scene.depth
        if depth.kind != "relative" or near is None:
            return {}
        window = _result_window(self.scene)
        blur = completed_blur(camera, depth, near, near, window)[0].blur
        stop = camera.f_number
        if stop is None or camera.blur is not None:
            stop = equivalent_f_number(blur, camera, depth, near, window) if blur else None
        return {"blur": blur, "f_number": stop}

    def take_light(self, light: ExtraLight) -> None:
        """Add the estimated light of clipped pixels."""
        self.light = light
        if light.pixels.size:
            with self._lock:
                self.version += 1
                self._views.clear()

    def refocused(self, settings: RenderSettings) -> RenderSettings:
        """Return settings with the defaults for the present map, unless changed since the opening."""
        if self._requested is not None and settings == self._complete:
            depth = replace(self.scene.depth, values=self.values)
            self._complete = settings = _completed(self._requested, replace(self.scene, depth=depth))
        return settings

    def take_repaired(self, values: Array, repaired: bool, reason: str) -> None:
        """Replace the map by the repaired one."""
        self.repaired, self.repair_reason = repaired, reason
        if repaired:
            with self._lock:
                self.values = values
                self.version += 1
                self._views.clear()

    def fitted(self, width: int, height: int) -> tuple[int, int]:
        """Return the largest size within bounds with the picture's aspect ratio, at most its own size."""
        full = self.size
        scale = min(1.0, width / full[0], height / full[1])
        return max(16, round(full[0] * scale)), max(16, round(full[1] * scale))

    def focus_of(self, settings: RenderSettings) -> float | None:
        """Return the focus in the unit of the map; None if it does not follow from the settings alone."""
        focus = settings.focus
        if focus.value is not None:
            return focus.value
        if focus.distance is not None:
            return 1 / (1000 * focus.distance)
        if isinstance(focus.range, tuple):
            ends = (
                [1 / (1000 * end) for end in focus.range]
                if self.scene.depth.kind == "metric"
                else focus.range
            )
            return sum(ends) / 2
        if focus.at is not None:
            depth = replace(self.scene.depth, values=self._painted_in_full())
            return disparity_at_pixel(focus.at, depth, self.scene.window, image=self.scene.image)
        return self.scene.depth.focus

    def view(self, size: tuple[int, int], settings: RenderSettings, region: Region | None = None) -> Scene:
        """Return the scene at another size, or a region at full size, with all strokes on its map.

        Args:
            size: Width and height, pixels.
            settings: Settings with the focus, for strokes that keep areas sharp.
            region: Region at full size; ``size`` is then ignored.
        """
        window = self.scene.window
        if region is None:
            image, values, light = self._resized(size)
            factor = size[0] / self.size[0]
            shown = round(window.display_width * factor), round(window.display_height * factor)
            place = Window(
                x=round(window.x * factor),
                y=round(window.y * factor),
                width=size[0],
                height=size[1],
                display_width=max(shown[0], 1),
                display_height=max(shown[1], 1),
            )
        else:
            (image, values, light), factor = self._resized(self.size), 1.0
            rows = slice(max(region.y, 0), min(region.y + region.height, self.size[1]))
            columns = slice(max(region.x, 0), min(region.x + region.width, self.size[0]))
            image, values = (np.ascontiguousarray(array[rows, columns]) for array in (image, values))
            light = None if light is None else light[rows, columns]
            place = replace(
                window,
                x=window.x + columns.start,
                y=window.y + rows.start,
                width=image.shape[1],
                height=image.shape[0],
            )
        if light is not None:
            light = np.ascontiguousarray(light)
        if region is None and any(stroke.effect == "sharp" for stroke in self.strokes):
            sharp = [stroke for stroke in self.strokes if stroke.effect == "sharp"]
            values = painted(values, image, sharp, self.focus_of(settings))
        if self.scene.depth.kind == "defocus" and factor != 1:
            values = values * np.float32(factor)
        depth = replace(self.scene.depth, values=values, notes=())
        return Scene(image=image, depth=depth, window=place, extra_light=light)

    def painted_map(self, settings: RenderSettings) -> Array:
        """Return the map (H, W) of the whole picture with all strokes."""
        return painted(self.values, self.scene.image, self.strokes, self.focus_of(settings))

    def at_size(self, settings: RenderSettings, factor: float) -> RenderSettings:
        """Return the settings for a view scaled by ``factor``, without files and repair."""
        table = {group: dict(fields) for group, fields in settings.to_table().items()}
        for group in (InputSettings.GROUP, DepthSettings.GROUP, OutputSettings.GROUP):
            table.pop(group, None)
        table["depth"] = {"repair": "off", "mixed": "off", "pixel_filter": settings.depth.pixel_filter}
        table.get("engine", {}).pop("max_memory", None)
        camera, focus, effects = (table.setdefault(name, {}) for name in ("camera", "focus", "effects"))
        factor /= self.scene.supersampled
        if "blur" in camera:
            camera["blur"] *= factor
        if effects.get("grain_size"):
            effects["grain_size"] *= factor
        tilted = focus.get("tilt_x") or focus.get("tilt_y")
        if "at" in focus and tilted:
            focus["at"] = [int(side * factor) for side in focus["at"]]
        elif "at" in focus:
            del focus["at"]
            disparity = self.focus_of(settings)
            assert disparity is not None
            if self.scene.depth.kind == "metric":
                focus["distance"] = 1 / (1000 * disparity) if disparity > 0 else float("inf")
            else:
                focus["value"] = float(np.clip(disparity, 0, 1))
        if "plane" in focus:
            focus["plane"] = [[int(side * factor) for side in pixel] for pixel in focus["plane"]]
        return RenderSettings().updated(table)

    def change_strokes(self, strokes: Sequence[Stroke]) -> None:
        """Replace the strokes on the map."""
        with self._lock:
            self.strokes = list(strokes)
            self.version += 1
            self._views.clear()

    def _resized(self, size: tuple[int, int]) -> tuple[Array, Array, Array | None]:
        """Return picture, map with strokes but for those at the focus, and extra light at a size; cached."""
        with self._lock:
            if size not in self._views:
                width, height = size
                image, values, light = self.scene.image, self.values, self._extra_light()
                if size != self.size:
                    image, values = resample(image, height, width, "area"), resize_map(values, height, width)
                    light = None if light is None else resample(light, height, width, "area")
                static = [stroke for stroke in self.strokes if stroke.effect != "sharp"]
                self._views[size] = image, painted(values, image, static) if static else values, light
                while len(self._views) > _MAX_CACHED_VIEWS:
                    self._views.popitem(last=False)
            self._views.move_to_end(size)
            return self._views[size]

    def _extra_light(self) -> Array | None:
        """Return the extra light of all pixels, (H, W, 3); None if there is none."""
        if self.light is None or not self.light.pixels.size:
            return None
        result = np.zeros_like(self.scene.image)
        result.reshape(-1, 3)[self.light.pixels] = self.light.light
        return result

    def _painted_in_full(self) -> Array:
        return self._resized(self.size)[1]
