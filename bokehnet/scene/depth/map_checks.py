"""Checks of a map against its picture; they import no kernels and read no whole map."""

from pathlib import Path

from bokehnet.arrays.resample import same_aspect
from bokehnet.errors import ShapeError
from bokehnet.io.maps import read_map_header
from bokehnet.io.window import Window
from bokehnet.scene.depth.depth_map import DepthSource
from bokehnet.scene.depth.explicit_depth import DefocusMap, MetricDepth, RelativeDisparity

__all__ = ["check_map_file", "check_map_size"]


def check_map_file(source: DepthSource, picture: Window, *, may_resize: bool) -> None:
    """Raise unless the file of a depth source is a map that applies to a picture.

    Sources without a map file of their own are not checked.

    Args:
        source: Depth source.
        picture: Position of the pixels of the picture.
        may_resize: True if the map may have another size than the picture.

    Raises:
        ImageFileError: The file is no map, or has no such channel, or needs a unit.
        ParameterError: The range does not apply to the map.
        ShapeError: See :func:`check_map_size`.

    Examples:
        >>> import numpy as np
        >>> np.save("map.npy", np.ones((2, 3), np.float32))
        >>> check_map_file(RelativeDisparity(map="map.npy"), Window.whole(6, 4), may_resize=False)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ShapeError: the picture is 6x4 pixels but its disparity is 3x2; they must have ...
    """
    if not isinstance(source, RelativeDisparity | MetricDepth | DefocusMap):
        return
    if not isinstance(source.map, Path | str):
        return
    kind = source.origin.rpartition(".")[2]
    coding = "auto" if isinstance(source, DefocusMap) else source.coding
    header = read_map_header(source.map, source.channel, coding=coding)
    if not isinstance(source, DefocusMap):
        source.check_numbers(header.largest_integer)
    own = picture if header.window.has_same_display_size(picture) else header.window
    check_map_size((own.height, own.width), (picture.height, picture.width), kind, may_resize=may_resize)


def check_map_size(
    map_size: tuple[int, int], picture_size: tuple[int, int], kind: str, *, may_resize: bool
) -> None:
    """Raise ``ShapeError`` unless a map has the size of its picture, or may be resized to it.

    Args:
        map_size: Height and width of the map, pixels.
        picture_size: Height and width of the picture, pixels.
        kind: Word for the map in the message.
        may_resize: True if the map may have another size; one turned by 90 degrees is refused in any case.

    Examples:
        >>> check_map_size((2, 3), (4, 6), "depth", may_resize=True)
        >>> check_map_size((3, 2), (4, 6), "depth", may_resize=True)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ShapeError: the picture is 6x4 pixels but its depth is 2x3, turned by 90 degrees, ...
    """
    if map_size == picture_size:
        return
    (height, width), (rows, columns) = picture_size, map_size
    sizes = f"the picture is {width}x{height} pixels but its {kind} is {columns}x{rows}"
    if same_aspect(map_size[::-1], picture_size) and not same_aspect(map_size, picture_size):
        raise ShapeError(
            f"{sizes}, turned by 90 degrees, as if only one of both has an EXIF orientation; rotate the map"
        )
    if not may_resize:
        raise ShapeError(f"{sizes}; they must have the same size; `depth.resize` resizes the map")
