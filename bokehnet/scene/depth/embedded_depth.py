"""Depth stored in the picture's own file."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from bokehnet.errors import ParameterError
from bokehnet.inference.depth_models import recommended_model
from bokehnet.inference.model_download import downloads_forbidden
from bokehnet.io.formats.heif import is_heif
from bokehnet.io.metadata.camera import Camera
from bokehnet.io.phone_depth import PhoneDepth, has_phone_depth, read_phone_depth
from bokehnet.io.selection.map_channels import picture_depth_channel
from bokehnet.io.window import Window
from bokehnet.scene.camera import DEFAULT_FOCAL_LENGTH, full_frame_camera, has_view
from bokehnet.scene.depth.depth_map import DepthMap, Kind, Photo
from bokehnet.scene.depth.explicit_depth import MetricDepth
from bokehnet.scene.depth.network_depth import cached_network

__all__ = ["EmbeddedDepth", "has_own_depth", "no_depth_error"]

# Distance of the nearest point, mm, for a phone's map without distances; the farthest is at infinity.
_NEAREST_DISTANCE = 1000.0


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EmbeddedDepth:
    """Depth map in the picture's own file: a phone's, or the depth channel of an EXR.

    Depth of an EXR is read as by :class:`MetricDepth`, in metres; with ``relative`` its disparity is scaled
    to 0 to 1. A phone's map is rendered as by a full-frame camera: the phone's own lens has a focal length of
    a few millimetres and almost no blur. F-numbers refer to the camera with the same view on 36 x 24 mm film,
    which the portrait modes of phones imitate as well. A picture without any map is treated equally, with a
    map estimated by the first named network on this machine.

    Attributes:
        map: Result of :func:`bokehnet.io.phone_depth.read_phone_depth`; None reads the picture's own file.
        relative: True for relative disparity, 0 to 1; False for 1/mm; None for the kind in the file.
        relative_estimate: True for relative disparity if a network estimates the map.

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
    relative_estimate: bool = False

    @property
    def origin(self) -> str:
        """Description for messages, as no setting names the source."""
        return "camera.blur" if self.relative else "a photo's own depth"

    @property
    def kind(self) -> Kind | None:
        """Requested kind; None if only the file determines it."""
        return None if self.relative is None else "relative" if self.relative else "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        embedded = self.map
        if embedded is None and photo.path is not None:
            embedded = read_phone_depth(photo.path)
            if embedded is None and (channel := picture_depth_channel(photo.path)) is not None:
                return self._from_exr(photo, photo.path, channel)
        estimator = ""
        if embedded is None and (network := cached_network()) is not None:
            estimate = network.depth_map(photo)
            embedded = PhoneDepth(disparity=estimate.values, metric=estimate.kind == "metric")
            estimator = str(network.model)
        if embedded is None:
            raise no_depth_error(photo.path)
        window = photo.window
        if embedded.all_in_focus is not None:
            height, width = embedded.all_in_focus.shape[:2]
            window = Window.whole(width, height)
        relative = not embedded.metric if self.relative is None else self.relative
        relative = relative or (self.relative_estimate and bool(estimator))
        values, focus = _rescaled(embedded, relative)
        return DepthMap(
            values=values,
            kind="relative" if relative else "metric",
            origin="the photo's own depth",
            fits_any_size=True,
            camera=full_frame_camera(photo.camera, window.width, window.height),
            focus=focus,
            all_in_focus=embedded.all_in_focus,
            assumptions=_assumptions(embedded, photo.camera, estimator, relative=relative),
        )

    def _from_exr(self, photo: Photo, path: Path, channel: str) -> DepthMap:
        """Return the depth in a channel of the picture's EXR file."""
        depth = MetricDepth(map=path, channel=channel).depth_map(photo)
        depth = replace(
            depth,
            origin=f"the picture's own channel {channel}",
            notes=(f"{path}: using its channel {channel} as depth in metres; `input.depth` overrides this",),
        )
        if not self.relative:
            return depth
        low, high = float(depth.values.min()), float(depth.values.max())
        values = (depth.values - low) / ((high - low) or 1.0)
        assumptions = (*depth.assumptions, "disparity relative to its range (`input.depth` keeps metres)")
        return replace(
            depth, values=values, kind="relative", camera=None, filtered=None, assumptions=assumptions
        )


def _assumptions(
    embedded: PhoneDepth, camera: Camera | None, estimator: str, *, relative: bool
) -> tuple[str, ...]:
    """Return the estimator of a map, and the assumed distances and focal length of a metric render."""
    assumptions = [f"depth estimated by {estimator}"] if estimator else []
    if not relative and not embedded.metric:
        assumptions.append(f"nearest point at {_NEAREST_DISTANCE / 1000:g} m, farthest at infinity")
    if not relative and not has_view(camera):
        assumptions.append(f"{DEFAULT_FOCAL_LENGTH:g} mm on full frame")
    return tuple(assumptions)


def has_own_depth(path: Path) -> bool:
    """Return whether a picture's file holds depth; reads no pixels of the picture.

    Raises:
        ImageFileError: The file cannot be read.

    Examples:
        >>> from bokehnet.io.image import write_image
        >>> write_image("photo.png", np.ones((2, 3, 3), np.float32))
        >>> has_own_depth(Path("photo.png"))
        False
    """
    return has_phone_depth(path) or (not is_heif(path) and picture_depth_channel(path) is not None)


def no_depth_error(path: Path | None) -> ParameterError:
    """Return the error of a picture without depth.

    Args:
        path: File of the picture; None for an array.

    Examples:
        >>> print(no_depth_error(Path("photo.png")))
        input.disparity: expected one of `input.disparity` and `input.depth`, got neither, and photo.png has
        no depth map; ...
    """
    return ParameterError(
        "input.disparity",
        expected="one of `input.disparity` and `input.depth`",
        shown=f"neither, and {'the picture' if path is None else path} has no depth map",
        remedy=_network_remedy(),
    )


def _network_remedy() -> str:
    """Return how to get a network that estimates the missing depth."""
    model = recommended_model()
    if model is None or downloads_forbidden():
        return "`input.depth_model` estimates it with the file of a network; `bokehnet studio` can paint it"
    command = f"`bokehnet models {model.name} --get`"
    licence = f"{model.size}, licence {model.licence}"
    return f"{command} downloads a network that estimates it ({licence}); `bokehnet studio` can paint it"


def _rescaled(embedded: PhoneDepth, relative: bool) -> tuple[npt.NDArray[np.float32], float | None]:
    """Return map and focus of a phone, in 1/mm or relative."""
    values, focus = embedded.disparity, embedded.focus_disparity
    low, high = float(values.min()), float(values.max())
    if embedded.metric and relative:
        span = high - low or 1.0
        return (values - low) / span, None if focus is None else min(max((focus - low) / span, 0.0), 1.0)
    if not embedded.metric and not relative:
        return values / _NEAREST_DISTANCE, None if focus is None else focus / _NEAREST_DISTANCE
    return values, focus
