"""Read maps with one value per pixel, such as disparity and depth."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bokehnet.arrays.row_blocks import in_row_blocks
from bokehnet.errors import ImageFileError
from bokehnet.io.depth.false_colors import COLOR_MAPS, decode_colors, recognise_colors
from bokehnet.io.depth.numpy_maps import NUMPY_EXTENSIONS, numpy_map_header, read_numpy_map
from bokehnet.io.depth.packed_depth import PACKED_CODINGS, unpack_depth
from bokehnet.io.depth.units import DEPTH_UNITS, parse_depth_unit
from bokehnet.io.pixels import ImageFile, Part
from bokehnet.io.selection.map_channels import find_map_channels
from bokehnet.io.window import Window
from bokehnet.progress import Progress

__all__ = [
    "DEPTH_UNITS",
    "MapHeader",
    "StoredMap",
    "depth_to_mm",
    "read_depth",
    "read_disparity",
    "read_map",
    "read_map_header",
    "read_stored_map",
    "resize_map",
]

_SMOOTH_STEP = 0.05  # fraction of the map's range: a larger difference of neighbours is a depth edge

# Largest difference between the channels of a grey map, 8-bit levels: colour management and screenshots tint
# grey by a few levels.
_MAX_TINT_LEVELS = 8.0

# Pixels per looked-at pixel along each axis, where a few rows tell whether colours are those of a table.
_COLOR_STEP = 12

# Largest integer of each type.
_LARGEST_INTEGER = {"uint8": 2**8 - 1, "uint16": 2**16 - 1, "uint": 2**32 - 1, "uint32": 2**32 - 1}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StoredMap:
    """Map as stored in a file.

    Attributes:
        values: Integers scaled to [0, 1], floats unchanged, (H, W); NaN also for colours off their table.
        largest_integer: Stored number of the value 1; None for floats, whose values are the stored numbers.
        is_render: True for EXR files, as renderers write them.
        assumptions: Assumptions about the coding, a few words each.
        notes: Warnings, one line each.
        name: Name of the map in messages.

    Examples:
        >>> half = StoredMap(values=np.full((1, 1), 0.5, np.float32), largest_integer=65535)
        >>> half.numbers.tolist()
        [[32768.0]]
    """

    values: NDArray[np.float32]
    largest_integer: int | None = None
    is_render: bool = False
    assumptions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    name: str = "the map"

    @property
    def numbers(self) -> NDArray[np.float32]:
        """Stored numbers: counts of an integer file, otherwise ``values``."""
        if self.largest_integer is None:
            return self.values
        largest = self.largest_integer
        return in_row_blocks(lambda rows: np.rint(rows.astype(np.float64) * largest), self.values)


@dataclass(frozen=True, kw_only=True, slots=True)
class MapHeader:
    """Properties of a map that are known before it is read.

    Attributes:
        window: Position of its upright pixels.
        largest_integer: As in :class:`StoredMap`; None also where only the pixels decide.
    """

    window: Window
    largest_integer: int | None


def read_map(
    path: Path | str,
    channel: str | None = None,
    *,
    window: Window | None = None,
    progress: Progress | None = None,
) -> NDArray[np.float32]:
    """Read one channel as stored: integers scaled to [0, 1] without sRGB decoding, floats unchanged.

    EXIF orientation is applied and alpha ignored. A colour picture is accepted if its channels are equal
    within 8 levels of 255, or if it uses one of the colour maps of ``bokehnet.io.depth.false_colors``.

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
    return read_stored_map(path, channel, window=window, progress=progress).values


def read_stored_map(
    path: Path | str,
    channel: str | None = None,
    *,
    coding: str = "auto",
    window: Window | None = None,
    progress: Progress | None = None,
) -> StoredMap:
    """Read a map with the facts of its file.

    Args:
        path: Image file, ``.npy`` or ``.npz``.
        channel: See :func:`read_map`; of a ``.npz`` file, the name of the array.
        coding: ``"auto"`` (grey, or colours of a colour map where they fit one), ``"grey"``, one of
            ``COLOR_MAPS``, or one of ``PACKED_CODINGS``.
        window: See :func:`read_map`.
        progress: Progress callback.

    Raises:
        ImageFileError: As for :func:`read_map`, or the file does not have this coding.
    """
    path = Path(path)
    if path.suffix.lower() in NUMPY_EXTENSIONS:
        return _stored_array(read_numpy_map(path, channel))
    with ImageFile(path, progress) as file:
        stored, part = _read(file, channel, coding)
        values = stored.values
        is_exr = file.headers is not None
        own = part.window if is_exr else Window.whole(values.shape[1], values.shape[0])
        if window is not None and own.has_same_display_size(window):
            values = own.fit_to(values, window)
        largest = None if part.linear else _LARGEST_INTEGER.get(part.pixel_type)
        transparent = () if coding in PACKED_CODINGS else _transparency_note(file, part)
    return StoredMap(
        values=values,
        largest_integer=None if stored.is_decoded else largest,
        is_render=is_exr,
        assumptions=stored.assumptions,
        notes=(*stored.notes, *transparent),
    )


