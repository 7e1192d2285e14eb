"""What is rendered: a picture, the map of its depth, and what its file says besides."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.resample import resample
from bokehnet.checks import check_floats, check_light, check_map, check_same_size
from bokehnet.classical.known_layers import Layers
from bokehnet.classical.known_surfaces import KnownSurfaces
from bokehnet.depth_repair.repair_plan import RepairPlan
from bokehnet.depth_repair.stages.mixed_pixels import repair_mixed, share_of_mixed
from bokehnet.depth_repair.stages.repeated_pixels import unrepeated
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.io.frame import Frame, detached, read_frame
from bokehnet.io.maps import resize_map
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.optics.pixels.pixel_filter import FilterChoice
from bokehnet.progress import Progress, part_of
from bokehnet.scene.depth.depth_source import (
    DepthMap,
    DepthSource,
    Photo,
    depth_source,
    unit_of_own_depth,
)
from bokehnet.scene.focus import FocusedLens, check_focus
from bokehnet.scene.known_edges import check_matte, deep_surfaces, read_matte
from bokehnet.settings.settings import DepthSettings, RenderSettings

__all__ = [
    "RENDERED",
    "FocusedScene",
    "Scene",
    "check_nothing_to_mend",
    "fitted_map",
    "is_exact",
    "is_repaired",
    "make_scene",
    "read_scene",
]

# Logarithm of the ratio of two ratios of width to height up to which they are alike.
_ALIKE = 0.05

# Share of mixed pixels beside depth edges from which on the map was filtered as its picture was.
_MIXED = 0.05

# Times the result's size at which supersampled scenes are rendered.
RENDERED = 2

Array = npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """A picture and its depth; :func:`make_scene` and :func:`read_scene` make one.

    Attributes:
        image: All-in-focus, scene-linear light over black, (H, W, 3).
        depth: The map of its depth, as its source gave it.
        alpha: Coverage, (H, W); None where all is covered.
        window: Where the pixels lie in the shown picture, whose width that of the sensor spans.
        number: Of the frame in its sequence.
        frame: What the picture's file holds besides, for writing back; None for arrays.
        notes: What was chosen, or is odd about picture and map, a line each.
        matte: How much of each pixel a foreground covers, (H, W), 0 to 1; None where nothing tells it.
        known: Both surfaces of pixels at edges, in the unit of the map, where they need not be estimated.
        supersampled: How many times the size of the result picture, map and window are: 1, 2 or 4.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> scene = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), number=1001)
        >>> scene.number, scene.window.display_width, float(scene.depth.values.max())
        (1001, 32, 0.25)
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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FocusedScene:
    """A scene whose focus is found: all that blur depends on.

    Attributes:
        image: As in :class:`Scene`.
        defocus: Signed blur radius of each pixel, (H, W), pixels, positive in front of focus.
        alpha: As in the scene.
        window: As in the scene.
        number: As in the scene.
        frame: As in the scene.
        lens: The lens and its focus; None where defocus was given.
        repaired: Whether edges of the map were moved; None where nobody looked.
        repair_reason: Why.
        repair_plan: What the repair has decided, which the other frames of a shot may follow.
        pixel_filter: By which pixels at edges mix both sides; None where the engine parts none.
        notes: As in the scene, and what is odd about the blur.
        known: Both surfaces of pixels at edges, with their blur radii, where they need not be estimated.
        supersampled: How many times the size of the result the arrays and the window are: 1 or 2. Blur radii
            are in pixels of these arrays.
        layers: What stands behind one another, with its blur radii, where that is known.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> from bokehnet.render.renderer import BokehRenderer
        >>> flat = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.75))
        >>> told = {"camera": {"blur": 8}, "focus": {"value": 0.5}, "depth": {"repair": "off"}}
        >>> focused = BokehRenderer("scatter").prepare(flat, RenderSettings().updated(told))
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
    """Make a scene of arrays.

    Args:
        image: All-in-focus, scene-linear light over black, (H, W, 3).
        source: What tells its depth.
        alpha: Coverage, (H, W).
        camera: What is known of the camera.
        window: Where the pixels lie in the shown picture; by default all of it is there.
        number: Of the frame in its sequence.
        matte: How much of each pixel a foreground covers, (H, W), 0 to 1.
        known: Both surfaces of pixels at edges, in the unit in which the source's map has its values:
            relative disparity, 1/mm or pixels of blur.
        supersampled: How many times the size of the result picture, map and window are: 1, 2 or 4.

    Raises:
        ShapeError, ParameterError: The arrays are not as described.
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
        check_floats("alpha", alpha, "divide it by the value that covers all, as 255")
        check_same_size("image", image, "alpha", alpha)
        alpha = np.asarray(alpha, np.float32)
    height, width = image.shape[:2]
    window = window or Window.whole(width, height)
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
        notes=depth.notes,
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
    """Read a picture and what tells its depth.

    Args:
        path: The picture.
        settings: Say where its depth comes from, and how it is read.
        source: Tells the depth in place of the settings.
        number: Of the frame in its sequence.
        progress: Called with (steps done, steps in all).

    Raises:
        ParameterError: The settings do not fit to what tells the depth; nothing is read then.
        BokehnetError: A file cannot be read.

    Examples:
        >>> from bokehnet.io.image import write_image
        >>> write_image("photo.png", np.full((24, 32, 3), 0.5, np.float32))
        >>> told = {"input": {"constant_disparity": 0.25}, "camera": {"blur": 8}, "focus": {"value": 0.5}}
        >>> scene = read_scene("photo.png", RenderSettings().updated(told))
        >>> scene.image.shape, scene.depth.kind
        ((24, 32, 3), 'relative')
    """
    settings = settings or RenderSettings()
    if source is None:
        check_focus(settings)
        source = depth_source(settings)
    frame = read_frame(path, part_of(progress, 0, 2))
    matte, factor = settings.input.matte, settings.input.supersampled
    unit = unit_of_own_depth(source, path)
    if factor > 1:
        frame = detached(frame)
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
        notes=(*(f"{path}: {note}" for note in frame.notes), *depth.notes),
        matte=None if matte is None else check_matte(read_matte(matte, frame.window), frame.image),
        known=None if unit is None else deep_surfaces(path, unit),
        supersampled=factor,
    )
    return _checked(_unblurred(scene))


