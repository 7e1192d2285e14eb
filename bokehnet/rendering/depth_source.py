"""Where the depth of a picture comes from: one class for each kind, from arrays or from files alike.

A source says what it needs when it is made, and gives a :class:`DepthMap` when it is asked for that of a
picture. To add a source: a class with ``depth_map`` here, a field of ``InputSettings`` that picks it, and a
line in :func:`depth_source`.
"""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal, Protocol

import numpy as np
import numpy.typing as npt

from bokehnet.checks import check_kind, check_map, check_rank, number_of
from bokehnet.errors import ImageFileError, ParameterError
from bokehnet.inference.depth_convention import find_convention
from bokehnet.inference.monocular import DepthEstimator
from bokehnet.io.camera import Camera, camera_from_exr
from bokehnet.io.maps import depth_to_mm, own_depth_channel, read_depth, read_disparity, read_map
from bokehnet.io.phone_depth import PhoneDepth, read_phone_depth
from bokehnet.io.pixels import ImageFile
from bokehnet.io.row_blocks import in_row_blocks
from bokehnet.io.window import Window
from bokehnet.optics.coc import disparity_from_depth
from bokehnet.rendering.camera import full_frame_camera, joined
from bokehnet.rendering.settings import RenderSettings

__all__ = [
    "ConstantDisparity",
    "DefocusMap",
    "DepthMap",
    "DepthSource",
    "EmbeddedDepth",
    "MetricDepth",
    "NetworkDepth",
    "Photo",
    "RelativeDisparity",
    "depth_source",
    "tells_distances",
    "unit_of_own_depth",
]

Kind = Literal["relative", "metric", "defocus"]

# Distance of the nearest point, mm, where a phone tells no distances; the farthest is at infinity.
_NEAREST = 1000.0

# Range of a map over its largest value below which it is as good as constant.
_FLAT = 0.02

# Side of the middle of the photo, over that of the photo, that is sharp when nobody says what shall be.
_MIDDLE = 1 / 5


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Photo:
    """What a source may look at.

    Attributes:
        image: Scene-linear, (H, W, 3).
        window: Where its pixels lie in the shown picture.
        camera: What its file says of the camera; None where it says nothing.
        path: Its file; None for an array.

    Examples:
        >>> photo = Photo(image=np.ones((4, 6, 3), np.float32), window=Window.whole(6, 4))
        >>> ConstantDisparity(value=0.25).depth_map(photo).values.shape
        (4, 6)
    """

    image: npt.NDArray[np.float32]
    window: Window
    camera: Camera | None = None
    path: Path | None = None


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
        >>> from bokehnet.rendering.scene import make_scene
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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RelativeDisparity:
    """Relative disparity, near is large: what monocular networks and stereo give.

    Attributes:
        map: File or array (h, w).
        channel: Of a file: which one; None takes what looks like depth.
        invert: Whether far is large: ``1 - value``, once it runs from 0 to 1.
        value_range: Values that become 0 and 1; None takes the lowest and the highest.
        as_stored: Whether values are 0 to 1 already and stay, as the maps of a sequence, which must be
            treated alike; with a ``value_range`` that decides.

    Examples:
        >>> import numpy as np
        >>> from bokehnet.rendering import scene
        >>> disparity = np.tile(np.linspace(0, 255, 6, dtype=np.float32), (4, 1))
        >>> made = scene.make_scene(np.ones((4, 6, 3), np.float32), RelativeDisparity(map=disparity))
        >>> float(made.depth.values.max())
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
            values = read_disparity(self.map, self.channel, normalise=False, window=photo.window)
        notes: tuple[str, ...] = ()
        if not stored:
            notes = _about_range(values)
            values = _stretched(values)
        if self.value_range is not None:
            low, high = self.value_range
            if not (math.isfinite(low) and math.isfinite(high) and low != high):
                raise ParameterError("depth.value_range", "two different numbers", self.value_range)
            values = ((values.astype("float64") - low) / (high - low)).astype("float32")
        elif self.as_stored and not (values.min() >= 0 and values.max() <= 1):
            found = f"{values.min():g} to {values.max():g}"
            way_out = "say with `depth.value_range` which values are 0 and 1"
            if isinstance(self.map, np.ndarray):
                raise ParameterError("disparity", "0 to 1, as it is stored", shown=found, remedy=way_out)
            raise ImageFileError(
                f"{self.map}: expected disparity in 0..1, as it is stored, in a sequence, found "
                f"{found}; {way_out}"
            )
        values = 1 - values if self.invert else values
        return DepthMap(values=values, kind="relative", origin=self.origin, notes=notes)


def _about_range(values: npt.NDArray[np.float32]) -> tuple[str, ...]:
    """What a map that tells next to nothing is worth a word about."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return (f"the disparity map is {low:g} everywhere: all is blurred alike",)
    if high - low < _FLAT * max(abs(low), abs(high)):
        return (
            f"the disparity map only runs from {low:.6g} to {high:.6g}, which becomes 0 to 1, noise and all; "
            "`depth.value_range` says which values shall",
        )
    return ()


