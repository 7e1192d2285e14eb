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
from bokehnet.io.maps import depth_to_mm, read_depth, read_disparity, read_map
from bokehnet.io.metadata.camera import Camera, camera_from_exr
from bokehnet.io.pixels import ImageFile
from bokehnet.scene.camera import merged_camera
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo

__all__ = ["ConstantDisparity", "DefocusMap", "MetricDepth", "RelativeDisparity"]

# Maximum range of a map, relative to its largest value, that counts as constant.
_MAX_CONSTANT_RANGE = 0.02


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RelativeDisparity:
    """Relative disparity, near is large, as from monocular networks and stereo.

    Attributes:
        map: File or array (h, w).
        channel: Channel of a file; None detects it.
        invert: True if far is large: uses ``1 - value`` after normalisation.
        value_range: Values that map to 0 and 1; None uses the lowest and the highest.
        as_stored: True to use values as stored, 0 to 1, so that all maps of a sequence have one scale; a
            ``value_range`` overrides it.

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

    map: Path | str | npt.NDArray[np.floating]
    channel: str | None = None
    invert: bool = False
    value_range: tuple[float, float] | None = None
    as_stored: bool = False

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        _check_source("disparity", self.map)
        stored = self.as_stored or self.value_range is not None
        if isinstance(self.map, np.ndarray):
            check_map("disparity", self.map)
            values = np.asarray(self.map, np.float32)
        else:
            values = read_disparity(
                self.map, self.channel, normalise=False, window=photo.window, progress=photo.progress
            )
        notes: tuple[str, ...] = ()
        if not stored:
            notes = _range_warnings(values)
            values = _normalised(values)
        if self.value_range is not None:
            low, high = self.value_range
            if not (math.isfinite(low) and math.isfinite(high) and low != high):
                raise ParameterError("depth.value_range", "two different numbers", self.value_range)
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
        return DepthMap(values=values, kind="relative", origin=self.origin, camera=photo.camera, notes=notes)


def _range_warnings(values: npt.NDArray[np.float32]) -> tuple[str, ...]:
    """Return a warning about a constant or almost constant map."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return (f"the disparity map is {low:g} everywhere: every pixel is blurred equally",)
    if high - low < _MAX_CONSTANT_RANGE * max(abs(low), abs(high)):
        return (
            f"the disparity map only ranges from {low:.6g} to {high:.6g}; stretching it to 0 to 1 amplifies "
            "its "
            "noise; `depth.value_range` sets the values that map to 0 and 1",
        )
    return ()


def _normalised(values: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """Return a map normalised to 0 to 1; a constant map keeps its value, clipped."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return np.clip(values, 0, 1).astype(np.float32)
    stretched: npt.NDArray[np.float32] = in_row_blocks(
        lambda rows: ((rows.astype(np.float64) - low) / (high - low)).astype(np.float32), values
    )
    return stretched


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MetricDepth:
    """Metric depth along the optical axis, as renderers write it; sky is infinite.

    Attributes:
        map: File or array (h, w).
        channel: Channel of a file; None detects it.
        unit: One of ``bokehnet.io.maps.DEPTH_UNITS``; 1/m is metric disparity, 0 for sky.

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
    unit: str = "m"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        from bokehnet.optics.coc import disparity_from_depth  # imports numba, 0.2 s

        _check_source("depth", self.map)
        if isinstance(self.map, np.ndarray):
            depth, camera = depth_to_mm(self.map, self.unit), photo.camera
        else:
            depth = read_depth(
                self.map, self.channel, unit=self.unit, window=photo.window, progress=photo.progress
            )
            camera = merged_camera(photo.camera, _camera_of(Path(self.map)))
        return DepthMap(
            values=disparity_from_depth(depth),  # 0 for sky at infinite depth
            kind="metric",
            origin=self.origin,
            filtered="disparity" if self.unit == "1/m" else "depth",
            camera=camera,
        )


def _camera_of(path: Path) -> Camera | None:
    """Return the camera data in the first part of an EXR file."""
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
    check_kind(name, source, Path, str, np.ndarray)
    if isinstance(source, np.ndarray):
        check_rank(name, source, 2, "(h, w)")
        if source.dtype.kind not in "fiub":
            raise ParameterError(name, "an array of numbers", source, shown=f"one of {source.dtype}")
