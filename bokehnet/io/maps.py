"""Maps with one value per pixel: disparity, depth and the like."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import in_row_blocks
from bokehnet.checks import check_choice
from bokehnet.errors import ImageFileError
from bokehnet.io.picture import find_picture
from bokehnet.io.pixels import ImageFile, Part
from bokehnet.io.window import Window
from bokehnet.progress import Progress

__all__ = [
    "DEPTH_UNITS",
    "depth_channels",
    "depth_to_mm",
    "own_depth_channel",
    "read_depth",
    "read_disparity",
    "read_map",
    "resize_map",
]

_BARE_NAMES = ("z", "depth.z", "depth.v", "depth", "disparity", "y")
_LAYER_NAMES = (
    "depth.z",
    "depth.v",
    "depth",
    "disparity",
    "z",
    "y",
)  # under a layer, a bare z says less than depth.z
_SMOOTH_STEP = 0.05  # of the map's range: a larger step between neighbours is an edge

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
_PER_METRE = "1/m"
DEPTH_UNITS = (*_MM, _PER_METRE)


def read_map(
    path: Path | str,
    channel: str | None = None,
    *,
    window: Window | None = None,
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Read one channel as it is stored: integers scaled to [0, 1] without sRGB decoding, floats raw.

    EXIF orientation is applied and alpha ignored. A colour picture counts when its channels are equal.

    Args:
        path: image file.
        channel: name of the channel in any part, or part and channel as in ``left.Z``; by default the first
            of Z, depth.Z, depth.V, depth, disparity and Y, bare or under a layer name, else the only channel.
        window: where the pixels of the picture lie, of :class:`bokehnet.io.frame.Frame`. A map that
            shows as large a picture but stores another part of it (overscan, a cropped data window) is
            brought onto that one, its border repeated.
        progress: is told how far the reading is.

    Returns:
        Map of shape (H, W).

    Raises:
        ImageFileError: the file cannot be read, or it is not clear which channel is meant.
    """
    with ImageFile(path, progress) as file:
        return _read(file, channel, window)[0]


