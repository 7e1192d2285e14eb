"""Depth from files and arrays of disparity, depth or blur, and constant disparity."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bokehnet.arrays.row_blocks import in_row_blocks
from bokehnet.checks import check_kind, check_map, check_rank, number_of
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.depth.numpy_maps import NUMPY_EXTENSIONS
from bokehnet.io.depth.units import parse_depth_unit
from bokehnet.io.maps import StoredMap, depth_to_mm, read_map, read_stored_map
from bokehnet.io.metadata.camera import Camera, camera_from_exr
from bokehnet.io.pixels import ImageFile
from bokehnet.io.window import Window
from bokehnet.scene.black_bars import find_black_bars
from bokehnet.scene.camera import merged_camera
from bokehnet.scene.depth.depth_geometry import disparity_between_planes, planar_factor
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.missing_data import (
    Holes,
    MissingData,
    filled_map,
    find_missing_depth,
    find_missing_disparity,
)
from bokehnet.settings.scene_settings import CameraSettings

__all__ = ["ConstantDisparity", "DefocusMap", "MetricDepth", "RelativeDisparity", "map_camera"]

# Maximum range of a map, relative to its largest value, that counts as constant.
_MAX_CONSTANT_RANGE = 0.02

# Fraction of the pixels at each end of a map that do not count for that, and approximate number of pixels
# looked at.
_OUTLIERS, _SAMPLED_PIXELS = 0.0005, 100_000

# Median distance of a scene above which the unit of integers is doubtful, mm.
_DOUBTFUL_DISTANCE = 1e6

# Maximum of the values that map to 0 and 1 for maps of integers, whose values are 0 to 1.
_MAX_INTEGER_RANGE = 10.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RelativeDisparity:
    """Relative disparity, near is large, as from monocular networks and stereo.

    Attributes:
        map: File, array (h, w), or map as read from a file.
        channel: Channel of a file; None detects it.
        invert: True if far is large: uses ``1 - value`` after normalisation.
        value_range: Values that map to 0 and 1; None uses the lowest and the highest.
        as_stored: True to use values as stored, 0 to 1, so that all maps of a sequence have one scale; a
            ``value_range`` overrides it.
        coding: Coding of a file, see :func:`bokehnet.io.maps.read_stored_map`.
        no_data: Stored number of pixels without data; None detects them.
        holes: Treatment of pixels without data; None fills those of files, except EXR.

    Examples:
        >>> import numpy as np
        >>> from bokehnet.scene import scene
        >>> disparity = np.tile(np.linspace(0, 255, 6, dtype=np.float32), (4, 1))
        >>> ramp = scene.make_scene(np.ones((4, 6, 3), np.float32), RelativeDisparity(map=disparity))
        >>> float(ramp.depth.values.max())
        1.0
    """

    origin: ClassVar[str] = "input.disparity"
    kind: ClassVar[Kind | None] = "relative"
    tells_focus: ClassVar[bool] = False

    map: Path | str | StoredMap | npt.NDArray[np.floating]
    channel: str | None = None
    invert: bool = False
    value_range: tuple[float, float] | None = None
    as_stored: bool = False
    coding: str = "auto"
    no_data: float | None = None
    holes: Holes | None = None

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        _check_source("disparity", self.map)
        stored = _stored("disparity", self.map, self.channel, self.coding, self.holes, photo)
        self.check_numbers(stored.largest_integer)
        missing = find_missing_disparity(
            stored.numbers, stored.largest_integer, invert=self.invert, no_data=self.no_data
        )
        values, assumptions, notes = _filled(stored.values, missing, photo, self.holes, stored, self.map)
        if not (self.as_stored or self.value_range is not None):
            shown = _between_bars(values, photo.image)
            notes = (*notes, *_range_warnings(shown))
            values = _normalised(values, float(shown.min()), float(shown.max()))
        if self.value_range is not None:
            low, high = self.value_range
            values = ((values.astype("float64") - low) / (high - low)).astype("float32")
        elif self.as_stored and not (values.min() >= 0 and values.max() <= 1):
            actual = f"{values.min():g} to {values.max():g}"
            remedy = "set `depth.value_range` to the values that map to 0 and 1"
            if isinstance(self.map, np.ndarray):
                raise ParameterError("disparity", "stored values of 0 to 1", shown=actual, remedy=remedy)
            raise ImageFileError(
                f"{self.map}: expected stored disparity in 0..1 for a sequence, found {actual}; {remedy}"
            )
        values = 1 - values if self.invert else values
        direction = "bright is far" if self.invert else "bright is near"
        return DepthMap(
            values=values,
            kind="relative",
            origin=self.origin,
            camera=photo.camera,
            notes=notes,
            assumptions=(direction, *stored.assumptions, *assumptions),
        )

    def check_numbers(self, largest_integer: int | None) -> None:
        """Raise ``ParameterError`` unless the range applies to the numbers of the map.

        Args:
            largest_integer: See :class:`bokehnet.io.maps.StoredMap`.
        """
        if self.value_range is None:
            return
        low, high = self.value_range
        if not (math.isfinite(low) and math.isfinite(high) and low != high):
            raise ParameterError("depth.value_range", "two different numbers", self.value_range)
        if largest_integer is not None and max(abs(low), abs(high)) > _MAX_INTEGER_RANGE:
            expected = f"values of 0 to 1: codes of this map count over {largest_integer}"
            raise ParameterError("depth.value_range", expected, self.value_range)


def _range_warnings(values: npt.NDArray[np.float32]) -> tuple[str, ...]:
    """Return a warning about a constant or almost constant map."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return (f"the disparity map is {low:g} everywhere: all is equally sharp",)
    if high - low < _MAX_CONSTANT_RANGE * max(abs(low), abs(high)):
        return (
            f"the disparity map only ranges from {low:.6g} to {high:.6g}; stretching it to 0 to 1 amplifies "
            "its "
            "noise; `depth.value_range` sets the values that map to 0 and 1",
        )
    most = np.quantile(values.ravel()[:: max(1, values.size // _SAMPLED_PIXELS)], (_OUTLIERS, 1 - _OUTLIERS))
    if most[1] - most[0] < _MAX_CONSTANT_RANGE * (high - low):
        return (
            f"single pixels set the range of the disparity map, {low:.6g} to {high:.6g}; nearly all of it is "
            f"{most[0]:.6g} to {most[1]:.6g}; `depth.value_range` sets the values that map to 0 and 1",
        )
    return ()


def _between_bars(values: npt.NDArray[np.float32], image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return the part of a map between the black bars of its picture, whose depth means nothing."""
    bars = find_black_bars(image) if values.shape == image.shape[:2] else None
    return values if bars is None else bars.inside(values)


def _normalised(values: npt.NDArray[np.floating], low: float, high: float) -> npt.NDArray[np.float32]:
    """Return a map with ``low`` and ``high`` at 0 and 1, clipped; a constant map keeps its value."""
    if low == high:
        return np.clip(values, 0, 1).astype(np.float32)

    def stretched(rows: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
        return np.clip((rows.astype(np.float64) - low) / (high - low), 0, 1).astype(np.float32)

    result: npt.NDArray[np.float32] = in_row_blocks(stretched, values)
    return result


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MetricDepth:
    """Metric depth along the optical axis, as renderers write it; sky is infinite.

    Attributes:
        map: File or array (h, w).
        channel: Channel of a file; None detects it.
        unit: One of ``bokehnet.io.maps.DEPTH_UNITS``, optionally scaled, as in "0.2mm"; 1/m is metric
            disparity, 0 for sky. None is metres, and refuses files of integers.
        coding: Coding of a file, see :func:`bokehnet.io.maps.read_stored_map`.
        measured: Quantity of the values: "planar" for depth along the optical axis, "ray" for the distance
            from the camera, "zbuffer" for the depth buffer of a graphics card.
        near: Distance of the stored value 0, metres, for "zbuffer" or normalised "planar" depth.
        far: Distance of the stored value 1, metres.
        no_data: Stored number of pixels without data; None detects them.
        holes: Treatment of pixels without data; None fills those of files, except EXR.
        view: Camera settings, whose focal length and sensor width are the field of view for "ray".

    Examples:
        >>> from bokehnet.io.window import Window
        >>> photo = Photo(image=np.ones((1, 3, 3), np.float32), window=Window.whole(3, 1))
        >>> depth = MetricDepth(map=np.array([[50, 200, np.inf]]), unit="cm").depth_map(photo)
        >>> (1000 * depth.values).round(2).tolist()  # 1/m; sky is 0
        [[2.0, 0.5, 0.0]]
    """

    origin: ClassVar[str] = "input.depth"
    kind: ClassVar[Kind | None] = "metric"
    tells_focus: ClassVar[bool] = True

    map: Path | str | npt.NDArray[np.floating]
    channel: str | None = None
    unit: str | None = None
    coding: str = "auto"
    measured: str = "planar"
    near: float | None = None
    far: float | None = None
    no_data: float | None = None
    holes: Holes | None = None
    view: CameraSettings | None = None

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        _check_source("depth", self.map)
        camera = photo.camera
        stored = _stored("depth", self.map, self.channel, self.coding, self.holes, photo)
        self.check_numbers(stored.largest_integer)
        if not isinstance(self.map, np.ndarray):
            camera = merged_camera(camera, map_camera(Path(self.map)))
        if self._has_planes:
            values, assumptions, notes = self._between_planes(stored, photo)
        else:
            values, assumptions, notes = self._in_unit(stored, photo)
        if self.measured == "ray":
            values = (values / self._planar_factor(values.shape, photo.window, camera)).astype(np.float32)
            assumptions = ("distance along the ray", *assumptions)
        return DepthMap(
            values=values,
            kind="metric",
            origin=self.origin,
            filtered="disparity" if self._is_disparity else "depth",
            camera=camera,
            notes=notes,
            assumptions=assumptions,
        )

    def check_numbers(self, largest_integer: int | None) -> None:
        """Raise ``ImageFileError`` if the map holds integers of an unknown unit.

        Args:
            largest_integer: See :class:`bokehnet.io.maps.StoredMap`.
        """
        if largest_integer is not None and self.unit is None and not self._has_planes:
            raise ImageFileError(
                f"{_name_of(self.map, 'depth map')}: expected depth in metres as floating point, found "
                f"integers up to {largest_integer}; give their unit as `depth.unit`, such as mm, or "
                "`depth.near` and `depth.far`"
            )

    @property
    def _has_planes(self) -> bool:
        return self.near is not None and self.far is not None

    @property
    def _is_disparity(self) -> bool:
        return self.unit is not None and parse_depth_unit(self.unit).is_disparity

    def _in_unit(
        self, stored: StoredMap, photo: Photo
    ) -> tuple[npt.NDArray[np.float32], tuple[str, ...], tuple[str, ...]]:
        """Return disparity in 1/mm, words for the summary and notes, of depth in a unit."""
        from bokehnet.optics.coc import disparity_from_depth  # imports numba, 0.2 s

        name = _name_of(self.map, "depth map")
        unit, numbers = self.unit or "m", stored.numbers
        missing = find_missing_depth(
            numbers, stored.largest_integer, is_disparity=self._is_disparity, no_data=self.no_data
        )
        if missing.counts["negative"] > numbers.size / 2:
            raise ImageFileError(f"{name}: depth is not above 0 at most pixels; multiply it by -1")
        known = np.where(missing.mask, np.float32(1), numbers) if missing.mask.any() else numbers

        depth = depth_to_mm(known, unit, name)
        disparity = disparity_from_depth(depth)  # 0 for sky at infinite depth
        values, assumptions, notes = _filled(disparity, missing, photo, self.holes, stored, self.map)
        notes = (*stored.notes, *_doubt_of_unit(name, unit, stored.largest_integer, depth), *notes)
        return values, (f"depth in {unit}", *stored.assumptions, *assumptions), notes

    def _between_planes(
        self, stored: StoredMap, photo: Photo
    ) -> tuple[npt.NDArray[np.float32], tuple[str, ...], tuple[str, ...]]:
        """Return disparity in 1/mm, words for the summary and notes, of values between two planes."""
        assert self.near is not None
        assert self.far is not None
        mask = np.isnan(stored.values)
        if self.no_data is not None:
            mask |= np.isclose(stored.numbers, self.no_data, rtol=1e-6, atol=0)
        missing = MissingData(mask=mask, counts={"NaN or `depth.no_data`": int(mask.sum())})
        known = np.where(mask, np.float32(np.nan), stored.values)
        kind = "zbuffer" if self.measured == "zbuffer" else "planar"
        disparity = disparity_between_planes(known, kind, self.near, self.far)
        values, assumptions, notes = _filled(disparity, missing, photo, self.holes, stored, self.map)
        planes = f"{'z-buffer' if kind == 'zbuffer' else 'depth'} from {self.near:g} to {self.far:g} m"
        return values, (planes, *stored.assumptions, *assumptions), (*stored.notes, *notes)

    def _planar_factor(
        self, size: tuple[int, int], window: Window, camera: Camera | None
    ) -> npt.NDArray[np.float64]:
        """Return depth along the axis over the length of the ray, (h, w)."""
        numbers = []
        for name in ("focal_length", "sensor_width"):
            value = getattr(self.view, name, None) or getattr(camera, name, None)
            if value is None:
                raise ParameterError(
                    f"camera.{name}",
                    expected="the field of view, which `depth.kind` ray needs: `camera.focal_length` and "
                    "`camera.sensor_width`",
                    shown="none; the picture's file has none",
                )
            numbers.append(float(value))
        return planar_factor(size, window, *numbers)


def _doubt_of_unit(
    name: str, unit: str, largest_integer: int | None, depth: npt.NDArray[np.floating]
) -> tuple[str, ...]:
    """Return a note if integers in a unit put most of the scene, depth in mm, beyond a kilometre."""
    if largest_integer is None:
        return ()
    middle = float(np.median(depth[:: 1 + depth.shape[0] // 256, :: 1 + depth.shape[1] // 256]))
    if middle < _DOUBTFUL_DISTANCE:
        return ()
    return (
        f"{name}: integers up to {largest_integer} in {unit} put half of the scene beyond "
        f"{middle / 1e6:.2g} km; are they of another `depth.unit`, such as mm?",
    )


def _stored(
    quantity: str,
    source: Path | str | StoredMap | npt.NDArray[np.floating],
    channel: str | None,
    coding: str,
    holes: Holes | None,
    photo: Photo,
) -> StoredMap:
    """Return the stored map of a file or an array."""
    if isinstance(source, StoredMap):
        return source
    if not isinstance(source, np.ndarray):
        return read_stored_map(source, channel, coding=coding, window=photo.window, progress=photo.progress)
    if isinstance(source, np.ma.MaskedArray):
        source = np.where(np.ma.getmaskarray(source), np.float32(np.nan), source.data)
    if quantity == "disparity" and holes is None:
        check_map("disparity", source)
    return StoredMap(values=np.asarray(source, np.float32))


def _filled(
    values: npt.NDArray[np.float32],
    missing: MissingData,
    photo: Photo,
    holes: Holes | None,
    stored: StoredMap,
    source: Path | str | StoredMap | npt.NDArray[np.floating],
) -> tuple[npt.NDArray[np.float32], tuple[str, ...], tuple[str, ...]]:
    """Return a map without missing values, words for the summary, and notes.

    Renderers and programs know all depths: their missing values are faults, unless the settings fill them.
    """
    default: Holes = "error" if stored.is_render or isinstance(source, np.ndarray) else "fill"
    if missing.mask.any():
        values = np.where(missing.mask, np.float32(np.nan), values)
    return filled_map(values, missing, photo.image, holes or default, _name_of(source, "the map"))


def _name_of(source: Path | str | StoredMap | npt.NDArray[np.floating], otherwise: str) -> str:
    if isinstance(source, StoredMap):
        return source.name
    return otherwise if isinstance(source, np.ndarray) else str(source)


def map_camera(path: Path) -> Camera | None:
    """Return the camera data in the header of a depth map; None unless it is an EXR that has some.

    Raises:
        ImageFileError: The file cannot be read.

    Examples:
        >>> np.save("depth.npy", np.ones((2, 3), np.float32))
        >>> map_camera(Path("depth.npy")) is None  # arrays of NumPy have no camera data
        True
    """
    if path.suffix.lower() in NUMPY_EXTENSIONS:
        return None
    with ImageFile(path) as file:
        return None if file.headers is None else camera_from_exr(file.attributes(file.parts[0]))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ConstantDisparity:
    """Constant relative disparity: a flat scene.

    Attributes:
        value: Disparity, 0 (far) to 1 (near).

    Examples:
        >>> from bokehnet.io.window import Window
        >>> photo = Photo(image=np.ones((1, 3, 3), np.float32), window=Window.whole(3, 1))
        >>> ConstantDisparity(value=0.25).depth_map(photo).values.tolist()
        [[0.25, 0.25, 0.25]]
    """

    origin: ClassVar[str] = "input.constant_disparity"
    kind: ClassVar[Kind | None] = "relative"
    tells_focus: ClassVar[bool] = False

    value: float

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        if not 0 <= number_of(self.value) <= 1:
            raise ParameterError(
                "input.constant_disparity", expected="a relative disparity in 0..1", got=self.value
            )
        values = np.full(photo.image.shape[:2], self.value, np.float32)
        return DepthMap(values=values, kind="relative", origin=self.origin)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DefocusMap:
    """Signed blur radii in pixels, positive in front of focus, which need no focusing.

    Attributes:
        map: File or array (H, W), of the picture's size.
        channel: Channel of a file; None detects it.

    Examples:
        >>> from bokehnet.scene.scene import make_scene
        >>> radii = np.array([[3, 0, -6.5]])  # pixels: in front of focus, sharp, behind it
        >>> scene = make_scene(np.ones((1, 3, 3), np.float32), DefocusMap(map=radii))
        >>> scene.depth.kind, scene.depth.values.tolist()
        ('defocus', [[3.0, 0.0, -6.5]])
    """

    origin: ClassVar[str] = "input.defocus"
    kind: ClassVar[Kind | None] = "defocus"
    tells_focus: ClassVar[bool] = True

    map: Path | str | npt.NDArray[np.floating]
    channel: str | None = None

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        _check_source("defocus", self.map)
        if isinstance(self.map, np.ndarray):
            values = np.asarray(self.map, np.float32)
        else:
            values = read_map(self.map, self.channel, window=photo.window, progress=photo.progress)
        check_map("defocus", values)
        return DepthMap(values=values, kind="defocus", origin=self.origin)


def _check_source(name: str, source: object) -> None:
    """Raise unless a map is a file or an array (h, w)."""
    check_kind(name, source, Path, str, np.ndarray, StoredMap)
    if isinstance(source, np.ndarray):
        check_rank(name, source, 2, "(h, w)")
        if source.dtype.kind not in "fiub":
            raise ParameterError(name, "an array of numbers", source, shown=f"one of {source.dtype}")
