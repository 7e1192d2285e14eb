"""Scene: a picture, its depth map, and further information of its file."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample, same_aspect
from bokehnet.checks import check_floats, check_light, check_map, check_same_size
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.depth_repair.mixed_pixels import mixed_pixel_fraction, repair_mixed
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.depth_repair.repeated_pixels import undo_pixel_repetition
from bokehnet.errors import ParameterError
from bokehnet.io.frame import Frame, read_frame, without_origin
from bokehnet.io.maps import resize_map
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.optics.pixels.pixel_filter import FilterChoice
from bokehnet.progress import Progress, part_of
from bokehnet.scene.black_bars import BlackBars
from bokehnet.scene.depth.depth_source import (
    DepthMap,
    DepthSource,
    Photo,
    depth_source,
    unit_of_picture_depth,
)
from bokehnet.scene.depth.map_checks import check_map_size
from bokehnet.scene.focus import FocusedLens
from bokehnet.scene.focus_checks import check_focus
from bokehnet.scene.known_edges import check_matte, deep_surfaces, read_matte
from bokehnet.settings.settings import DepthSettings, RenderSettings

__all__ = [
    "RENDER_SUPERSAMPLING",
    "FocusedScene",
    "Scene",
    "check_repair_allowed",
    "is_exact",
    "is_repaired",
    "make_scene",
    "map_at_picture_size",
    "read_scene",
]

# Minimum fraction of mixed pixels at depth edges of a map that was filtered like its picture.
_MIN_MIXED_FRACTION = 0.05

# Size at which supersampled scenes are rendered, relative to the result.
RENDER_SUPERSAMPLING = 2

Array = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """Picture and depth, created by :func:`make_scene` or :func:`read_scene`.

    Attributes:
        image: All-in-focus picture, scene-linear light over black, (H, W, 3).
        depth: Depth map as returned by its source.
        alpha: Coverage, (H, W); None if all is covered.
        window: Position of the pixels in the shown picture, whose width spans the sensor.
        number: Frame number in its sequence.
        frame: Further content of the picture's file, for writing it back; None for arrays.
        notes: Automatic choices and warnings about picture and map, one line each.
        matte: Coverage of each pixel by a foreground, (H, W), 0 to 1; None if unknown.
        known: Both surfaces of pixels at edges, in the unit of the map, where they are known.
        supersampled: Size of picture, map and window relative to the result: 1, 2 or 4.
        light_sums: Light of its clipped regions according to its shot, (regions, 3); None to estimate it
            from this picture alone. See :func:`bokehnet.light.temporal.steady_sums`.
        extra_light: Known light above the stored one in clipped pixels, (H, W, 3); None to estimate it.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> scene = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), number=1001)
        >>> scene, scene.number, float(scene.depth.values.max())
        (<Scene: 32x24, relative depth>, 1001, 0.25)
    """

    image: Array
    depth: DepthMap
    alpha: Array | None = None
    window: Window
    number: int = 0
    frame: Frame | None = None
    notes: tuple[str, ...] = ()
    matte: Array | None = None
    known: KnownSurfaces | None = None
    supersampled: int = 1
    light_sums: npt.NDArray[np.float64] | None = None
    extra_light: Array | None = None

    def __repr__(self) -> str:
        """Return size and kind of depth in one line, without the arrays."""
        height, width = self.image.shape[:2]
        return f"<Scene: {width}x{height}, {self.depth.kind} depth>"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FocusedScene:
    """Scene with its focus: everything that the blur depends on.

    Attributes:
        image: As in :class:`Scene`.
        defocus: Signed blur radius of each pixel, (H, W), pixels, positive in front of focus.
        alpha: As in the scene.
        window: As in the scene.
        number: As in the scene.
        frame: As in the scene.
        lens: Lens with its focus; None for a defocus map.
        repaired: True if edges of the map were moved; None if the repair did not run.
        repair_reason: Reason of the repair or its absence.
        repair_plan: Decisions of the repair, which the other frames of a shot may follow.
        pixel_filter: Pixel filter for unmixing at edges; None if the engine does no unmixing.
        notes: Notes of the scene, and warnings about the blur.
        known: Both surfaces of pixels at edges, with their blur radii, where they are known.
        supersampled: Size of the arrays and the window relative to the result: 1 or 2. Blur radii are in
            pixels of these arrays.
        layers: Successive surfaces with their blur radii, where they are known.
        focus_again: Function that :meth:`refocus` calls; None if the picture was not kept.
        assumptions: Values and facts that neither settings nor files define, a few words each.
        light: Recovered light for the summary, a few words; empty if none was recovered.
        bars: Black bars around these arrays in the picture; None without bars.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> flat = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.75))
        >>> changes = {"camera": {"blur": 8}, "focus": {"value": 0.5}, "depth": {"repair": "off"}}
        >>> focused = BokehRenderer("scatter").prepare(flat, RenderSettings().updated(changes))
        >>> focused.lens.near, float(focused.defocus.max())  # disparity in focus, blur radius in pixels
        (0.5, 2.0)
    """

    image: Array
    defocus: Array
    alpha: Array | None
    window: Window
    number: int
    frame: Frame | None
    lens: FocusedLens | None
    repaired: bool | None = None
    repair_reason: str = ""
    repair_plan: RepairPlan | None = None
    pixel_filter: FilterChoice | None = None
    notes: tuple[str, ...] = ()
    known: KnownSurfaces | None = None
    supersampled: int = 1
    layers: Layers | None = None
    assumptions: tuple[str, ...] = ()
    bars: BlackBars | None = None
    light: str = ""
    focus_again: Callable[..., "FocusedScene"] | None = field(default=None, repr=False)

    def refocus(self, value: float | None = None, **focus: Any) -> "FocusedScene":
        """Return the scene with another focus, without another repair of its map.

        Args:
            value: Disparity in focus, 0 to 1; with metric depth the distance, metres.
            **focus: Fields of :class:`~bokehnet.settings.settings.FocusSettings` instead, such as
                ``at=(120, 80)`` or ``range=(0.4, 0.6)``. Without any the focus falls on the subject.

        Raises:
            ParameterError: The picture was not kept, or a value does not apply to the map.

        Examples:
            >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
            >>> from bokehnet.render.renderer import BokehRenderer
            >>> flat = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.75))
            >>> changes = {"camera": {"blur": 8}, "focus": {"value": 0.5}}
            >>> focused = BokehRenderer("scatter").prepare(flat, RenderSettings().updated(changes))
            >>> float(focused.refocus(0.25).defocus.max())  # pixels
            4.0
        """
        if self.lens is None or self.focus_again is None:
            expected = "a scene prepared by a renderer that keeps pictures, without `engine.max_memory`"
            if self.lens is None:
                expected = "a scene with a depth map; a defocus map is already focused"
            raise ParameterError("refocus", expected, shown="another")
        if value is not None:
            focus = {"value" if self.lens.camera is None else "distance": value, **focus}
        return self.focus_again(**focus)


def make_scene(
    image: npt.NDArray[np.floating],
    source: DepthSource,
    *,
    alpha: npt.NDArray[np.floating] | None = None,
    camera: Camera | None = None,
    window: Window | None = None,
    number: int = 0,
    matte: npt.NDArray[np.floating] | None = None,
    known: KnownSurfaces | None = None,
    supersampled: int = 1,
) -> Scene:
    """Return a scene made of arrays.

    Args:
        image: All-in-focus picture, scene-linear light over black, (H, W, 3).
        source: Depth source.
        alpha: Coverage, (H, W).
        camera: Known data of the camera.
        window: Position of the pixels in the shown picture. Default: they are the whole picture.
        number: Frame number in its sequence.
        matte: Coverage of each pixel by a foreground, (H, W), 0 to 1.
        known: Both surfaces of pixels at edges, in the unit of the source's map: relative disparity, 1/mm or
            pixels of blur.
        supersampled: Size of picture, map and window relative to the result: 1, 2 or 4.

    Raises:
        ShapeError, ParameterError: An array has the wrong shape or invalid values.
        BokehnetError: The source has no map.

    Examples:
        >>> import numpy as np
        >>> from bokehnet.scene.depth.depth_source import MetricDepth
        >>> metres = np.full((4, 6), 2.0, np.float32)
        >>> scene = make_scene(np.ones((4, 6, 3), np.float32), MetricDepth(map=metres))
        >>> float(scene.depth.values[0, 0])  # 1/mm
        0.0005000000237487257
    """
    check_light("image", image)
    image = np.asarray(image, np.float32)
    if alpha is not None:
        check_map("alpha", alpha)
        check_floats("alpha", alpha, "divide it by the value of full coverage, such as 255")
        check_same_size("image", image, "alpha", alpha)
        alpha = np.asarray(alpha, np.float32)
    height, width = image.shape[:2]
    window = window or Window.whole(width, height)
    _check_depth_source(source)
    depth = source.depth_map(Photo(image=image, window=window, camera=camera))
    if supersampled not in (1, 2, 4):
        raise ParameterError("supersampled", "1, 2 or 4", supersampled)
    if known is not None:
        known.check_within(height, width)
    scene = Scene(
        image=image,
        depth=depth,
        alpha=alpha,
        window=window,
        number=number,
        notes=(*depth.notes, *_shape_notes(depth, image)),
        matte=None if matte is None else check_matte(matte, image),
        known=known,
        supersampled=supersampled,
    )
    return _checked(_unblurred(scene))


def read_scene(
    path: Path | str,
    settings: RenderSettings | None = None,
    *,
    source: DepthSource | None = None,
    number: int = 0,
    progress: Progress | None = None,
) -> Scene:
    """Read a picture and its depth.

    Args:
        path: File of the picture.
        settings: Settings that name the depth source and its reading.
        source: Depth source; overrides the settings.
        number: Frame number in its sequence.
        progress: Called with (steps done, total steps).

    Raises:
        ParameterError: The settings do not apply to the depth source; raised before reading.
        BokehnetError: A file cannot be read.

    Examples:
        >>> from bokehnet.io.image import write_image
        >>> write_image("photo.png", np.full((24, 32, 3), 0.5, np.float32))
        >>> changes = {"input": {"constant_disparity": 0.25}, "camera": {"blur": 8}, "focus": {"value": 0.5}}
        >>> scene = read_scene("photo.png", RenderSettings().updated(changes))
        >>> scene.image.shape, scene.depth.kind
        ((24, 32, 3), 'relative')
    """
    settings = settings or RenderSettings()
    if source is None:
        check_focus(settings)
        source = depth_source(settings)
    _check_depth_source(source)
    frame = read_frame(path, part_of(progress, 0, 2), settings.input.color_space)
    matte, factor = settings.input.matte, settings.input.supersampled
    unit = unit_of_picture_depth(source, path)
    if factor > 1:
        frame = without_origin(frame)
    photo = Photo(
        image=frame.image,
        window=frame.window,
        camera=frame.camera,
        path=Path(path),
        progress=part_of(progress, 1, 2),
    )
    depth = source.depth_map(photo)
    scene = Scene(
        image=frame.image,
        depth=depth,
        alpha=frame.alpha,
        window=frame.window,
        number=number,
        frame=frame,
        notes=(*(f"{path}: {note}" for note in frame.notes), *depth.notes, *_shape_notes(depth, frame.image)),
        matte=None if matte is None else check_matte(read_matte(matte, frame.window), frame.image),
        known=None if unit is None else deep_surfaces(path, unit),
        supersampled=factor,
    )
    return _checked(_unblurred(scene))


def _checked(scene: Scene) -> Scene:
    """Return the scene, or raise ``ParameterError`` if its information about edges is contradictory."""
    if scene.known is not None and (scene.matte is not None or scene.supersampled > RENDER_SUPERSAMPLING):
        name = "input.matte" if scene.matte is not None else "input.supersampled"
        raise ParameterError(name, "nothing for a picture whose edges are known", shown="both")
    if scene.depth.layers is not None and (scene.known is not None or scene.supersampled > 1):
        raise ParameterError("layers", "none for a picture whose edges are known", shown="both")
    if scene.matte is not None and scene.supersampled > 1:
        raise ParameterError("input.matte", "no `input.supersampled`", shown="both")
    window, factor = scene.window, scene.supersampled
    sizes = (window.width, window.height, window.display_width, window.display_height)
    if any(size % factor for size in (*sizes, window.x, window.y)):
        actual = f"{window.width}x{window.height} pixels"
        if sizes[:2] != sizes[2:] or window.x or window.y:
            actual += f" at {window.x},{window.y} of {window.display_width}x{window.display_height}"
        raise ParameterError(
            "input.supersampled",
            f"a picture with sides divisible by {factor}",
            shown=actual,
            remedy="crop it, or render it at such a size",
        )
    return scene


def _unblurred(scene: Scene) -> Scene:
    """Return the scene with the phone's original picture before its portrait blur, if there is one."""
    image = scene.depth.all_in_focus
    if image is None:
        return scene
    window = Window.whole(image.shape[1], image.shape[0])
    if scene.matte is not None:
        check_same_size("the picture before the phone's blur", image, "its matte", scene.matte)
    frame = scene.frame and replace(scene.frame, image=image, alpha=None, window=window)
    depth = replace(scene.depth, all_in_focus=None)
    return replace(scene, image=image, depth=depth, alpha=None, window=window, frame=frame)