def _checked(scene: Scene) -> Scene:
    """The same scene, or ``ParameterError`` where what is known of its edges does not go together."""
    if scene.known is not None and (scene.matte is not None or scene.supersampled > RENDERED):
        name = "input.matte" if scene.matte is not None else "input.supersampled"
        raise ParameterError(name, "nothing for a picture whose edges are known", shown="both")
    if scene.depth.layers is not None and (scene.known is not None or scene.supersampled > 1):
        raise ParameterError("layers", "none for a picture whose edges are known", shown="both")
    if scene.matte is not None and scene.supersampled > 1:
        raise ParameterError("input.matte", "none beside `input.supersampled`", shown="both")
    window, factor = scene.window, scene.supersampled
    sizes = (window.width, window.height, window.display_width, window.display_height)
    if any(size % factor for size in (*sizes, window.x, window.y)):
        found = f"{window.width}x{window.height} pixels"
        if sizes[:2] != sizes[2:] or window.x or window.y:
            found += f" at {window.x},{window.y} of {window.display_width}x{window.display_height}"
        raise ParameterError(
            "input.supersampled",
            f"a picture whose sides {factor} divides",
            shown=found,
            remedy="crop it, or render it in such a size",
        )
    return scene


def _unblurred(scene: Scene) -> Scene:
    """The same scene with the picture that a phone kept from before it blurred it, if it did."""
    image = scene.depth.all_in_focus
    if image is None:
        return scene
    window = Window.whole(image.shape[1], image.shape[0])
    if scene.matte is not None:
        check_same_size("the picture from before it was blurred", image, "its matte", scene.matte)
    frame = scene.frame and replace(scene.frame, image=image, alpha=None, window=window)
    depth = replace(scene.depth, all_in_focus=None)
    return replace(scene, image=image, depth=depth, alpha=None, window=window, frame=frame)