def _check_source(name: str, source: object) -> None:
    """Raise unless a map is a file or an array (h, w)."""
    check_kind(name, source, Path, str, np.ndarray)
    if isinstance(source, np.ndarray):
        check_rank(name, source, 2, "(h, w)")
        if source.dtype.kind not in "fiub":
            raise ParameterError(name, "an array of numbers", source, shown=f"one of {source.dtype}")


def _stretched(values: npt.NDArray[np.floating]) -> npt.NDArray[np.float32]:
    """A map over its own range, 0 to 1; a constant one keeps its value, clipped."""
    low, high = float(values.min()), float(values.max())
    if low == high:
        return np.clip(values, 0, 1).astype(np.float32)
    stretched: npt.NDArray[np.float32] = in_row_blocks(
        lambda rows: ((rows.astype(np.float64) - low) / (high - low)).astype(np.float32), values
    )
    return stretched


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class MetricDepth:
    """Depth in a unit of length along the optical axis, as renderers write it; sky is infinite.

    Attributes:
        map: File or array (h, w).
        channel: Of a file: which one; None takes what looks like depth.
        unit: One of ``bokehnet.io.maps.DEPTH_UNITS``; 1/m is metric disparity, where sky is 0.

    Examples:
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
        _check_source("depth", self.map)
        if isinstance(self.map, np.ndarray):
            depth, camera = depth_to_mm(self.map, self.unit), photo.camera
        else:
            depth = read_depth(self.map, self.channel, unit=self.unit, window=photo.window)
            camera = joined(photo.camera, _camera_of(Path(self.map)))
        return DepthMap(
            values=disparity_from_depth(depth),  # sky at infinite depth is 0 from here on
            kind="metric",
            origin=self.origin,
            filtered="disparity" if self.unit == "1/m" else "depth",
            camera=camera,
        )


def _camera_of(path: Path) -> Camera | None:
    """What the first part of an EXR file says of the camera."""
    with ImageFile(path) as file:
        return None if file.headers is None else camera_from_exr(file.attributes(file.parts[0]))


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class EmbeddedDepth:
    """The map that a picture's own file holds: what a phone has put there, or the depth channel of an EXR.

    Depth of an EXR is that of :class:`MetricDepth`, metres. A phone's is blurred as by a full-frame camera:
    its own lens, a few millimetres long, blurs next to nothing. What people mean by an f-number is the camera
    that has the same view on 36 x 24 mm of film, which is what portrait modes of phones imitate too.

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
            if found is None and (channel := own_depth_channel(photo.path)) is not None:
                return self._of_exr(photo, photo.path, channel)
        if found is None:
            holder = "the picture" if photo.path is None else photo.path
            raise ParameterError(
                "input.disparity",
                expected="one of `input.disparity` and `input.depth`",
                shown=f"neither, and {holder} holds no depth map",
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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NetworkDepth:
    """Depth guessed by a monocular network in ONNX.

    Attributes:
        model: Its file.
        convention: What it sees and returns: a name, or a TOML file.
        threads: Threads inside the network; 0 takes all cores.

    Examples:
        >>> source = NetworkDepth(model="depth.onnx", threads=2)  # opened when its map is asked for
        >>> source.convention, source.kind
        ('depth-anything-v2', 'relative')
    """

    origin: ClassVar[str] = "input.depth_model"

    model: Path | str
    convention: str | Path = "depth-anything-v2"
    threads: int = 0

    @property
    def kind(self) -> Kind:
        """As its convention says."""
        return "relative" if find_convention(self.convention).unit == "none" else "metric"

    @property
    def tells_focus(self) -> bool:
        """Where distances are known, the photo's file may."""
        return self.kind == "metric"

    def depth_map(self, photo: Photo) -> DepthMap:
        """See :class:`DepthSource`."""
        estimator = DepthEstimator(self.model, find_convention(self.convention), self.threads)
        values = estimator(photo.image)
        return DepthMap(values=values, kind=self.kind, origin=self.origin, camera=photo.camera)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ConstantDisparity:
    """A flat scene: one relative disparity everywhere.

    Attributes:
        value: 0, far, to 1, near.

    Examples:
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
    """Blur radii that are known already, pixels, above 0 in front of focus; nothing is left to focus.

    Attributes:
        map: File or array (H, W), of the picture's size.
        channel: Of a file: which one; None takes what looks like depth.

    Examples:
        >>> from bokehnet.rendering.scene import make_scene
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
            values = read_map(self.map, self.channel, window=photo.window)
        check_map("defocus", values)
        return DepthMap(values=values, kind="defocus", origin=self.origin)


def depth_source(settings: RenderSettings) -> DepthSource:
    """Return the source that the settings name; without any, what a phone's photo holds.

    Examples:
        >>> from bokehnet.rendering.settings import DepthSettings, InputSettings
        >>> settings = RenderSettings(input=InputSettings(depth="z.exr"), depth=DepthSettings(unit="cm"))
        >>> source = depth_source(settings)
        >>> source.origin, source.kind, source.unit
        ('input.depth', 'metric', 'cm')
    """
    given, reading = settings.input, settings.depth
    if given.disparity is not None:
        return RelativeDisparity(
            map=given.disparity,
            channel=given.channel,
            invert=reading.invert,
            value_range=reading.value_range,
            as_stored=reading.as_stored,
        )
    if given.depth is not None:
        return MetricDepth(map=given.depth, channel=given.channel, unit=reading.unit or "m")
    if given.defocus is not None:
        return DefocusMap(map=given.defocus, channel=given.channel)
    if given.depth_model is not None:
        return NetworkDepth(model=given.depth_model, convention=given.depth_convention or "depth-anything-v2")
    if given.constant_disparity is not None:
        return ConstantDisparity(value=given.constant_disparity)
    return EmbeddedDepth(relative=settings.camera.blur is not None)


def tells_distances(settings: RenderSettings, *, blur_pulled: bool = False) -> bool:
    """Whether what the settings name tells distances; else relative disparity, or blur itself.

    Args:
        settings: Name the source.
        blur_pulled: Whether blur changes over a sequence, which makes a phone's map relative as blur does.

    Examples:
        >>> from bokehnet.rendering.settings import InputSettings
        >>> tells_distances(RenderSettings(input=InputSettings(depth="z.exr")))
        True
    """
    source = depth_source(settings)
    return source.kind == "metric" and not (blur_pulled and isinstance(source, EmbeddedDepth))


def unit_of_own_depth(source: DepthSource, path: Path | str) -> str | None:
    """Unit of length of depth that a picture's own file holds; None where the depth is from elsewhere.

    Args:
        source: Tells the depth.
        path: File of the picture.

    Examples:
        >>> unit_of_own_depth(MetricDepth(map="deep.exr", unit="cm"), "deep.exr")
        'cm'
        >>> unit_of_own_depth(MetricDepth(map="z.exr"), "deep.exr")
    """
    if isinstance(source, EmbeddedDepth):
        return "m" if source.map is None and not source.relative else None
    if not isinstance(source, MetricDepth) or isinstance(source.map, np.ndarray) or source.unit == "1/m":
        return None
    return source.unit if Path(source.map).resolve() == Path(path).resolve() else None