def map_at_picture_size(scene: Scene, settings: DepthSettings) -> npt.NDArray[np.float32]:
    """Return the map of a scene at the size of its picture, with mixed pixels repaired.

    Args:
        scene: Scene with the map.
        settings: Settings of resizing and repair.

    Raises:
        ShapeError: The map has another size and the settings do not allow resizing.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> half = np.tile(np.linspace(0, 1, 16, dtype=np.float32), (12, 1))
        >>> scene = make_scene(np.ones((24, 32, 3), np.float32), RelativeDisparity(map=half))
        >>> map_at_picture_size(scene, DepthSettings(resize=True)).shape
        (24, 32)
    """
    depth, (height, width) = scene.depth, scene.image.shape[:2]
    kind = "depth" if depth.kind == "metric" else "defocus" if depth.kind == "defocus" else "disparity"
    if not depth.fits_any_size:
        check_map_size(depth.values.shape[:2], (height, width), kind, may_resize=settings.resize)
    if is_repaired(scene, settings):
        depth = replace(depth, values=undo_pixel_repetition(depth.values))
    values = depth.values if is_exact(scene) else _unmixed(depth, settings)
    if values.shape != (height, width):
        smaller = values.shape[0] < height or values.shape[1] < width
        if is_repaired(scene, settings) and (smaller or depth.fits_any_size):
            values = resample(values, height, width)  # soft edges, which the repair sharpens
        else:
            values = resize_map(values, height, width)
    return values


