"""Read maps with one value per pixel, such as disparity and depth."""

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
    "picture_depth_channel",
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
)  # under a layer, a bare z is less specific than depth.z
_SMOOTH_STEP = 0.05  # fraction of the map's range: a larger difference of neighbours is a depth edge

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
    """Read one channel as stored: integers scaled to [0, 1] without sRGB decoding, floats unchanged.

    EXIF orientation is applied and alpha ignored. A colour picture is accepted if its channels are equal.

    Args:
        path: Image file.
        channel: Name of the channel in any part, or part and channel as in ``left.Z``; default: the first
            of Z, depth.Z, depth.V, depth, disparity and Y, bare or under a layer name, otherwise the only
            channel.
        window: Data and display window of the picture, see :class:`bokehnet.io.frame.Frame`. A map with the
            same display window but another data window (overscan, crop) is cropped or extended to that of
            the picture by repeating its border.
        progress: Progress callback.

    Returns:
        Map of shape (H, W).

    Raises:
        ImageFileError: The file cannot be read, or the choice of the channel is ambiguous.
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
    """Read a relative disparity map; larger values are nearer in the result.

    Args:
        path: Image file.
        channel: See :func:`read_map`.
        invert: True for files with larger values farther away, such as normalised depth, 0 near to 1 far:
            returns ``1 - value``.
        normalise: True scales the map to [0, 1] by its own minimum and maximum; a constant map keeps its
            value, clipped to [0, 1]. False keeps the stored values, so that the frames of a sequence agree.
        window: See :func:`read_map`.
        progress: See :func:`read_map`.

    Returns:
        Map of shape (H, W), unitless.

    Raises:
        ImageFileError: As for :func:`read_map`, or the map holds NaN or infinity.
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
        # Double precision keeps the range of any float32 map finite.
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
        channel: See :func:`read_map`.
        unit: Unit of the file, one of ``DEPTH_UNITS``; ``1/m`` is metric disparity with sky at 0.
        window: See :func:`read_map`.
        progress: See :func:`read_map`.

    Returns:
        Map of shape (H, W) in mm.

    Raises:
        ImageFileError: As for :func:`read_map`, or the file holds integers, NaN, zero or negative values
            (``1/m``: infinite or negative values).
        ParameterError: The unit is unknown.
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
    """Return depth in mm from depth in another unit or metric disparity; infinite depth (sky) is kept.

    Args:
        values: Depth or metric disparity, (H, W).
        unit: Unit of ``values``, one of ``DEPTH_UNITS``.
        name: Name of the map in messages.

    Raises:
        ImageFileError: A value is NaN or not above 0 (``1/m``: infinite or below 0).
        ParameterError: The unit is unknown.
    """
    check_choice("unit", unit, DEPTH_UNITS)
    values = np.asarray(values, np.float32)
    way_out = "set sky to infinity and holes to the depth around them"
    with np.errstate(over="ignore", divide="ignore"):  # above 3.4e38 mm becomes infinite, which is sky too
        if unit == _PER_METRE:
            way_out = "set sky to 0 and holes to the disparity around them"
            valid = (values >= 0) & np.isfinite(values)
            _check_all(name, values, valid, "metric disparity", "is not 0 or a finite number above", way_out)
            return np.divide(_MM["m"], np.abs(values), dtype=np.float32)  # abs: sky may be -0
        _check_all(name, values, values > 0, "depth", "is not above 0", way_out)
        return values * np.float32(_MM[unit])


