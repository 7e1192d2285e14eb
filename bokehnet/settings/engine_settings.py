"""Settings of the engine and of the output."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

from bokehnet.engine_registry import ENGINES
from bokehnet.settings.fields import Group, parse_bytes, setting
from bokehnet.settings.scene_settings import Switch

__all__ = ["DeviceName", "EngineName", "EngineSettings", "OutputSettings"]

EngineName = Literal["rays", "scatter", "hybrid", "neural", "fast"]
DeviceName = Literal["cpu", "cuda", "auto"]

# Same names as in bokehnet.io.formats.output_format.
ColorSpaceName = Literal["keep", "srgb", "display-p3", "adobe-rgb", "prophoto", "rec2020"]

BitsName = Literal["8", "10", "16", "half", "float"]
SubsamplingName = Literal["4:4:4", "4:2:2", "4:2:0"]

assert set(get_args(EngineName)) == set(ENGINES)


def _moved_engine(name: Any) -> str:
    """Return a hint for a method of the literature that earlier versions offered as an engine."""
    from bokehnet.baselines.registry import BASELINES

    if not isinstance(name, str) or name not in BASELINES:
        return ""
    return f"{name} is a method of the literature: `bokehnet compare --engines rays,{name}` runs it"


@dataclass(frozen=True, kw_only=True, slots=True)
class EngineSettings(Group):
    """Engine, networks, device and memory bound.

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
        allowed_in_preset=True,
    )
    weights: Path | None = setting(None, "Folder with networks to use in place of the shipped ones.")
    device: DeviceName = setting(
        "cpu",
        "Device that renders: cpu (default), cuda (an NVIDIA graphics card), or auto (cuda where possible).",
    )
    max_memory: int | None = setting(
        None,
        "Upper bound of the memory, pictures included, such as 4G. Larger pictures are rendered in strips.",
        metavar="SIZE",
        unit="bytes",
        parse=parse_bytes,
        low=0,
        expected="a size such as 500M or 2G",
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputSettings(Group):
    """File format of the result, and additional outputs.

    Examples:
        >>> OutputSettings(save_maps="maps").save_maps / "defocus.exr" == Path("maps/defocus.exr")
        True
    """

    GROUP: ClassVar[str] = "output"
    TITLE: ClassVar[str] = "Output"

    color_space: ColorSpaceName = setting(
        "keep",
        "Colour space of the result. keep (default): that of the picture's file, including its profile.",
    )
    bits: BitsName | None = setting(
        None,
        "Bits per channel: 8, 10, 16, half or float, if the format allows it. Default: as in the picture's "
        "file.",
    )
    quality: int = setting(
        97,
        "Quality of JPEG, WebP, JPEG XL, AVIF and HEIC, 1 to 100. Default: 97. WebP at 100 is lossless.",
        low=1,
        high=100,
    )
    subsampling: SubsamplingName = setting(
        "4:4:4", "Chroma subsampling of JPEG, AVIF and HEIC: 4:4:4 (none, default), 4:2:2 or 4:2:0."
    )
    dither: Switch = setting(
        "on", "Dithering when rounding to 8 bits, which avoids banding in gradients: on (default) or off."
    )
    shoulder: Switch = setting(
        "off",
        "Soft shoulder for light above white in files of 8 to 16 bits: on compresses it to its square root, "
        "so that discs of lamps keep colour; off (default) clips each channel, as cameras do.",
    )
    save_maps: Path | None = setting(
        None,
        "Folder for intermediate results: the settings, and images of the defocus, error map, classical and "
        "neural render, mixed pixels and expected error.",
    )
    expected_error: Switch | None = setting(
        None,
        "Error estimate per pixel, in 8-bit levels, with engine rays or hybrid: on or off. Default: on with "
        "--save-maps, unless a lens, an aberration or a gamma is set.",
    )
