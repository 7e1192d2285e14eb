"""What is known of the depth of a picture, and whatever can tell it."""

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
    """What a source may look at.

    Attributes:
        image: Scene-linear, (H, W, 3).
        window: Where its pixels lie in the shown picture.
        camera: What its file says of the camera; None where it says nothing.
        path: Its file; None for an array.
        progress: Is told how far the reading of a map is.

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
    """Surfaces behind one another, front to back.

    Attributes:
        colors: Scene-linear light of each surface by itself, (H, W, L, 3).
        values: In the unit of the map, near is large, (H, W, L); never larger than those before.
        coverage: Share of the pixel that each covers, (H, W, L), 0 to 1.

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
    """What is known of the depth of a picture.

    Attributes:
        values: Disparity, near is large: 1/mm if metric, else relative, 0 to 1; for the kind "defocus" the
            signed blur radius in pixels. (h, w), of the picture's size or of another one.
        kind: What the values are.
        origin: The setting that told where it comes from, for messages.
        fits_any_size: Whether a map of another size than the picture's is brought to it without being asked.
        filtered: What its renderer filtered, where it did: depth or disparity. None where that is not so.
        camera: What is known of the camera to blur as, where distances are known.
        focus: Value of the map that stays sharp when nothing else is said; None where that must be said.
        all_in_focus: Picture to render in place of the given one, (H, W, 3): a phone's before it was blurred.
        notes: What is odd about the map, or was chosen, a line each.
        layers: What stands behind one another, where that is known.

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


class DepthSource(Protocol):
    """Whatever can tell the depth of a picture.

    Attributes:
        origin: The setting that names it, or words for it, for messages.
        kind: What its maps are, as far as that is known before one is seen; None where it is not.
        tells_focus: Whether it may know what stays sharp.

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
        """Return the map of a picture; ``BokehnetError`` where there is none."""
        ...
