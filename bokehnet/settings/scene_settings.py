"""Settings of the scene: depth sources, focus and blur strength."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, get_args

from bokehnet.errors import ParameterError
from bokehnet.io.depth.units import DEPTH_UNITS, parse_depth_unit
from bokehnet.settings.fields import Group, check_needed, parse_numbers, setting

__all__ = [
    "CameraSettings",
    "DepthSettings",
    "FocusSettings",
    "InputSettings",
]

Mode = Literal["auto", "on", "off"]
Switch = Literal["on", "off"]
Pixel = tuple[int, int]

# Same names as in bokehnet.io.color.camera_spaces.
InputColorSpaceName = Literal[
    "auto",
    "srgb",
    "display-p3",
    "adobe-rgb",
    "prophoto",
    "rec2020",
    "linear",
    "aces2065-1",
    "acescg",
    "acescct",
    "logc3",
    "slog3",
    "slog3-cine",
    "vlog",
    "cineon",
]


# Same names as in bokehnet.io.depth.false_colors and bokehnet.io.depth.packed_depth, and as in
# bokehnet.optics.pixels.pixel_filter, which import NumPy: too slow for a help text.
CODINGS = (
    "grey",
    "turbo",
    "inferno",
    "magma",
    "plasma",
    "viridis",
    "jet",
    "Spectral_r",
    "rgb24",
    "bgr24",
    "rgba-fixed",
    "rgba-float",
)
FILTERS = ("box", "blackman-harris", "gaussian", "mitchell", "arnold", "blender", "cycles", "renderman")


def _names_filter(text: str) -> bool:
    """Return whether a text names a pixel filter or is ``auto``."""
    from bokehnet.optics.pixels.pixel_filter import parse_pixel_filter

    try:
        return text == "auto" or bool(parse_pixel_filter(text))
    except ParameterError:
        return False


def _focus_range(text: str) -> tuple[float, ...] | str:
    return "off" if text == "off" else parse_numbers(text)


def _is_unit(text: str) -> bool:
    """Return whether a text is a unit of depth, optionally scaled."""
    try:
        return bool(parse_depth_unit(text))
    except ParameterError:
        return False


def _pixel(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(","))


@dataclass(frozen=True, kw_only=True, slots=True)
class InputSettings(Group):
    """Files with the depth and the edges of the picture. Default: the depth map in a phone's photo.

    Examples:
        >>> InputSettings(depth="z.exr", channel="Z").channel
        'Z'
        >>> InputSettings(depth="z.exr", disparity="near.png")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: input.depth: expected one of `input.disparity` and ...
    """

    GROUP: ClassVar[str] = "input"
    TITLE: ClassVar[str] = "Depth sources"
    ONE_OF: ClassVar[tuple[str, ...]] = (
        "disparity",
        "depth",
        "layers",
        "defocus",
        "depth_model",
        "constant_disparity",
    )

    disparity: Path | None = setting(
        None,
        "Disparity map: bright is near, else --invert. Its values are normalised to 0..1, 1 being nearest.",
    )
    depth: Path | None = setting(
        None,
        "Depth map with metric depth: EXR in metres, or any file with --depth-unit. Default without any "
        "depth source: the depth map stored in the picture's file, as phones write it.",
    )
    layers: Path | None = setting(
        None,
        "EXR with several surfaces per pixel, those hidden by others included: written by `trace --layers`, "
        "or a deep EXR.",
    )
    defocus: Path | None = setting(
        None,
        "Defocus map, EXR: signed blur radius of each pixel in pixels, positive in front of focus.",
        flag="defocus-map",
    )
    depth_model: Path | None = setting(
        None,
        "Depth network that estimates the depth of the picture: an ONNX file, or a name listed by `bokehnet "
        "models`.",
        metavar="NAME|FILE.onnx",
    )
    depth_convention: str | None = setting(
        None,
        "With an ONNX file as --depth-model: input and output format of the network. Default: "
        "depth-anything-v2.",
        metavar="NAME|FILE.toml",
    )
    constant_disparity: float | None = setting(
        None,
        "Single disparity, 0..1, of the whole picture: every pixel is blurred equally.",
        low=0,
        high=1,
    )
    channel: str | None = setting(None, "Channel of the depth map in an EXR file. Default: Z.")
    matte: Path | None = setting(
        None,
        "Coverage of each pixel by the foreground, 0 to 1: alpha channel or grey values of an image. Used to "
        "separate foreground and background at edges.",
    )
    supersampled: int = setting(
        1,
        "Size of picture and map relative to the result, 2 or 4: each output pixel then has exact edge "
        "coverage. Default: 1.",
        metavar="2|4",
        expected="1, 2 or 4",
        accepts=lambda factor: factor in (1, 2, 4),
    )
    projection: Literal["flat", "equirect"] = setting(
        "flat",
        "Projection of the picture: flat (default), or equirect, a panorama of 360 x 180 degrees, whose blur "
        "crosses the seam and widens towards the poles.",
    )
    color_space: InputColorSpaceName = setting(
        "auto",
        "Colour space of the picture or video if its file does not name it, as of cameras and film scans: "
        f"{', '.join(get_args(InputColorSpaceName))}. Default: auto, what the file says.",
        flag="input-color-space",
        metavar="NAME",
    )
    stereo: Literal["side-by-side", "top-bottom"] | None = setting(
        None, "Layout of a stereo pair: side-by-side or top-bottom. Each eye is rendered alone."
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "depth_convention", "depth_model")
        if self.stereo is not None and self.projection != "flat":
            raise ParameterError(
                "input.stereo",
                expected="`input.projection` flat with it",
                shown="both",
                remedy="leave one out",
            )
        if self.channel is not None and not (self.disparity or self.depth or self.defocus):
            raise ParameterError(
                "input.channel",
                expected="`input.disparity`, `input.depth` or `input.defocus` for it to act on",
                got=self.channel,
                remedy="give one of them, or leave this out",
            )
        if self.layers is not None and (self.matte is not None or self.supersampled > 1):
            raise ParameterError(
                "input.layers",
                expected="neither `input.matte` nor `input.supersampled`, as layers contain all edges",
                shown="both",
                remedy="leave one out",
            )
        if self.matte is not None and self.supersampled > 1:
            raise ParameterError(
                "input.matte",
                expected="no `input.supersampled`, which has the same information",
                shown="both",
                remedy="leave one out",
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthSettings(Group):
    """Reading and repair of the depth map.

    Examples:
        >>> from bokehnet.settings.settings import RenderSettings
        >>> inches = DepthSettings(unit="in", repair="off")
        >>> RenderSettings(input=InputSettings(depth="z.exr"), depth=inches).depth.unit
        'in'
    """

    GROUP: ClassVar[str] = "depth"
    TITLE: ClassVar[str] = "Depth map reading and repair"

    unit: str | None = setting(
        None,
        "With --depth: unit, m (default for floats), cm, mm, in, ft or 1/m. A scale may come before it, as "
        "in 0.2mm or 1/256m.",
        flag="depth-unit",
        metavar="[SCALE]UNIT",
        expected=f"one of {', '.join(DEPTH_UNITS)}, optionally scaled, such as 0.2mm or 1/256m",
        accepts=_is_unit,
    )
    kind: Literal["planar", "ray", "zbuffer"] = setting(
        "planar",
        "With --depth: planar (default, distance along the optical axis), ray (distance from the camera; its "
        "focal length and sensor width are the field of view) or zbuffer (of a graphics card, with "
        "--depth-near and --depth-far).",
        flag="depth-kind",
    )
    near: float | None = setting(
        None,
        "With --depth: distance of the stored value 0, metres, for --depth-kind zbuffer or normalised depth. "
        "For a reversed z-buffer the far plane.",
        flag="depth-near",
        unit="m",
        above=0,
        infinite=True,
    )
    far: float | None = setting(
        None,
        "With --depth: distance of the stored value 1, metres; infinite for a z-buffer without a far plane.",
        flag="depth-far",
        unit="m",
        above=0,
        infinite=True,
    )
    coding: str = setting(
        "auto",
        "Coding of a map in colours: auto (default: grey, or the colour map that fits), "
        f"{', '.join(CODINGS)}.",
        flag="depth-coding",
        metavar="NAME",
        expected=f"one of auto, {', '.join(CODINGS)}",
        accepts=lambda name: name == "auto" or name in CODINGS,
    )
    no_data: float | None = setting(
        None,
        "Stored number of pixels without data. Default: NaN, and what depth cameras and stereo write: 0, "
        "negative numbers and the largest integer where they cannot be data.",
        flag="no-data",
        metavar="N",
    )
    holes: Literal["fill", "error"] | None = setting(
        None,
        "Pixels without data: fill them along the surfaces of the picture (default), or stop with an error "
        "(default for EXR).",
    )
    invert: bool = setting(False, "With --disparity: bright is far, as in a depth map of 0..1.")
    value_range: tuple[float, float] | None = setting(
        None,
        "With --disparity: stored values that map to 0 and 1. Default: lowest and highest value of the map; "
        "for sequences 0 and 1.",
        flag="disparity-range",
        metavar="A,B",
        parse=parse_numbers,
        expected="two different numbers such as 0.5,2",
        accepts=lambda ends: ends[0] != ends[1],
    )
    as_stored: bool = setting(
        False,
        "Use disparity as stored, 0 to 1, so that all maps of a sequence have one scale.",
        flag=None,
    )
    resize: bool = setting(False, "Resize the map to the size of the picture.", flag="resize-disparity")
    mixed: Mode = setting(
        "auto",
        "Repair edge pixels whose depth mixes two surfaces. auto (default): with --depth, if there are many.",
        flag="mixed-depth",
    )
    pixel_filter: str = setting(
        "auto",
        "Pixel filter of the renderer that made the picture: auto (default: from file metadata, else "
        "measured "
        f"at edges), {', '.join(FILTERS)}. A width in pixels may follow, as in gaussian:2.",
        metavar="NAME[:WIDTH]",
        expected=f"auto, or one of {', '.join(FILTERS)}, optionally with a width, such as gaussian:2",
        accepts=_names_filter,
    )
    repair: Mode = setting(
        "auto",
        "Align edges of the map with edges of the picture. auto (default): where they are misaligned.",
        flag="repair-disparity",
        aliases=("refine-disparity",),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusSettings(Group):
    """Focus: a disparity, a distance, a pixel, a range or a tilted plane. Default: file, else subject.

    Examples:
        >>> FocusSettings(range=(1.5, 3)).range  # metres, with metric depth
        (1.5, 3.0)
        >>> FocusSettings(value=0.4, at=(10, 20))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.at: expected one of `focus.value` and `focus.at`, got both; ...
    """

    GROUP: ClassVar[str] = "focus"
    TITLE: ClassVar[str] = "Focus"
    ONE_OF: ClassVar[tuple[str, ...]] = ("value", "distance", "at", "range", "plane")

    value: float | None = setting(
        None,
        "With --disparity: disparity in focus, 0 (farthest) to 1 (nearest).",
        flag="focus",
        low=0,
        high=1,
        expected="a relative disparity in 0..1",
    )
    distance: float | None = setting(
        None,
        "With --depth: distance in focus, metres.",
        flag="focus-distance",
        unit="m",
        expected="metres above 0",
        above=0,
        infinite=True,
    )
    at: Pixel | None = setting(
        None,
        "Pixel in focus, counted from the upper left corner, starting at 0,0.",
        flag="focus-at",
        metavar="X,Y",
        parse=_pixel,
        expected="two whole numbers X,Y of a pixel",
    )
    range: tuple[float, float] | Literal["off"] | None = setting(
        None,
        "Range in focus; blur grows beyond both ends. Metres with --depth, else disparities 0..1. Default "
        "without any focus: the surface of the subject; off focuses on its middle only.",
        flag="focus-range",
        metavar="NEAR,FAR|off",
        parse=_focus_range,
        low=0,
        infinite=True,
        expected="two numbers from 0 up, such as 0.5,2, or off",
    )
    plane: tuple[Pixel, Pixel, Pixel] | None = setting(
        None,
        "Tilt the plane of focus so that these three pixels are sharp.",
        flag="focus-plane",
        metavar="X1,Y1 X2,Y2 X3,Y3",
        parse=_pixel,
        parts=3,
        expected="two whole numbers X,Y of each of three pixels",
        allowed_in_preset=False,
    )
    tilt_x: float = setting(
        0.0,
        "Tilt of the plane of focus, degrees, -80 to 80: positive focuses nearer at the top, negative nearer "
        "at the bottom, like a lens tilted down. With --depth: tilt of the lens. With --disparity: 45 spans "
        "disparity 0 to 1 over the picture.",
        metavar="DEG",
        unit="degrees",
        low=-80,
        high=80,
        allowed_in_preset=True,
    )
    tilt_y: float = setting(
        0.0,
        "Tilt of the plane of focus, degrees, -80 to 80: positive focuses nearer at the right, negative "
        "nearer at the left.",
        metavar="DEG",
        unit="degrees",
        low=-80,
        high=80,
        allowed_in_preset=True,
    )

    def check(self) -> None:
        """See :class:`Group`."""
        if self.plane is not None and (self.tilt_x or self.tilt_y):
            raise ParameterError(
                "focus.plane",
                expected="three pixels, or `focus.tilt_x` and `focus.tilt_y`",
                shown="both",
                remedy="leave one out",
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraSettings(Group):
    """Blur strength: a blur radius in pixels, or the camera's data.

    Examples:
        >>> CameraSettings(focal_length=50, f_number=1.8, sensor_width=36).focal_length  # mm
        50.0
        >>> CameraSettings(f_number=0)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: camera.f_number: expected a number above 0, got 0
    """

    GROUP: ClassVar[str] = "camera"
    TITLE: ClassVar[str] = "Camera and blur strength"
    ONE_OF: ClassVar[tuple[str, ...]] = ("blur", "strength")

    blur: float | None = setting(
        None,
        "With --disparity: blur radius in pixels per unit of disparity, i.e. at the nearest point when the "
        "farthest is in focus.",
        unit="pixels",
        low=0,
    )
    strength: float | None = setting(
        None,
        "Blur strength, 0 to 100. The largest blur radius is about this percentage of 8 % of the longer "
        "side. Default: 50, i.e. 4 %.",
        low=0,
        high=100,
    )
    focal_length: float | None = setting(
        None,
        "With --depth: focal length, mm. With --disparity and --f-number: of a full-frame camera. Default: "
        "metadata of the picture's file, else 50 mm on full frame.",
        unit="mm",
        above=0,
    )
    f_number: float | None = setting(
        None,
        "F-number, such as 1.8. Default: metadata of the picture's file, else that of --strength. With "
        "--disparity: of a full-frame camera with the nearest point at 1 m and the farthest at infinity.",
        above=0,
    )
    sensor_width: float | None = setting(
        None,
        "With --depth: width of the sensor, mm. Default: metadata of the picture's file, else full frame.",
        unit="mm",
        above=0,
    )
