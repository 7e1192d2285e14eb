"""Settings of the scene: where its depth comes from, what stays sharp, how strong the blur is."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

from bokehnet.engine_registry import ENGINES
from bokehnet.errors import ParameterError
from bokehnet.settings.fields import Group, check_needed, parse_bytes, parse_numbers, setting

__all__ = [
    "CameraSettings",
    "DepthSettings",
    "DeviceName",
    "EngineName",
    "EngineSettings",
    "FocusSettings",
    "InputSettings",
    "OutputSettings",
]

EngineName = Literal["rays", "scatter", "hybrid", "neural", "fast"]
DeviceName = Literal["cpu", "cuda", "auto"]
Mode = Literal["auto", "on", "off"]
Switch = Literal["on", "off"]
Pixel = tuple[int, int]

# As bokehnet.io.output_format has them.
ColorSpaceName = Literal["keep", "srgb", "display-p3", "adobe-rgb", "prophoto", "rec2020"]
BitsName = Literal["8", "10", "16", "half", "float"]
SubsamplingName = Literal["4:4:4", "4:2:2", "4:2:0"]

# As bokehnet.optics.pixels.pixel_filter has them; that one loads NumPy, which help does without.
FILTERS = ("box", "blackman-harris", "gaussian", "mitchell", "arnold", "blender", "cycles", "renderman")


assert set(get_args(EngineName)) == set(ENGINES)


def _moved_engine(name: Any) -> str:
    """Return where a method of the literature went, which earlier versions offered as an engine."""
    from bokehnet.baselines.registry import BASELINES  # loads NumPy, which help does without

    if not isinstance(name, str) or name not in BASELINES:
        return ""
    return f"{name} is a method of the literature: `bokehnet compare --engines rays,{name}` runs it"


def _names_filter(text: str) -> bool:
    """Whether it is a pixel filter, or ``auto``."""
    from bokehnet.optics.pixels.pixel_filter import parse_pixel_filter

    try:
        return text == "auto" or bool(parse_pixel_filter(text))
    except ParameterError:
        return False


def _pixel(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(","))


@dataclass(frozen=True, kw_only=True, slots=True)
class InputSettings(Group):
    """Files beside the picture that tell its depth and its edges; without depth, what a phone's photo holds.

    Examples:
        >>> InputSettings(depth="z.exr", channel="Z").channel
        'Z'
        >>> InputSettings(depth="z.exr", disparity="near.png")
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: input.depth: expected one of `input.disparity` and ...
    """

    GROUP: ClassVar[str] = "input"
    TITLE: ClassVar[str] = "Depth of the picture"
    ONE_OF: ClassVar[tuple[str, ...]] = (
        "disparity",
        "depth",
        "layers",
        "defocus",
        "depth_model",
        "constant_disparity",
    )

    disparity: Path | None = setting(None, "Disparity map, near is bright; normalised to 0..1.")
    depth: Path | None = setting(
        None, "EXR with metric depth. Without any of these: the map that a phone's photo holds."
    )
    layers: Path | None = setting(
        None, "EXR with what stands behind things: that of `trace --layers`, or a deep one."
    )
    defocus: Path | None = setting(
        None,
        "Defocus map, EXR: signed blur radius of each pixel, above 0 in front of focus.",
        flag="defocus-map",
    )
    depth_model: Path | None = setting(
        None,
        "Network that guesses the depth of the picture: a file, or a name that bokehnet models lists.",
        metavar="NAME|FILE.onnx",
    )
    depth_convention: str | None = setting(
        None,
        "With a file as --depth-model: what the network sees and returns; default depth-anything-v2.",
        metavar="NAME|FILE.toml",
    )
    constant_disparity: float | None = setting(
        None, "One disparity for the whole picture, 0..1: all is equally blurred.", low=0, high=1
    )
    channel: str | None = setting(None, "Channel of the map in its EXR; default: Z.")
    matte: Path | None = setting(
        None, "How much of each pixel a foreground covers: alpha or grey, 0 to 1; its edges are parted so."
    )
    supersampled: int = setting(
        1,
        "Picture and map are 2 or 4 times the size of the result: edges inside its pixels are known.",
        metavar="2|4",
        expected="1, 2 or 4",
        accepts=lambda factor: factor in (1, 2, 4),
    )

    def check(self) -> None:
        """See :class:`Group`."""
        check_needed(self, "depth_convention", "depth_model")
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
                expected="none beside `input.matte` and `input.supersampled`, as they tell all edges",
                shown="both",
                remedy="leave one out",
            )
        if self.matte is not None and self.supersampled > 1:
            raise ParameterError(
                "input.matte",
                expected="none beside `input.supersampled`, which tells as much",
                shown="both",
                remedy="leave one out",
            )


@dataclass(frozen=True, kw_only=True, slots=True)
class DepthSettings(Group):
    """How the map of the scene is read, and what is mended in it.

    Examples:
        >>> from bokehnet.settings.settings import RenderSettings
        >>> inches = DepthSettings(unit="in", repair="off")
        >>> RenderSettings(input=InputSettings(depth="z.exr"), depth=inches).depth.unit
        'in'
    """

    GROUP: ClassVar[str] = "depth"
    TITLE: ClassVar[str] = "Reading and repairing the map"

    unit: Literal["m", "cm", "mm", "in", "ft", "1/m"] | None = setting(
        None, "With --depth: m (default), cm, mm, in, ft or 1/m.", flag="depth-unit", metavar="UNIT"
    )
    invert: bool = setting(False, "With --disparity: far is bright, as in 0..1 depth.")
    value_range: tuple[float, float] | None = setting(
        None,
        "With --disparity: values that count as 0 and 1; default: the lowest and the highest, "
        "of a sequence 0 and 1.",
        flag="disparity-range",
        metavar="A,B",
        parse=parse_numbers,
        expected="two different numbers such as 0.5,2",
        accepts=lambda ends: ends[0] != ends[1],
    )
    as_stored: bool = setting(
        False,
        "Disparity is taken as it is stored, 0 to 1: one map of a sequence is treated as the others.",
        flag=None,
    )
    resize: bool = setting(False, "Bring a map of another size to the picture's.", flag="resize-disparity")
    mixed: Mode = setting(
        "auto",
        "Mend values between two surfaces at edges; auto: in --depth, where there are many.",
        flag="mixed-depth",
    )
    pixel_filter: str = setting(
        "auto",
        "How pixels at edges mix both sides: auto (default) by the picture's file, else by its edges; "
        f"{', '.join(FILTERS)}; with a width in pixels, as gaussian:2.",
        metavar="NAME[:WIDTH]",
        expected=f"auto, or one of {', '.join(FILTERS)}, if need be with a width, as gaussian:2",
        accepts=_names_filter,
    )
    repair: Mode = setting(
        "auto",
        "Move the map's edges to the picture's; auto: where they are out of place.",
        flag="repair-disparity",
        aliases=("refine-disparity",),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FocusSettings(Group):
    """What stays sharp.

    Examples:
        >>> FocusSettings(range=(1.5, 3)).range  # metres, with metric depth
        (1.5, 3.0)
        >>> FocusSettings(value=0.4, at=(10, 20))
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: focus.at: expected one of `focus.value` and `focus.at`, got both; ...
    """

    GROUP: ClassVar[str] = "focus"
    TITLE: ClassVar[str] = "Focus, or what stays sharp"
    ONE_OF: ClassVar[tuple[str, ...]] = ("value", "distance", "at", "range", "plane")

    value: float | None = setting(
        None,
        "With --disparity: the relative disparity that stays sharp, 0..1.",
        flag="focus",
        low=0,
        high=1,
        expected="a relative disparity in 0..1",
    )
    distance: float | None = setting(
        None,
        "With --depth: what stays sharp, metres.",
        flag="focus-distance",
        unit="m",
        expected="metres above 0",
        above=0,
        infinite=True,
    )
    at: Pixel | None = setting(
        None,
        "Focus on this pixel, from the upper left.",
        flag="focus-at",
        metavar="X,Y",
        parse=_pixel,
        expected="two whole numbers X,Y of a pixel",
    )
    range: tuple[float, float] | None = setting(
        None,
        "All between stays sharp, blur grows from both ends; metres with --depth, else 0..1.",
        flag="focus-range",
        metavar="NEAR,FAR",
        parse=parse_numbers,
        low=0,
        infinite=True,
        expected="two numbers from 0 up, such as 0.5,2",
    )
    plane: tuple[Pixel, Pixel, Pixel] | None = setting(
        None,
        "Lean the plane of focus through what these three pixels show.",
        flag="focus-plane",
        metavar="X1,Y1 X2,Y2 X3,Y3",
        parse=_pixel,
        parts=3,
        expected="two whole numbers X,Y of each of three pixels",
        of_a_look=False,
    )
    tilt_x: float = setting(
        0.0,
        "Lean the plane of focus: above 0 the upper side focuses nearer, below 0 the lower side, as a "
        "lens tilted down. With --depth the lens's tilt; with --disparity 45 leads from far to near.",
        metavar="DEG",
        unit="degrees",
        low=-80,
        high=80,
        of_a_look=True,
    )
    tilt_y: float = setting(
        0.0,
        "Likewise: above 0 the right focuses nearer, below 0 the left.",
        metavar="DEG",
        unit="degrees",
        low=-80,
        high=80,
        of_a_look=True,
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
    """How strongly the rest is blurred.

    Examples:
        >>> CameraSettings(focal_length=50, f_number=1.8, sensor_width=36).focal_length  # mm
        50.0
        >>> CameraSettings(f_number=0)
        Traceback (most recent call last):
            ...
        bokehnet.errors.ParameterError: camera.f_number: expected a number above 0, got 0
    """

    GROUP: ClassVar[str] = "camera"
    TITLE: ClassVar[str] = "Camera, or how strong the blur is"

    blur: float | None = setting(
        None, "With --disparity: blur radius in pixels per unit of disparity.", unit="pixels", low=0
    )
    focal_length: float | None = setting(
        None,
        "With --depth, mm. These three: default, what the picture's file says.",
        unit="mm",
        above=0,
    )
    f_number: float | None = setting(None, "With --depth or a phone's photo.", above=0)
    sensor_width: float | None = setting(None, "With --depth, mm.", unit="mm", above=0)


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineSettings(Group):
    """What renders.

    Examples:
        >>> from bokehnet.settings.settings import RenderSettings
        >>> settings = RenderSettings().updated({"engine": {"name": "scatter", "max_memory": "2G"}})
        >>> settings.engine.max_memory  # bytes
        2147483648
    """

    GROUP: ClassVar[str] = "engine"
    TITLE: ClassVar[str] = "Engine"

    name: EngineName | None = setting(
        None,
        f"One of {', '.join(f'{spec.name} ({spec.about})' for spec in ENGINES.values())}.",
        advice=_moved_engine,
        flag="engine",
        metavar="NAME",
        of_a_look=True,
    )
    weights: Path | None = setting(None, "Folder with other networks.")
    device: DeviceName = setting(
        "cpu",
        "What computes: cpu (the default), cuda (a graphics card), or auto: that where it can.",
    )
    max_memory: int | None = setting(
        None,
        "Memory for all, pictures included, such as 4G; what does not fit is rendered in strips.",
        metavar="SIZE",
        unit="bytes",
        parse=parse_bytes,
        low=0,
        expected="a size such as 500M or 2G",
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputSettings(Group):
    """How the picture is written, and what besides it.

    Examples:
        >>> OutputSettings(save_maps="maps").save_maps / "defocus.exr" == Path("maps/defocus.exr")
        True
    """

    GROUP: ClassVar[str] = "output"
    TITLE: ClassVar[str] = "Output"

    color_space: ColorSpaceName = setting(
        "keep",
        "Colours of the result; keep (the default): those of the picture's file, with its profile.",
    )
    bits: BitsName | None = setting(
        None,
        "8, 10, 16, half or float for each channel, as the format can; default: as the picture's file.",
    )
    quality: int = setting(
        97,
        "Of JPEG, WebP, JPEG XL, AVIF and HEIC, 1 to 100; default 97. WebP of 100 is without loss.",
        low=1,
        high=100,
    )
    subsampling: SubsamplingName = setting(
        "4:4:4", "Of the colours of JPEG, AVIF and HEIC: 4:4:4 (full, the default), 4:2:2 or 4:2:0."
    )
    dither: Switch = setting(
        "on", "on (default) or off: rounding to 8 bits spreads its error, so that slopes show no bands."
    )
    save_maps: Path | None = setting(
        None,
        "Folder for the settings, and as pictures: defocus, error map, classical, neural, mixed pixels, "
        "expected error.",
    )
    expected_error: Switch | None = setting(
        None,
        "on or off: tell how far off each pixel of the rays may be, in 8-bit levels; default: on with "
        "--save-maps, where lens and gamma are plain.",
    )
