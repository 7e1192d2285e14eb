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
from bokehnet.errors import BokehnetError
from bokehnet.io.color.color_space import LINEAR_REC709, ColorSpace
from bokehnet.io.maps import resize_map
from bokehnet.io.window import Window
from bokehnet.progress import Progress
from bokehnet.scene.blur_strength import completed_blur
from bokehnet.scene.depth.depth_source import depth_source
from bokehnet.scene.focus import disparity_at_pixel
from bokehnet.scene.scene import Scene, is_exact, map_at_picture_size, read_scene
from bokehnet.scene.subject import find_subject
from bokehnet.settings.settings import (
    CameraSettings,
    DepthSettings,
    FocusSettings,
    InputSettings,
    OutputSettings,
    RenderSettings,
)
from bokehnet.studio.strokes import Stroke, painted

__all__ = ["Opened", "Region", "open_picture", "repaired_map"]

Array = NDArray[np.float32]

_MAX_CACHED_VIEWS = 6

# Environment variable with the maximum number of pixels of a file, and its default.
MAX_PIXELS = ("BOKEHNET_MAX_PIXELS", "64000000")

_FLAT_DISPARITY = 0.5  # relative disparity of a picture without depth
_DEFAULT_BLUR = 0.04  # relative to the width, as for a fast lens
_DEFAULT_CAMERA = {"focal_length": 50.0, "f_number": 1.8, "sensor_width": 36.0}


@dataclass(frozen=True, kw_only=True, slots=True)
class Region:
    """Rectangle of the picture, in pixels of the file."""

    x: int
    y: int
    width: int
    height: int


def open_picture(path: Path, settings: RenderSettings, *, report: Progress) -> tuple[Scene, RenderSettings]:
    """Read a picture and its map, resized to the picture; a task of the background process.

    Args:
        path: File of the picture. A picture without depth gets a flat map to paint on.
        settings: Settings of the render; missing ones that the picture needs are added.
        report: Progress callback.
    """
    os.environ.setdefault(*MAX_PIXELS)
    try:
        scene = read_scene(path, settings, source=depth_source(settings), progress=report)
    except BokehnetError:  # no depth; any other error is raised again below
        if any(getattr(settings.input, name) is not None for name in InputSettings.ONE_OF):
            raise
        flat = InputSettings(constant_disparity=_FLAT_DISPARITY)
        settings = replace(settings, input=flat, camera=CameraSettings(blur=settings.camera.blur))
        scene = read_scene(path, settings, source=depth_source(settings), progress=report)
    if scene.depth.values.shape != scene.image.shape[:2] and not scene.depth.fits_any_size:
        settings = replace(settings, depth=replace(settings.depth, resize=True))
    values = map_at_picture_size(scene, replace(settings.depth, repair="off"))
    depth = replace(scene.depth, values=values, filtered=None, fits_any_size=False)
    return replace(scene, depth=depth), _completed(settings, scene)


def _completed(settings: RenderSettings, scene: Scene) -> RenderSettings:
    """Return the settings with defaults for a missing camera and a missing focus."""
    height, width = (side // scene.supersampled for side in scene.image.shape[:2])
    focus, camera, depth = settings.focus, settings.camera, scene.depth
    if depth.kind == "defocus":
        return settings
    changes: dict[str, dict[str, Any]] = {"camera": {}, "focus": {}}
    if depth.kind == "relative" and camera.blur is None:
        if camera.strength is None and camera.f_number is None:
            changes["camera"]["blur"] = float(round(_DEFAULT_BLUR * width))
        else:  # the page shows a radius; the focus moves, so that of the nearest point counts
            blur = completed_blur(camera, depth, 1.0, 1.0, scene.window)[0].blur
            changes["camera"] = {"blur": blur, "strength": None, "f_number": None, "focal_length": None}
    for name, default in _DEFAULT_CAMERA.items() if depth.kind == "metric" else ():
        if getattr(camera, name) is None and getattr(depth.camera, name, None) is None:
            changes["camera"][name] = default
    has_focus = depth.focus is not None or getattr(depth.camera, "focus_distance", None) is not None
    if not has_focus and all(getattr(focus, name) is None for name in FocusSettings.ONE_OF):
        x, y = find_subject(scene.image, depth.values).position
        rows, columns = depth.values.shape
        changes["focus"]["at"] = [x * width // columns, y * height // rows]
    return settings.updated(changes)


def repaired_map(scene: Scene, mode: Any, *, report: Progress) -> tuple[Array, bool, str]:
    """Return the repaired map, whether edges were moved, and the reason; a task of the background process."""
    repair = DisparityRepair().repair(scene.image, scene.depth.values, mode, report)
    return repair.disparity, repair.repaired, repair.reason


class Opened:
    """Opened picture with its map and strokes.

    Args:
        path: File of the picture.
        scene: Scene from :func:`open_picture`.

    Attributes:
        path: File of the picture.
        scene: Scene of the picture.
        strokes: Strokes on the map.
        undone: Undone strokes, for redo; the latest is last.
        values: Map (H, W), repaired when the repair has finished.
        repaired: True if edges were moved; None before the repair.
        repair_reason: Reason of the repair or its absence.
        version: Counter of changes of the map.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        self.path, self.scene = path, scene
        self.strokes: list[Stroke] = []
        self.undone: list[Stroke] = []
        self.values = scene.depth.values
        self.repaired: bool | None = None
        self.repair_reason = ""
        self.version = 0
        self._lock = threading.Lock()
        self._views: OrderedDict[Any, tuple[Array, Array]] = OrderedDict()

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
            image, values = self._resized(size)
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
            image, values, factor = self.scene.image, self._painted_in_full(), 1.0
            rows = slice(max(region.y, 0), min(region.y + region.height, self.size[1]))
            columns = slice(max(region.x, 0), min(region.x + region.width, self.size[0]))
            image, values = (np.ascontiguousarray(array[rows, columns]) for array in (image, values))
            place = replace(
                window,
                x=window.x + columns.start,
                y=window.y + rows.start,
                width=image.shape[1],
                height=image.shape[0],
            )
        if region is None and any(stroke.effect == "sharp" for stroke in self.strokes):
            sharp = [stroke for stroke in self.strokes if stroke.effect == "sharp"]
            values = painted(values, image, sharp, self.focus_of(settings))
        if self.scene.depth.kind == "defocus" and factor != 1:
            values = values * np.float32(factor)
        return Scene(image=image, depth=replace(self.scene.depth, values=values, notes=()), window=place)

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

    def change_strokes(self, strokes: Sequence[Stroke], undone: Sequence[Stroke] = ()) -> None:
        """Replace the strokes on the map."""
        with self._lock:
            self.strokes, self.undone = list(strokes), list(undone)
            self.version += 1
            self._views.clear()

    def _resized(self, size: tuple[int, int]) -> tuple[Array, Array]:
        """Return picture and map at a size, with strokes that do not depend on the focus; cached."""
        with self._lock:
            if size not in self._views:
                width, height = size
                image, values = self.scene.image, self.values
                if size != self.size:
                    image, values = resample(image, height, width, "area"), resize_map(values, height, width)
                static = [stroke for stroke in self.strokes if stroke.effect != "sharp"]
                self._views[size] = image, painted(values, image, static) if static else values
                while len(self._views) > _MAX_CACHED_VIEWS:
                    self._views.popitem(last=False)
            self._views.move_to_end(size)
            return self._views[size]

    def _painted_in_full(self) -> Array:
        return self._resized(self.size)[1]
