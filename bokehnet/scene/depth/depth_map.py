"""Depth map of a picture, and the interface of depth sources."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import numpy.typing as npt

from bokehnet.io.metadata.camera import Camera
from bokehnet.io.window import Window
from bokehnet.progress import Progress

__all__ = ["DepthMap", "DepthSource", "Kind", "Photo", "SceneLayers"]

Kind = Literal["relative", "metric", "defocus"]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Photo:
    """Input of a depth source.

    Attributes:
        image: Picture, scene-linear, (H, W, 3).
        window: Position of its pixels in the shown picture.
        camera: Camera data of its file; None if there are none.
        path: Its file; None for an array.
        progress: Progress callback for reading a map.

    Examples:
        >>> from bokehnet.scene.depth.depth_source import ConstantDisparity
        >>> photo = Photo(image=np.ones((4, 6, 3), np.float32), window=Window.whole(6, 4))
        >>> ConstantDisparity(value=0.25).depth_map(photo).values.shape
        (4, 6)
    """

    image: npt.NDArray[np.float32]
    window: Window
    camera: Camera | None = None
    path: Path | None = None
    progress: Progress | None = None


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class SceneLayers:
    """Successive surfaces of a scene, front to back.

    Attributes:
        colors: Unoccluded scene-linear light of each surface, (H, W, L, 3).
        values: Disparity in the unit of the map, near is large, (H, W, L), non-increasing along L.
        coverage: Coverage of the pixel by each surface, (H, W, L), 0 to 1.

    Examples:
        >>> shape = (4, 6, 2)
        >>> SceneLayers(
        ...     colors=np.ones((*shape, 3), np.float32),
        ...     values=np.zeros(shape, np.float32),
        ...     coverage=np.ones(shape, np.float32),
        ... ).values.shape
        (4, 6, 2)
    """

    colors: npt.NDArray[np.float32]
    values: npt.NDArray[np.float32]
    coverage: npt.NDArray[np.float32]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DepthMap:
    """Depth of a picture.

    Attributes:
        values: Disparity, near is large: 1/mm if metric, else relative, 0 to 1; for the kind "defocus" the
            signed blur radius in pixels. (h, w), of the picture's size or of another one.
        kind: Kind of the values.
        origin: Setting that names its source, for messages.
        fits_any_size: True if a map of another size is always resized to the picture.
        filtered: Quantity that the renderer filtered, depth or disparity; None if not filtered.
        camera: Known data of the camera to imitate, for metric depth; of the photo's camera otherwise.
        focus: Default focus, a value of the map; None if the settings must contain the focus.
        all_in_focus: Picture to render instead, (H, W, 3): a phone's original before its portrait blur.
        notes: Warnings about the map and automatic choices, one line each.
        layers: Successive surfaces, where they are known.
        assumptions: Assumptions about the map and the camera, a few words each: unit, direction,
            coding, holes.

    Examples:
        >>> metres = np.array([[1, 2, np.inf]], np.float32)
        >>> depth = DepthMap(values=0.001 / metres, kind="metric", origin="input.depth")
        >>> (1000 * depth.values).round(2).tolist()  # 1/m
        [[1.0, 0.5, 0.0]]
    """

    values: npt.NDArray[np.float32]
    kind: Kind
    origin: str
    fits_any_size: bool = False
    filtered: Literal["depth", "disparity"] | None = None
    camera: Camera | None = None
    focus: float | None = None
    all_in_focus: npt.NDArray[np.float32] | None = None
    notes: tuple[str, ...] = ()
    layers: SceneLayers | None = None
    assumptions: tuple[str, ...] = ()


class DepthSource(Protocol):
    """Source of the depth of a picture.

    Attributes:
        origin: Setting that names it, or words for it, for messages.
        kind: Kind of its maps; None if unknown before reading.
        tells_focus: True if its maps may contain a default focus.

    Examples:
        >>> class Ramp:  # far on the left, near on the right
        ...     origin, kind, tells_focus = "a ramp", "relative", False
        ...     def depth_map(self, photo):
        ...         values = np.linspace(0, 1, photo.image.shape[1], dtype=np.float32)
        ...         values = np.tile(values, (photo.image.shape[0], 1))
        ...         return DepthMap(values=values, kind=self.kind, origin=self.origin)
        >>> from bokehnet.scene.scene import make_scene
        >>> make_scene(np.ones((4, 5, 3), np.float32), Ramp()).depth.values[0].tolist()
        [0.0, 0.25, 0.5, 0.75, 1.0]
    """

    @property
    def origin(self) -> str:
        """See the class."""
        ...

    @property
    def kind(self) -> Kind | None:
        """See the class."""
        ...

    @property
    def tells_focus(self) -> bool:
        """See the class."""
        ...

    def depth_map(self, photo: Photo) -> DepthMap:
        """Return the depth map of a picture, or raise ``BokehnetError`` if there is none."""
        ...
