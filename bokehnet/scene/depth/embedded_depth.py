"""Depth that the picture's own file holds."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ParameterError
from bokehnet.io.maps import picture_depth_channel
from bokehnet.io.phone_depth import PhoneDepth, read_phone_depth
from bokehnet.io.window import Window
from bokehnet.scene.camera import full_frame_camera
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.given_depth import MetricDepth
from bokehnet.scene.depth.network_depth import cached_network

__all__ = ["EmbeddedDepth"]

# Distance of the nearest point, mm, where a phone tells no distances; the farthest is at infinity.
_NEAREST = 1000.0

# Side of the middle of the photo, over that of the photo, that is sharp when nobody says what shall be.
_MIDDLE = 1 / 5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EmbeddedDepth:
    """The map that a picture's own file holds: what a phone has put there, or the depth channel of an EXR.

    Depth of an EXR is that of :class:`MetricDepth`, metres. A phone's is blurred as by a full-frame camera:
    its own lens, a few millimetres long, blurs next to nothing. What people mean by an f-number is the camera
    that has the same view on 36 x 24 mm of film, which is what portrait modes of phones imitate too. A
    picture without any map is treated alike, its map guessed by the first named network that this machine
    has.

    Attributes:
        map: What :func:`bokehnet.io.phone_depth.read_phone_depth` gives; None reads the picture's own file.
        relative: Whether relative disparity is wanted, 0 to 1, or 1/mm; None is what the file tells.

    Examples:
        >>> near_and_far = np.array([[0.001, 0.0005]], np.float32)  # 1/mm
        >>> phone = PhoneDepth(disparity=near_and_far, metric=True, focus_disparity=0.001)
        >>> photo = Photo(image=np.ones((1, 2, 3), np.float32), window=Window.whole(2, 1))
        >>> depth = EmbeddedDepth(map=phone).depth_map(photo)
        >>> depth.kind, depth.focus, depth.camera.focal_length  # in focus at 1 m, 26 mm on film
        ('metric', 0.001, 26.0)
    """

    tells_focus: ClassVar[bool] = True

    map: PhoneDepth | None = None
    relative: bool | None = None

    @property
    def origin(self) -> str:
        """Words for what it is, since no setting names it."""
        return "camera.blur" if self.relative else "a photo's own depth"

    @property
    def kind(self) -> Kind | None:
        """What is wanted; else only the photo tells."""
        return None if self.relative is None else "relative" if self.relative else "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        found = self.map
        if found is None and photo.path is not None:
            found = read_phone_depth(photo.path)
            if found is None and (channel := picture_depth_channel(photo.path)) is not None:
                return self._of_exr(photo, photo.path, channel)
        notes: tuple[str, ...] = ()
        if found is None and (network := cached_network()) is not None:
            guessed = network.depth_map(photo)
            found = PhoneDepth(disparity=guessed.values, metric=guessed.kind == "metric")
            notes = (f"depth guessed by {network.model}, since the picture holds none",)
        if found is None:
            holder = "the picture" if photo.path is None else photo.path
            raise ParameterError(
                "input.disparity",
                expected="one of `input.disparity` and `input.depth`",
                shown=f"neither, and {holder} holds no depth map",
                remedy="`input.depth_model` has a network guess it",
            )
        window = photo.window
        if found.all_in_focus is not None:
            height, width = found.all_in_focus.shape[:2]
            window = Window.whole(width, height)
        relative = not found.metric if self.relative is None else self.relative
        values, focus = _rescaled(found, relative)
        return DepthMap(
            values=values,
            kind="relative" if relative else "metric",
            origin="the photo's own depth",
            fits_any_size=True,
            camera=full_frame_camera(photo.camera, window.width, window.height),
            focus=_middle(values) if focus is None else focus,
            all_in_focus=found.all_in_focus,
            notes=notes,
        )

    def _of_exr(self, photo: Photo, path: Path, channel: str) -> DepthMap:
        """Depth in a channel beside the colours."""
        depth = MetricDepth(map=path, channel=channel).depth_map(photo)
        told = replace(
            depth,
            origin=f"the picture's own channel {channel}",
            notes=(f"{path}: depth is metres in its channel {channel}; `input.depth` can say otherwise",),
        )
        if not self.relative:
            return told
        low, high = float(depth.values.min()), float(depth.values.max())
        values = (depth.values - low) / ((high - low) or 1.0)
        return replace(told, values=values, kind="relative", camera=None, filtered=None)


def _rescaled(found: PhoneDepth, relative: bool) -> tuple[npt.NDArray[np.float32], float | None]:
    """Map and focus of a phone, in 1/mm or relative."""
    values, focus = found.disparity, found.focus_disparity
    low, high = float(values.min()), float(values.max())
    if found.metric and relative:
        span = high - low or 1.0
        return (values - low) / span, None if focus is None else min(max((focus - low) / span, 0.0), 1.0)
    if not found.metric and not relative:
        return values / _NEAREST, None if focus is None else focus / _NEAREST
    return values, focus


def _middle(disparity: npt.NDArray[np.float32]) -> float:
    """Median of the middle of a map."""
    height, width = disparity.shape
    top, left = (int(size * (1 - _MIDDLE) / 2) for size in (height, width))
    return float(np.median(disparity[top : height - top, left : width - left]))