def is_exact(scene: Scene) -> bool:
    """Return whether the edges of the map are exact and must not be repaired.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=4)
        >>> is_exact(fine)
        True
    """
    return scene.known is not None or scene.supersampled > 1 or scene.depth.layers is not None


def is_repaired(scene: Scene, settings: DepthSettings) -> bool:
    """Return whether depth repair runs for a scene.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=4)
        >>> is_repaired(fine, DepthSettings(repair="auto"))
        False
    """
    return settings.repair != "off" and scene.depth.kind != "defocus" and not is_exact(scene)


def check_repair_allowed(scene: Scene, settings: DepthSettings) -> None:
    """Raise ``ParameterError`` if the settings demand a repair of a map with exact edges.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=2)
        >>> check_repair_allowed(fine, DepthSettings(repair="on"))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: depth.repair: expected auto or off for a scene whose edges ...
    """
    for name in ("mixed", "repair"):
        if is_exact(scene) and getattr(settings, name) == "on":
            expected = "auto or off for a scene whose edges are known"
            raise ParameterError(f"depth.{name}", expected, "on", "leave it out")


def _check_depth_source(source: object) -> None:
    """Raise ``ParameterError`` for anything but a :class:`DepthSource`, such as the name of a map."""
    if not hasattr(source, "depth_map"):
        raise ParameterError("source", "a depth source, such as RelativeDisparity(map=...)", source)


def _shape_notes(depth: DepthMap, image: Array) -> tuple[str, ...]:
    """Return a warning about a map whose sides are not resized by the same factor.

    Networks may see a square, so that a square map is no sign of another view.
    """
    (rows, columns), (height, width) = depth.values.shape, image.shape[:2]
    if rows == columns or depth.fits_any_size or same_aspect((rows, columns), (height, width)):
        return ()
    return (f"the map of {columns}x{rows} pixels is stretched unevenly to the picture of {width}x{height}",)


def _unmixed(depth: DepthMap, settings: DepthSettings) -> npt.NDArray[np.float32]:
    """Return the map with its mixed pixels repaired, according to the settings.

    The default repairs only depth, which renderers filter. The soft edges of estimated disparity are wider
    than pixels; the repair that uses the picture handles them.
    """
    if settings.mixed == "off" or (settings.mixed == "auto" and depth.filtered is None):
        return depth.values
    filtered = depth.filtered or "disparity"
    if (
        settings.mixed == "auto"
        and mixed_pixel_fraction(depth.values, filtered=filtered) < _MIN_MIXED_FRACTION
    ):
        return depth.values
    return repair_mixed(depth.values, filtered=filtered)
