"""Reads a picture and the map of its scene, in one size and turned alike."""

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bokehnet.checks import check_same_size
from bokehnet.cli.phone_scene import read_phone_scene
from bokehnet.cli.scene_map import MapSource, SceneMap
from bokehnet.errors import ImageFileError

if TYPE_CHECKING:
    import numpy as np

    from bokehnet.cli.look import Renderer
    from bokehnet.io.camera import Camera
    from bokehnet.io.frame import Frame

__all__ = ["read_scene"]

# Share of mixed pixels beside depth edges from which on the map was filtered as its picture was.
_MIXED = 0.05


def read_scene(
    path: Path, source: MapSource, relative: bool, renderer: "Renderer"
) -> "tuple[Frame, SceneMap]":
    """Return the picture at ``path`` and the map of its scene.

    Args:
        path: The picture.
        source: Where its map comes from, and what is done with it.
        relative: Whether a photo's own map is to be relative disparity; else that of a full-frame camera.
        renderer: Repairs the map.

    Raises:
        BokehnetError: A file cannot be read, or picture and map do not fit together.
    """
    from bokehnet.io.frame import read_frame

    frame = read_frame(path)
    if source.disparity is not None:
        scene = _read_disparity(source.disparity, source, frame)
    elif source.depth is not None:
        scene = _read_depth(source.depth, source, frame)
    else:
        frame, scene = read_phone_scene(path, frame, relative)
    return frame, replace(scene, disparity=_fit(scene, frame.image, source, renderer))


def _read_disparity(path: Path, source: MapSource, frame: "Frame") -> SceneMap:
    from bokehnet.io.maps import read_disparity

    stored = source.as_stored or source.value_range is not None
    values = read_disparity(path, source.channel, normalise=not stored, window=frame.window)
    if source.value_range is not None:
        low, high = source.value_range
        values = ((values.astype("float64") - low) / (high - low)).astype("float32")
    elif source.as_stored and not (values.min() >= 0 and values.max() <= 1):
        raise ImageFileError(
            f"{path}: expected disparity in 0..1, as it is stored, in a sequence, found {values.min():g} to "
            f"{values.max():g}; say with --disparity-range which values are 0 and 1"
        )
    if source.invert:
        values = 1 - values
    return SceneMap(disparity=values, metric=False, source="--disparity", window=frame.window)


def _read_depth(path: Path, source: MapSource, frame: "Frame") -> SceneMap:
    from bokehnet.io.maps import read_depth
    from bokehnet.optics.coc import disparity_from_depth

    depth = read_depth(path, source.channel, unit=source.unit or "m", window=frame.window)
    return SceneMap(
        disparity=disparity_from_depth(depth),  # sky at infinite depth is 0 from here on
        metric=True,
        source="--depth",
        window=frame.window,
        camera=_join(frame.camera, _camera_of(path)),
    )


def _fit(scene: SceneMap, picture: "np.ndarray", source: MapSource, renderer: "Renderer") -> "np.ndarray":
    """Return the map in the size of ``picture``, with its edges in place."""
    from bokehnet.io.maps import resize_map
    from bokehnet.io.resample import resample

    values, (height, width) = _unmixed(scene.disparity, source), picture.shape[:2]
    if values.shape != (height, width) and not source.files and source.refine != "off":
        values = resample(values, height, width)  # soft edges, which the repair knows how to sharpen
    elif values.shape != (height, width) and (source.resize or not source.files):
        values = resize_map(values, height, width)
    what = "depth" if scene.metric else "disparity"
    check_same_size("the picture", picture, f"its {what}", values, "--resize-disparity brings them together")
    return renderer.refine(picture, values, source.refine)


def _unmixed(values: "np.ndarray", source: MapSource) -> "np.ndarray":
    """Return the map with its mixed pixels repaired, as ``source`` says.

    Without being asked only depth is touched, which renderers filter; the soft edges of estimated disparity
    are wider than pixels, and left to the repair that looks at the picture.
    """
    from bokehnet.io.mixed import repair_mixed, share_of_mixed

    filtered = "disparity" if source.depth is None or source.unit == "1/m" else "depth"
    if source.mixed == "off" or (source.mixed == "auto" and source.depth is None):
        return values
    if source.mixed == "auto" and share_of_mixed(values, filtered=filtered) < _MIXED:
        return values
    return repair_mixed(values, filtered=filtered)


def _camera_of(path: Path) -> "Camera | None":
    """What the first part of an EXR file says of the camera."""
    from bokehnet.io.camera import camera_from_exr
    from bokehnet.io.pixels import ImageFile

    with ImageFile(path) as file:
        return None if file.headers is None else camera_from_exr(file.attributes(file.parts[0]))


def _join(first: "Camera | None", second: "Camera | None") -> "Camera | None":
    """What the first one says, and the second where the first is silent."""
    if first is None or second is None:
        return first or second
    silent = [item.name for item in fields(first) if getattr(first, item.name) is None]
    return replace(first, **{name: getattr(second, name) for name in silent})
