"""Pixels in memory that two processes share: a file that both have mapped, on Linux in ``/dev/shm``."""

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

_MOST = 1 << 16  # pixels along a side


@dataclass(frozen=True, kw_only=True, slots=True)
class PixelLayout:
    """Where what lies in the file; all are float32, rows from the top down, with no gaps.

    Attributes:
        file: What is mapped.
        width: Of the picture, pixels.
        height: Likewise.
        image: Where the picture begins, bytes: (height, width, 4), premultiplied scene-linear RGBA.
        depth: Where the map begins: (height, width).
        result: Where the result goes, as the picture is; its own place is allowed.
        matte: Where a foreground's coverage begins, (height, width); None where there is none.
        kind: Of the map: metres along the axis, their inverse, relative disparity, or blur radii in pixels.
        x: Column of the shown picture, whose width that of the sensor spans, in which the first pixel lies.
        y: Its row.
        display_width: Of the shown picture, pixels; 0 is ``width``.
        display_height: Likewise.
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
            _check_whole(name, getattr(self, name), 1, _MOST)
        for name in ("display_width", "display_height"):
            _check_whole(name, getattr(self, name), 0, _MOST)
        for name in ("image", "depth", "result"):
            _check_whole(name, getattr(self, name), 0, 1 << 48)
        for name in ("x", "y"):
            _check_whole(name, getattr(self, name), -_MOST, _MOST)
        if self.matte is not None:
            _check_whole("matte", self.matte, 0, 1 << 48)
        if self.kind not in get_args(Kind):
            raise ParameterError("pixels.kind", f"one of {', '.join(get_args(Kind))}", self.kind)


class SharedPixels:
    """A picture and its map in shared memory, and the place of the result.

    Args:
        layout: Where what lies.
        memory: What is mapped.

    Examples:
        >>> _ = Path("shared").write_bytes(np.ones((4, 6, 5), np.float32).tobytes())
        >>> told = {"file": "shared", "width": 6, "height": 4, "image": 0, "depth": 384, "result": 0}
        >>> with SharedPixels.opened(told) as pixels:
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
    def opened(told: Mapping[str, Any]) -> Iterator["SharedPixels"]:
        """Map the file that a request names.

        Args:
            told: Fields of the layout.

        Raises:
            ParameterError: A field is missing, unknown or out of range, or the file is too short for it.
            ImageFileError: The file cannot be opened.
        """
        known = {item.name for item in fields(PixelLayout)}
        needed = ("file", "width", "height", "image", "depth", "result")
        if not isinstance(told, Mapping) or set(told) - known or any(name not in told for name in needed):
            expected = f"fields {', '.join(needed)}, and others of {', '.join(sorted(known))}"
            raise ParameterError("pixels", expected, shown=str(told))
        layout = PixelLayout(**told)
        try:
            with Path(layout.file).open("r+b") as file:
                memory = mmap.mmap(file.fileno(), 0)
        except (OSError, ValueError) as error:
            raise ImageFileError(f"cannot map {layout.file}: {error}") from error
        pixels = SharedPixels(layout, memory)
        try:
            yield pixels
        finally:
            pixels._let_go()
            with suppress(BufferError):  # somebody still looks at an array of it: it goes with that one
                memory.close()

    def scene(self) -> Scene:
        """Return the picture with its map as a scene; where coverage is 1 all over, without alpha."""
        told, alpha = self._layout, np.clip(self._image[..., 3], 0, 1)
        width, height = told.display_width or told.width, told.display_height or told.height
        window = Window(
            x=told.x,
            y=told.y,
            width=told.width,
            height=told.height,
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
        """Put a result in its place, with its coverage."""
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

    def _let_go(self) -> None:
        del self._image, self._result, self._depth, self._matte


def _check_whole(name: str, value: object, low: int, high: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ParameterError(f"pixels.{name}", f"a whole number, {low} to {high}", value)