def read_map_header(path: Path | str, channel: str | None = None, *, coding: str = "auto") -> MapHeader:
    """Return size and type of a map without reading it.

    Of maps in colours a few rows are read; a picture whose colours are of no table is read whole, and
    refused.

    Args:
        path: See :func:`read_stored_map`.
        channel: See :func:`read_stored_map`.
        coding: See :func:`read_stored_map`.

    Raises:
        ImageFileError: The file is damaged, the choice of the channel is ambiguous, or the file does not have
            this coding.

    Examples:
        >>> np.save("depth.npy", np.ones((2, 3), np.uint16))
        >>> header = read_map_header("depth.npy")
        >>> header.window.width, header.window.height, header.largest_integer
        (3, 2, 65535)
    """
    path = Path(path)
    if path.suffix.lower() in NUMPY_EXTENSIONS:
        height, width, dtype = numpy_map_header(path, channel)
        return MapHeader(window=Window.whole(width, height), largest_integer=_largest_of_array(dtype))
    with ImageFile(path) as file:
        if coding in PACKED_CODINGS:
            part, largest = file.parts[0], None
        else:
            part, names = find_map_channels(file, channel)
            if len(names) > 1 and coding == "auto" and not part.linear and not _may_be_map(file, part, names):
                _read(file, channel, coding)
            single = len(names) == 1 and not part.linear
            largest = _LARGEST_INTEGER.get(part.pixel_type) if single else None
        if file.headers is not None:
            return MapHeader(window=part.window, largest_integer=largest)
        height, width = part.upright_size
        return MapHeader(window=Window.whole(width, height), largest_integer=largest)


def _may_be_map(file: ImageFile, part: Part, names: list[str]) -> bool:
    """Return whether the first rows of a picture are grey, or have the colours of a table."""
    _, values = next(file.read_bands(part, names))
    colors = values[::_COLOR_STEP, ::_COLOR_STEP]
    return _tint_levels(colors) <= _MAX_TINT_LEVELS or recognise_colors(colors) is not None


def _transparency_note(file: ImageFile, part: Part) -> tuple[str, ...]:
    """Return a note on pixels of a map of integers that are transparent in part of the picture."""
    if part.linear or part.alpha is None or len(part.channels) == 1:
        return ()
    count = int(np.count_nonzero(file.read(part, (part.alpha,)) == 0))
    if count in (0, part.width * part.height):
        return ()
    return (
        f"{file.path}: {count} pixels of the map are transparent; their stored values are used, "
        "`depth.no_data` marks a value as pixels without data",
    )


def _stored_array(values: NDArray[Any]) -> StoredMap:
    """Return the map of a NumPy file: 8 and 16 bits are scaled like those of image files."""
    largest = _largest_of_array(values.dtype)
    scaled = values.astype(np.float32) if largest is None else (values / np.float32(largest))
    return StoredMap(values=np.ascontiguousarray(scaled, np.float32), largest_integer=largest)