def resize_map(values: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Resize a disparity map: linear on smooth surfaces, nearest across depth edges.

    Plain linear interpolation creates surfaces between near and far, visible as a rim of wrong blur; plain
    nearest-neighbour interpolation creates stairs on every slope. So the four neighbours are interpolated if
    they differ by less than 5 % of the map's range; otherwise the nearest one is used. Pixel centres are
    aligned.

    Args:
        values: Map (H, W), finite.
        height: Height of the result, pixels.
        width: Width of the result, pixels.

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
    """Return the ``names`` that look like depth or disparity, best match first.

    Bare names come before names under a layer; Y and Z of a vector, as in normals, do not count.
    """
    return list(dict.fromkeys(name for group in _depth_groups(names) for name in group))


def picture_depth_channel(path: Path | str) -> str | None:
    """Return the depth channel of an EXR picture, for :func:`read_depth`; None if there is none.

    Args:
        path: Any image file.

    Raises:
        ImageFileError: The file cannot be read, or several channels match.
    """
    with ImageFile(path) as file:
        if file.headers is None:
            return None
        picture = find_picture(file)
        layer = picture.colours[0].rpartition(".")[0].rpartition(".")[0]
        stored = [(part, name) for part in file.parts for name in part.channels]
        candidates = [
            (part, name)
            for part, name in stored
            if name.lower().rpartition(".")[2] in ("z", "depth")
            or name.lower().endswith(("depth.v", "depth.y"))
            if not _is_vector(name, part.channels) and name not in picture.colours
        ]
        same_part = [(part, name) for part, name in candidates if part.index == picture.part.index]
        same_layer = [(part, name) for part, name in same_part if layer and name.startswith(layer + ".")]
        bare = [(part, name) for part, name in same_part if name.lower() in _BARE_NAMES]
        for group in (same_layer, bare, same_part, candidates):
            if len(group) == 1:
                part, name = group[0]
                ambiguous = sum(name == other for _, other in stored) > 1
                return f"{part.name}.{name}" if ambiguous and part.name else name
        if candidates:
            names = ", ".join(name for _, name in candidates)
            raise ImageFileError(
                f"{path}: which channel is the depth? Give the file as depth and name one of {names}"
            )
        return None


def _depth_groups(names: Sequence[str]) -> list[list[str]]:
    """Group depth-like names by the pattern they match, best first; empty groups are omitted."""
    scalars = [name for name in names if not _is_vector(name, names)]
    bare = [[name for name in scalars if name.lower() == pattern] for pattern in _BARE_NAMES]
    layered = [[name for name in scalars if name.lower().endswith("." + pattern)] for pattern in _LAYER_NAMES]
    return [group for group in bare + layered if group]


def _is_vector(name: str, names: Sequence[str]) -> bool:
    layer, dot, last = name.rpartition(".")
    return last in ("Y", "Z") and layer + dot + "X" in names


def _read(file: ImageFile, channel: str | None, window: Window | None) -> tuple[NDArray[np.float32], Part]:
    """Read the requested or the best channel, and return its part."""
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
    if window is not None and own.has_same_display_size(window):
        result = own.fit_to(result, window)
    return result, part


def _find(file: ImageFile, channel: str | None) -> tuple[Part, list[str]]:
    """Return the part and the channels of the map: one channel, or R, G, B if there is nothing else."""
    stored = [(part, name) for part in file.parts for name in part.channels]
    names = [name for _, name in stored]
    full_names = ", ".join(
        f"{part.name}.{name}" if part.name and names.count(name) > 1 else name for part, name in stored
    )
    groups = _depth_groups(names)
    if channel is None and groups and len(groups[0]) == 1:
        channel = groups[0][0]
    if channel is not None:
        matches = [(part, name) for part, name in stored if channel == name]
        matches = matches or [(part, name) for part, name in stored if channel == f"{part.name}.{name}"]
        if not matches:
            raise ImageFileError(f"{file.path}: no channel {channel!r}, found {full_names}")
        if len(matches) > 1:
            raise ImageFileError(
                f"{file.path}: {len(matches)} parts have a channel {channel!r}; name one of {full_names}"
            )
        return matches[0][0], [matches[0][1]]
    first = file.parts[0]
    names = [name for name in first.channels if name != first.alpha]
    if not groups and len(file.parts) == 1 and (len(names) == 1 or names == ["R", "G", "B"]):
        return first, names
    raise ImageFileError(f"{file.path}: which channel is the map? Name one of {full_names}")


def _check_all(
    path: Path | str,
    values: NDArray[np.float32],
    valid: NDArray[np.bool_],
    quantity: str,
    fault: str,
    way_out: str,
) -> None:
    """Raise unless every value is valid, with the number of invalid pixels and the position of the first."""
    bad = np.argwhere(~valid)
    if len(bad):
        y, x = (int(index) for index in bad[0])
        raise ImageFileError(
            f"{path}: {quantity} {fault} at {len(bad)} pixels, "
            f"first at x={x}, y={y} ({values[y, x]:g}); {way_out}"
        )


def _neighbours(size: int, new_size: int) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float32]]:
    """Return the two source pixels around each new pixel centre and the weight of the second."""
    position = np.clip((np.arange(new_size) + 0.5) * size / new_size - 0.5, 0, size - 1)
    first = np.floor(position).astype(np.intp)
    return first, np.minimum(first + 1, size - 1), (position - first).astype(np.float32)
