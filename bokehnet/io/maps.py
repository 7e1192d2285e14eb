"""Maps with one value per pixel: disparity, depth and the like."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bokehnet.errors import ImageFileError
from bokehnet.io.pixels import ImageFile, Part

__all__ = ["depth_channels", "read_depth", "read_disparity", "read_map", "resize_map"]

_BARE_NAMES = ("z", "depth.z", "depth", "disparity", "y")
_LAYER_NAMES = ("depth.z", "depth", "disparity", "z", "y")  # under a layer, a bare z says less than depth.z
_MM_PER_M = 1000.0
_SMOOTH_STEP = 0.05  # of the map's range: a larger step between neighbours is an edge


def read_map(path: Path | str, channel: str | None = None) -> NDArray[np.float32]:
    """Read one channel as it is stored: integers scaled to [0, 1] without sRGB decoding, floats raw.

    EXIF orientation is applied and alpha ignored. A colour picture counts when its channels are equal.

    Args:
        path: image file.
        channel: name of the channel; by default the first of Z, depth.Z, depth, disparity and Y, bare or
            under a layer name, else the only channel.

    Returns:
        Map of shape (H, W).

    Raises:
        ImageFileError: the file cannot be read, or it is not clear which channel is meant.
    """
    with ImageFile(path) as file:
        return _read(file, channel)[0]


def read_disparity(path: Path | str, channel: str | None = None) -> NDArray[np.float32]:
    """Read a relative disparity map, near is large, normalised to [0, 1] by its own minimum and maximum.

    A constant map keeps its value, clipped to [0, 1].

    Args:
        path: image file.
        channel: as for :func:`read_map`.

    Returns:
        Map of shape (H, W), unitless.

    Raises:
        ImageFileError: as :func:`read_map`, or the map holds NaN or infinity.
    """
    values = read_map(path, channel)
    _check_all(
        path, values, np.isfinite(values), "disparity", "is NaN or infinite", "set them to finite values"
    )
    lowest, highest = values.min(), values.max()
    if lowest == highest:
        return np.clip(values, 0, 1)
    # In double precision, where the range of any float32 map is finite.
    scaled = (values.astype(np.float64) - lowest) / (float(highest) - float(lowest))
    return scaled.astype(np.float32)


def read_depth(path: Path | str, channel: str | None = None) -> NDArray[np.float32]:
    """Read metric depth; metres in the file, mm in the result.

    Depth is measured along the optical axis and is positive; infinity (sky) is allowed.

    Args:
        path: EXR or another floating-point file, values in metres.
        channel: as for :func:`read_map`.

    Returns:
        Depth of shape (H, W), mm.

    Raises:
        ImageFileError: as :func:`read_map`, or the file holds integers, NaN, zero or negative values.
    """
    with ImageFile(path) as file:
        metres, part = _read(file, channel)
    if not part.linear:
        raise ImageFileError(
            f"{path}: expected depth in metres as floating point, found {part.pixel_type}; "
            "use an EXR file, or give the map as disparity"
        )
    way_out = "set sky to infinity and holes to the depth around them"
    _check_all(path, metres, metres > 0, "depth", "is not above 0", way_out)
    with np.errstate(over="ignore"):  # beyond 3.4e35 m becomes infinite, which is sky too
        return metres * np.float32(_MM_PER_M)


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


def _depth_groups(names: Sequence[str]) -> list[list[str]]:
    """Group depth-like names by the pattern they match, best first; empty groups are left out."""
    scalars = [name for name in names if not _is_vector(name, names)]
    bare = [[name for name in scalars if name.lower() == wanted] for wanted in _BARE_NAMES]
    layered = [[name for name in scalars if name.lower().endswith("." + wanted)] for wanted in _LAYER_NAMES]
    return [group for group in bare + layered if group]


def _is_vector(name: str, names: Sequence[str]) -> bool:
    layer, dot, last = name.rpartition(".")
    return last in ("Y", "Z") and layer + dot + "X" in names


def _read(file: ImageFile, channel: str | None) -> tuple[NDArray[np.float32], Part]:
    """Read the asked or the best channel, and tell its part."""
    part, names = _find(file, channel)
    values = file.read(part, names)
    if not np.array_equal(values, np.broadcast_to(values[..., :1], values.shape), equal_nan=True):
        raise ImageFileError(
            f"{file.path}: expected one channel, found a colour picture ({', '.join(names)} differ)"
        )
    return np.ascontiguousarray(values[..., 0]), part


def _find(file: ImageFile, channel: str | None) -> tuple[Part, list[str]]:
    """Find the part and the channels of the map: one channel, or R, G, B if there is nothing else."""
    everything = [name for part in file.parts for name in part.channels]
    groups = _depth_groups(everything)
    if channel is not None and channel not in everything:
        raise ImageFileError(f"{file.path}: no channel {channel!r}, found {', '.join(everything)}")
    if channel is None and groups and len(groups[0]) == 1:
        channel = groups[0][0]
    if channel is not None:
        part = next(part for part in file.parts if channel in part.channels)
        return part, [channel]
    first = file.parts[0]
    names = [name for name in first.channels if name != first.alpha]
    if not groups and len(file.parts) == 1 and (len(names) == 1 or names == ["R", "G", "B"]):
        return first, names
    raise ImageFileError(f"{file.path}: which channel is the map? Name one of {', '.join(everything)}")


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
