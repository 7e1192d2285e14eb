"""Pixels in shared memory of two processes: a file mapped by both, on Linux in ``/dev/shm``."""

import mmap
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.io.window import Window
from bokehnet.render.result import RenderResult
from bokehnet.scene.depth.depth_source import DefocusMap, DepthSource, MetricDepth, RelativeDisparity
from bokehnet.scene.scene import Scene, make_scene

__all__ = ["SharedPixels"]

Array = npt.NDArray[np.float32]
Kind = Literal["depth", "1/z", "disparity", "defocus"]

_MAX_SIDE_PX = 1 << 16


@dataclass(frozen=True, kw_only=True, slots=True)
class PixelLayout:
    """Layout of the file; all arrays are float32, rows from the top down, without padding.

    Attributes:
        file: Path of the mapped file.
        width: Width of the picture, pixels.
        height: Height of the picture, pixels.
        image: Offset of the picture, bytes: (height, width, 4), premultiplied scene-linear RGBA.
        depth: Offset of the map, bytes: (height, width).
        result: Offset of the result, bytes, with the shape of the picture; may equal ``image``.
        matte: Offset of a foreground's coverage, bytes, (height, width); None if there is none.
        kind: Kind of the map: depth in metres along the axis, its inverse, relative disparity, or blur radii
            in pixels.
        x: Column of the first pixel in the display window, whose width corresponds to that of the sensor.
        y: Row of the first pixel in the display window.
        display_width: Width of the display window, pixels; 0 for ``width``.
        display_height: Height of the display window, pixels; 0 for ``height``.
    """

    file: str
    width: int
    height: int
    image: int
    depth: int
    result: int
    matte: int | None = None
    kind: Kind = "depth"
    x: int = 0
    y: int = 0
    display_width: int = 0
    display_height: int = 0

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            _check_integer(name, getattr(self, name), 1, _MAX_SIDE_PX)
        for name in ("display_width", "display_height"):
            _check_integer(name, getattr(self, name), 0, _MAX_SIDE_PX)
        for name in ("image", "depth", "result"):
            _check_integer(name, getattr(self, name), 0, 1 << 48)
        for name in ("x", "y"):
            _check_integer(name, getattr(self, name), -_MAX_SIDE_PX, _MAX_SIDE_PX)
        if self.matte is not None:
            _check_integer("matte", self.matte, 0, 1 << 48)
        if self.kind not in get_args(Kind):
            raise ParameterError("pixels.kind", f"one of {', '.join(get_args(Kind))}", self.kind)


class SharedPixels:
    """A picture with its map and the space for the result in shared memory.

    Args:
        layout: Layout of the memory.
        memory: Mapped file.

    Examples:
        >>> _ = Path("shared").write_bytes(np.ones((4, 6, 5), np.float32).tobytes())
        >>> layout = {"file": "shared", "width": 6, "height": 4, "image": 0, "depth": 384, "result": 0}
        >>> with SharedPixels.opened(layout) as pixels:
        ...     pixels.scene().depth.kind
        'metric'
    """

    def __init__(self, layout: PixelLayout, memory: mmap.mmap) -> None:
        self._layout, self._memory = layout, memory
        self._image, self._result = self._rgba(layout.image, "image"), self._rgba(layout.result, "result")
        self._depth = self._plane(layout.depth, "depth")
        self._matte = None if layout.matte is None else self._plane(layout.matte, "matte")

    @staticmethod
    @contextmanager
    def opened(layout: Mapping[str, Any]) -> Iterator["SharedPixels"]:
        """Map the file of a request.

        Args:
            layout: Fields of a :class:`PixelLayout`.

        Raises:
            ParameterError: A field is missing, unknown or out of range, or the file is too short.
            ImageFileError: The file cannot be opened.
        """
        known = {item.name for item in fields(PixelLayout)}
        required = ("file", "width", "height", "image", "depth", "result")
        if (
            not isinstance(layout, Mapping)
            or set(layout) - known
            or any(name not in layout for name in required)
        ):
            expected = f"fields {', '.join(required)}, and others of {', '.join(sorted(known))}"
            raise ParameterError("pixels", expected, shown=str(layout))
        pixel_layout = PixelLayout(**layout)
        try:
            with Path(pixel_layout.file).open("r+b") as file:
                memory = mmap.mmap(file.fileno(), 0)
        except (OSError, ValueError) as error:
            raise ImageFileError(f"cannot map {pixel_layout.file}: {error}") from error
        pixels = SharedPixels(pixel_layout, memory)
        try:
            yield pixels
        finally:
            pixels._release()
            with suppress(BufferError):  # another array still uses the memory, which closes with that array
                memory.close()

    def scene(self) -> Scene:
        """Return the picture with its map as a scene; without alpha if coverage is 1 everywhere."""
        layout, alpha = self._layout, np.clip(self._image[..., 3], 0, 1)
        width, height = layout.display_width or layout.width, layout.display_height or layout.height
        window = Window(
            x=layout.x,
            y=layout.y,
            width=layout.width,
            height=layout.height,
            display_width=width,
            display_height=height,
        )
        return make_scene(
            np.maximum(self._image[..., :3], 0),
            self._source(),
            alpha=None if (alpha == 1).all() else alpha,
            window=window,
            matte=None if self._matte is None else np.clip(self._matte, 0, 1),
        )

    def write(self, result: RenderResult) -> None:
        """Store a result with its coverage."""
        self._result[..., :3] = result.bokeh
        self._result[..., 3] = 1 if result.alpha is None else result.alpha

    def _source(self) -> DepthSource:
        values, kind = np.array(self._depth), self._layout.kind
        if kind == "defocus":
            return DefocusMap(map=values)
        if kind == "disparity":
            return RelativeDisparity(map=values, value_range=(0, 1))
        return MetricDepth(map=values, unit="1/m" if kind == "1/z" else "m")

    def _rgba(self, offset: int, name: str) -> Array:
        return self._numbers(offset, name, 4).reshape(self._layout.height, self._layout.width, 4)

    def _plane(self, offset: int, name: str) -> Array:
        return self._numbers(offset, name, 1).reshape(self._layout.height, self._layout.width)

    def _numbers(self, offset: int, name: str, channels: int) -> Array:
        count = self._layout.height * self._layout.width * channels
        if offset % 4 or offset + 4 * count > len(self._memory):
            size = len(self._memory)
            expected = f"a multiple of 4 up to {size - 4 * count} in a file of {size} bytes"
            raise ParameterError(f"pixels.{name}", expected, offset)
        return np.frombuffer(self._memory, np.float32, count, offset)

    def _release(self) -> None:
        del self._image, self._result, self._depth, self._matte


def _check_integer(name: str, value: object, low: int, high: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ParameterError(f"pixels.{name}", f"a whole number, {low} to {high}", value)