def fitted_map(scene: Scene, settings: DepthSettings) -> npt.NDArray[np.float32]:
    """Return the map of a scene in the size of its picture, without pixels between two surfaces.

    Args:
        scene: The scene.
        settings: How it is resized, and what is mended.

    Raises:
        ShapeError: The map has another size and may not be brought to the picture's.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import RelativeDisparity
        >>> half = np.tile(np.linspace(0, 1, 16, dtype=np.float32), (12, 1))
        >>> scene = make_scene(np.ones((24, 32, 3), np.float32), RelativeDisparity(map=half))
        >>> fitted_map(scene, DepthSettings(resize=True)).shape
        (24, 32)
    """
    depth, (height, width) = scene.depth, scene.image.shape[:2]
    what = "depth" if depth.kind == "metric" else "defocus" if depth.kind == "defocus" else "disparity"
    if not depth.fits_any_size:
        _check_upright(depth.values.shape, (height, width), what)
    may_resize = settings.resize or depth.fits_any_size or depth.values.shape == (height, width)
    if is_repaired(scene, settings) and may_resize:
        depth = replace(depth, values=unrepeated(depth.values))
    values = depth.values if is_exact(scene) else _unmixed(depth, settings)
    if values.shape != (height, width) and may_resize:
        smaller = values.shape[0] < height or values.shape[1] < width
        if is_repaired(scene, settings) and (smaller or depth.fits_any_size):
            values = resample(values, height, width)  # soft edges, which the repair knows how to sharpen
        else:
            values = resize_map(values, height, width)
    check_same_size("the picture", scene.image, f"its {what}", values, "`depth.resize` brings them together")
    return values


def is_exact(scene: Scene) -> bool:
    """Whether edges of the map are where those of the picture are, and not to be mended.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=4)
        >>> is_exact(fine)
        True
    """
    return scene.known is not None or scene.supersampled > 1 or scene.depth.layers is not None


def is_repaired(scene: Scene, settings: DepthSettings) -> bool:
    """Whether the repair looks at the map of a scene.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=4)
        >>> is_repaired(fine, DepthSettings(repair="auto"))
        False
    """
    return settings.repair != "off" and scene.depth.kind != "defocus" and not is_exact(scene)


def check_nothing_to_mend(scene: Scene, settings: DepthSettings) -> None:
    """Raise ``ParameterError`` where a map is to be mended whose edges are known to be right.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> fine = make_scene(np.ones((24, 32, 3)), ConstantDisparity(value=0.25), supersampled=2)
        >>> check_nothing_to_mend(fine, DepthSettings(repair="on"))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: depth.repair: expected auto or off for a scene whose edges ...
    """
    for name in ("mixed", "repair"):
        if is_exact(scene) and getattr(settings, name) == "on":
            expected = "auto or off for a scene whose edges are known"
            raise ParameterError(f"depth.{name}", expected, "on", "leave it out")


def _check_upright(found: tuple[int, ...], wanted: tuple[int, int], what: str) -> None:
    """Raise ``ShapeError`` for a map that fits its picture only when it is turned by 90 degrees."""
    turned = math.log(found[1] / found[0] * wanted[1] / wanted[0])
    upright = math.log(found[0] / found[1] * wanted[1] / wanted[0])
    if abs(turned) < _ALIKE < abs(upright):
        raise ShapeError(
            f"the picture is {wanted[1]}x{wanted[0]} pixels but its {what} is {found[1]}x{found[0]}, turned "
            "by 90 degrees, as where only one of both has an EXIF orientation; turn the map"
        )


def _unmixed(depth: DepthMap, settings: DepthSettings) -> npt.NDArray[np.float32]:
    """Return the map with its mixed pixels repaired, as the settings say.

    Without being asked only depth is touched, which renderers filter; the soft edges of estimated disparity
    are wider than pixels, and left to the repair that looks at the picture.
    """
    if settings.mixed == "off" or (settings.mixed == "auto" and depth.filtered is None):
        return depth.values
    filtered = depth.filtered or "disparity"
    if settings.mixed == "auto" and share_of_mixed(depth.values, filtered=filtered) < _MIXED:
        return depth.values
    return repair_mixed(depth.values, filtered=filtered)