def _largest_of_array(dtype: np.dtype[Any]) -> int | None:
    """Return the largest integer of the type of an array; None for floats, and for integers of 32 bits."""
    return _LARGEST_INTEGER.get(dtype.name) if dtype.itemsize <= 2 else None


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
        unit: Unit of the file, one of ``DEPTH_UNITS``, optionally scaled; ``1/m`` is metric disparity with
            sky at 0.
        window: See :func:`read_map`.
        progress: See :func:`read_map`.

    Returns:
        Map of shape (H, W) in mm.

    Raises:
        ImageFileError: As for :func:`read_map`, or the file holds integers, NaN, zero or negative values
            (``1/m``: infinite or negative values).
        ParameterError: The unit is unknown.
    """
    parse_depth_unit(unit)
    stored = read_stored_map(path, channel, window=window, progress=progress)
    if stored.largest_integer is not None:
        raise ImageFileError(
            f"{path}: expected depth in {unit} as floating point, found integers up to "
            f"{stored.largest_integer}; use an EXR file"
        )
    return depth_to_mm(stored.values, unit, str(path))


def depth_to_mm(values: NDArray[Any], unit: str = "m", name: str = "depth map") -> NDArray[np.float32]:
    """Return depth in mm from depth in another unit or metric disparity; infinite depth (sky) is kept.

    Args:
        values: Depth or metric disparity, (H, W).
        unit: Unit of ``values``, one of ``DEPTH_UNITS``, optionally scaled.
        name: Name of the map in messages.

    Raises:
        ImageFileError: A value is NaN or not above 0 (``1/m``: infinite or below 0).
        ParameterError: The unit is unknown.
    """
    known = parse_depth_unit(unit)
    values = np.asarray(values, np.float32)
    way_out = "set sky to infinity and holes to the depth around them"
    with np.errstate(over="ignore", divide="ignore"):  # above 3.4e38 mm becomes infinite, which is sky too
        if known.is_disparity:
            way_out = "set sky to 0 and holes to the disparity around them"
            valid = (values >= 0) & np.isfinite(values)
            _check_all(name, values, valid, "metric disparity", "is not 0 or a finite number above", way_out)
            return np.divide(1000 / known.factor, np.abs(values), dtype=np.float32)  # abs: sky may be -0
        _check_all(name, values, values > 0, "depth", "is not above 0", way_out)
        return values * np.float32(known.factor)


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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Decoded:
    """Values of a part, (H, W), with the assumptions made; ``is_decoded`` if they are no longer counts."""

    values: NDArray[np.float32]
    is_decoded: bool = False
    assumptions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def _read(file: ImageFile, channel: str | None, coding: str) -> tuple[_Decoded, Part]:
    """Read the requested or the best channel, or the colours of a coding, and return the part."""
    if coding in PACKED_CODINGS:
        part = file.parts[0]
        values = unpack_depth(file.read(part, part.channels), coding, str(file.path))
        return _Decoded(values=values, is_decoded=True, assumptions=(f"packed as {coding}",)), part
    part, names = find_map_channels(file, channel)
    values = file.read(part, names)
    if len(names) == 1:
        if coding in COLOR_MAPS:
            raise ImageFileError(
                f"{file.path}: `depth.coding` {coding} needs colours, found {names[0]} alone"
            )
        return _Decoded(values=np.ascontiguousarray(values[..., 0])), part
    if part.linear and coding == "auto":
        coding = "equal"  # channels of floats that differ are no false colours
    return _read_colors(file, values, names, coding), part


def _tint_levels(colors: NDArray[np.float32]) -> float:
    """Return the largest difference between the channels of a pixel, 8-bit levels; colours (H, W, 3)."""
    red, green, blue = np.moveaxis(colors, -1, 0)  # np.ptp along three values takes ten times as long
    highest, lowest = np.maximum(np.maximum(red, green), blue), np.minimum(np.minimum(red, green), blue)
    return float(255 * (highest - lowest).max())


def _read_colors(file: ImageFile, values: NDArray[np.float32], names: list[str], coding: str) -> _Decoded:
    """Return the values of a map stored as R, G, B: equal, tinted, or of a colour map."""
    if coding not in COLOR_MAPS:
        if np.array_equal(values, np.broadcast_to(values[..., :1], values.shape), equal_nan=True):
            return _Decoded(values=np.ascontiguousarray(values[..., 0]))
        tint = _tint_levels(values)
        if coding == "grey" or (coding == "auto" and tint <= _MAX_TINT_LEVELS):
            note = (
                f"{file.path}: {', '.join(names)} differ by up to {tint:.3g} of 255 levels; using their mean"
            )
            return _Decoded(
                values=values.mean(axis=-1), is_decoded=True, assumptions=("tinted grey",), notes=(note,)
            )
    name = recognise_colors(values) if coding == "auto" else coding
    if name not in COLOR_MAPS:
        raise ImageFileError(
            f"{file.path}: expected one channel, found a colour picture ({', '.join(names)} differ) in none "
            f"of the colour maps {', '.join(COLOR_MAPS)}; export the map in grey, or name its colour map or "
            "packing with `depth.coding`; if this is the picture, it and its map are swapped"
        )
    decoded = decode_colors(values, name)
    known = _decoded_fraction(file, decoded, name)
    note = (
        f"{file.path}: colours decoded with the colour map {name}, its last colour as 1 (near); "
        f"`depth.invert` reverses it, a grey map is more exact{known}"
    )
    return _Decoded(values=decoded, is_decoded=True, assumptions=(f"colours of {name}",), notes=(note,))


def _decoded_fraction(file: ImageFile, decoded: NDArray[np.float32], name: str) -> str:
    """Return words for the colours off a table; raise if they are the majority."""
    missing = float(np.isnan(decoded).mean())
    if missing > 0.5:
        raise ImageFileError(
            f"{file.path}: {100 * missing:.0f} % of its colours are not of the colour map {name}; name "
            "another with `depth.coding`"
        )
    return f"; {100 * missing:.2g} % of the pixels have blended colours" if missing else ""


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