def read_disparity(
    path: Path | str,
    channel: str | None = None,
    *,
    invert: bool = False,
    normalise: bool = True,
    window: Window | None = None,
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Read a relative disparity map; near is large in the result.

    Args:
        path: image file.
        channel: as for :func:`read_map`.
        invert: the file is the other way round, such as normalised depth, 0 near to 1 far: ``1 - value``.
        normalise: bring the map to [0, 1] by its own minimum and maximum; a constant map keeps its value,
            clipped to [0, 1]. Else values stay as stored, which keeps the frames of a sequence alike.
        window: as for :func:`read_map`.
        progress: as for :func:`read_map`.

    Returns:
        Map of shape (H, W), unitless.

    Raises:
        ImageFileError: as :func:`read_map`, or the map holds NaN or infinity.
    """
    values = read_map(path, channel, window=window, progress=progress)
    way_out = "set them to finite values"
    if invert:
        way_out += "; metric depth, where sky may be infinite, is read as depth"
    _check_all(path, values, np.isfinite(values), "disparity", "is NaN or infinite", way_out)
    lowest, highest = float(values.min()), float(values.max())
    if normalise and lowest == highest:
        values = np.clip(values, 0, 1)
    elif normalise:
        # In double precision, where the range of any float32 map is finite.
        values = in_row_blocks(lambda rows: (rows.astype(np.float64) - lowest) / (highest - lowest), values)
    return 1 - values if invert else values


def read_depth(
    path: Path | str,
    channel: str | None = None,
    *,
    unit: str = "m",
    window: Window | None = None,
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Read metric depth, mm in the result.

    Depth is measured along the optical axis and is positive; infinity (sky) is allowed.

    Args:
        path: EXR or another floating-point file.
        channel: as for :func:`read_map`.
        unit: of the file, one of ``DEPTH_UNITS``; ``1/m`` is metric disparity, where sky is 0.
        window: as for :func:`read_map`.
        progress: as for :func:`read_map`.

    Returns:
        Map of shape (H, W) in mm.

    Raises:
        ImageFileError: as :func:`read_map`, or the file holds integers, NaN, zero or negative values
            (``1/m``: infinite or negative values).
        ParameterError: unknown unit.
    """
    check_choice("unit", unit, DEPTH_UNITS)
    with ImageFile(path, progress) as file:
        values, part = _read(file, channel, window)
    if not part.linear:
        raise ImageFileError(
            f"{path}: expected depth in {unit} as floating point, found {part.pixel_type}; "
            "use an EXR file, or give the map as disparity"
        )
    return depth_to_mm(values, unit, str(path))


def depth_to_mm(values: NDArray[Any], unit: str = "m", name: str = "depth map") -> NDArray[np.float32]:
    """Return depth in a unit of length, or metric disparity, as mm; infinite depth (sky) stays.

    Args:
        values: (H, W).
        unit: One of ``DEPTH_UNITS``.
        name: Of the map, for messages.

    Raises:
        ImageFileError: A value is NaN or not above 0 (``1/m``: infinite or below 0).
        ParameterError: Unknown unit.
    """
    check_choice("unit", unit, DEPTH_UNITS)
    values = np.asarray(values, np.float32)
    way_out = "set sky to infinity and holes to the depth around them"
    with np.errstate(over="ignore", divide="ignore"):  # beyond 3.4e38 mm becomes infinite, which is sky too
        if unit == _PER_METRE:
            way_out = "set sky to 0 and holes to the disparity around them"
            good = (values >= 0) & np.isfinite(values)
            _check_all(name, values, good, "metric disparity", "is not 0 or a finite number above", way_out)
            return np.divide(_MM["m"], np.abs(values), dtype=np.float32)  # abs: sky may be -0
        _check_all(name, values, values > 0, "depth", "is not above 0", way_out)
        return values * np.float32(_MM[unit])


def resize_map(values: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Resize a disparity map: linear on smooth surfaces, nearest across depth edges.

    Plain linear interpolation makes up surfaces between near and far, which show as a rim of wrong blur;
    plain nearest makes stairs of every slope. So the four neighbours are interpolated where they differ by
    less than 5 % of the map's range, and the nearest one is taken elsewhere. Pixel centres are aligned.

    Args:
        values: (H, W), finite.
        height: of the result, pixels.
        width: of the result, pixels.

    Returns:
        Map of shape (height, width) within the range of ``values``.
    """
    top, bottom, v = _neighbours(values.shape[0], height)
    left, right, u = _neighbours(values.shape[1], width)
    a, b = values[top][:, left], values[top][:, right]
    c, d = values[bottom][:, left], values[bottom][:, right]
    v, u = v[:, None], u[None]
    linear = (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d)
    nearest = np.where(v < 0.5, np.where(u < 0.5, a, b), np.where(u < 0.5, c, d))
    lowest, highest = np.minimum.reduce([a, b, c, d]), np.maximum.reduce([a, b, c, d])
    smooth = highest - lowest <= _SMOOTH_STEP * (values.max() - values.min())
    return np.where(smooth, np.clip(linear, lowest, highest), nearest).astype(values.dtype)


def depth_channels(names: Sequence[str]) -> list[str]:
    """Return those of ``names`` that look like depth or disparity, the best guess first.

    Bare names come before names under a layer; Y and Z of a vector, as in normals, do not count.
    """
    return list(dict.fromkeys(name for group in _depth_groups(names) for name in group))


def own_depth_channel(path: Path | str) -> str | None:
    """Return the channel of an EXR picture that holds its depth, for :func:`read_depth`; None without one.

    Args:
        path: any image file.

    Raises:
        ImageFileError: the file cannot be read, or several channels could be meant.
    """
    with ImageFile(path) as file:
        if file.headers is None:
            return None
        picture = find_picture(file)
        layer = picture.colours[0].rpartition(".")[0].rpartition(".")[0]
        stored = [(part, name) for part in file.parts for name in part.channels]
        found = [
            (part, name)
            for part, name in stored
            if name.lower().rpartition(".")[2] in ("z", "depth")
            or name.lower().endswith(("depth.v", "depth.y"))
            if not _is_vector(name, part.channels) and name not in picture.colours
        ]
        beside = [(part, name) for part, name in found if part.index == picture.part.index]
        same = [(part, name) for part, name in beside if layer and name.startswith(layer + ".")]
        bare = [(part, name) for part, name in beside if name.lower() in _BARE_NAMES]
        for group in (same, bare, beside, found):
            if len(group) == 1:
                part, name = group[0]
                shared = sum(name == other for _, other in stored) > 1
                return f"{part.name}.{name}" if shared and part.name else name
        if found:
            names = ", ".join(name for _, name in found)
            raise ImageFileError(
                f"{path}: which channel is the depth? Give the file as depth and name one of {names}"
            )
        return None


def _depth_groups(names: Sequence[str]) -> list[list[str]]:
    """Group depth-like names by the pattern they match, best first; empty groups are left out."""
    scalars = [name for name in names if not _is_vector(name, names)]
    bare = [[name for name in scalars if name.lower() == wanted] for wanted in _BARE_NAMES]
    layered = [[name for name in scalars if name.lower().endswith("." + wanted)] for wanted in _LAYER_NAMES]
    return [group for group in bare + layered if group]


def _is_vector(name: str, names: Sequence[str]) -> bool:
    layer, dot, last = name.rpartition(".")
    return last in ("Y", "Z") and layer + dot + "X" in names


def _read(file: ImageFile, channel: str | None, window: Window | None) -> tuple[NDArray[np.float32], Part]:
    """Read the asked or the best channel, and tell its part."""
    part, names = _find(file, channel)
    values = file.read(part, names)
    if len(names) > 1 and not np.array_equal(
        values, np.broadcast_to(values[..., :1], values.shape), equal_nan=True
    ):
        raise ImageFileError(
            f"{file.path}: expected one channel, found a colour picture ({', '.join(names)} differ)"
        )
    result = np.ascontiguousarray(values[..., 0])
    own = part.window if file.headers is not None else Window.whole(result.shape[1], result.shape[0])
    if window is not None and own.shows_as_much_as(window):
        result = own.move_onto(result, window)
    return result, part


def _find(file: ImageFile, channel: str | None) -> tuple[Part, list[str]]:
    """Find the part and the channels of the map: one channel, or R, G, B if there is nothing else."""
    stored = [(part, name) for part in file.parts for name in part.channels]
    names = [name for _, name in stored]
    full_names = ", ".join(
        f"{part.name}.{name}" if part.name and names.count(name) > 1 else name for part, name in stored
    )
    groups = _depth_groups(names)
    if channel is None and groups and len(groups[0]) == 1:
        channel = groups[0][0]
    if channel is not None:
        found = [(part, name) for part, name in stored if channel == name]
        found = found or [(part, name) for part, name in stored if channel == f"{part.name}.{name}"]
        if not found:
            raise ImageFileError(f"{file.path}: no channel {channel!r}, found {full_names}")
        if len(found) > 1:
            raise ImageFileError(
                f"{file.path}: {len(found)} parts have a channel {channel!r}; name one of {full_names}"
            )
        return found[0][0], [found[0][1]]
    first = file.parts[0]
    names = [name for name in first.channels if name != first.alpha]
    if not groups and len(file.parts) == 1 and (len(names) == 1 or names == ["R", "G", "B"]):
        return first, names
    raise ImageFileError(f"{file.path}: which channel is the map? Name one of {full_names}")


def _check_all(
    path: Path | str,
    values: NDArray[np.float32],
    good: NDArray[np.bool_],
    what: str,
    fault: str,
    way_out: str,
) -> None:
    """Raise unless every value is good, with the count and the place of the first bad one."""
    bad = np.argwhere(~good)
    if len(bad):
        y, x = (int(index) for index in bad[0])
        raise ImageFileError(
            f"{path}: {what} {fault} at {len(bad)} pixels, "
            f"first at x={x}, y={y} ({values[y, x]:g}); {way_out}"
        )


def _neighbours(size: int, wanted: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
    """For each wanted pixel centre the two source pixels around it and the weight of the second."""
    position = np.clip((np.arange(wanted) + 0.5) * size / wanted - 0.5, 0, size - 1)
    first = np.floor(position).astype(np.intp)
    return first, np.minimum(first + 1, size - 1), (position - first).astype(np.float32)
