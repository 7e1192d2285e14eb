"""Input and output format of monocular depth networks, defined by small TOML files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from bokehnet.arrays.resample import Kernel, resample
from bokehnet.config import load_config
from bokehnet.errors import ConfigError
from bokehnet.io.color.srgb import linear_to_srgb

__all__ = ["DepthConvention", "convention_names", "find_convention"]

_FOLDER = Path(__file__).parent / "depth_conventions"

_MAX_SIDE_PX = 8192


@dataclass(frozen=True, kw_only=True)
class DepthConvention:
    """Input and output format of a network.

    Attributes:
        size: Size of a side in pixels, for networks with a dynamic input size.
        fit: Side with that size: the shorter, the longer, or both ("stretch").
        multiple_of: Divisor of both sides after rounding.
        kernel: Resampling kernel for the picture.
        channels: Order of the channels.
        layout: Layout of the input array.
        white: Value of white before subtracting the mean.
        mean: Mean to subtract from the sRGB values, for red, green, blue.
        std: Divisor after subtracting the mean.
        output: Inverse depth (near is large) or depth.
        unit: Unit of the output; "none" if known only up to scale and shift.
        map: Name of the output with the map; empty for the first output.
        component: Index of the depth among three coordinates, if the output is a point map; None for a depth
            map.
        shift: "unknown" if points are known only up to a shift along the axis, which is then estimated.
        scale: Name of the output with a factor on the depth; empty for none.
        mask: Name of the output that is above 0.5 on surfaces; everything else is infinitely far.
        tokens: Value of the additional input ``num_tokens`` of networks that set their resolution by it.
    """

    size: int
    fit: Literal["shorter", "longer", "stretch"] = "shorter"
    multiple_of: int = 1
    kernel: Kernel = "cubic"
    channels: Literal["RGB", "BGR"] = "RGB"
    layout: Literal["NCHW", "NHWC"] = "NCHW"
    white: float = 1.0
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    std: tuple[float, float, float] = (1.0, 1.0, 1.0)
    output: Literal["disparity", "depth"]
    unit: Literal["none", "m", "mm"] = "none"
    map: str = ""
    component: Literal[0, 1, 2] | None = None
    shift: Literal["known", "unknown"] = "known"
    scale: str = ""
    mask: str = ""
    tokens: int | None = None

    def input_size(self, height: int, width: int, fixed: tuple[int | None, int | None]) -> tuple[int, int]:
        """Return the height and width of the network's input.

        Args:
            height: Height of the picture, pixels.
            width: Width of the picture, pixels.
            fixed: Fixed height and width of the network's input; None where they are dynamic.
        """
        side = {"shorter": min(height, width), "longer": max(height, width)}.get(self.fit)
        sizes = []
        for own, required in zip((height, width), fixed, strict=True):
            scaled = self.size if side is None else own * self.size / side
            rounded = max(1, round(scaled / self.multiple_of)) * self.multiple_of
            sizes.append(min(rounded, _MAX_SIDE_PX // self.multiple_of * self.multiple_of))
            if required is not None:
                sizes[-1] = required
        return sizes[0], sizes[1]

    def prepare(self, image: np.ndarray, height: int, width: int) -> np.ndarray:
        """Return a picture as input of the network, a batch of one, float32.

        Args:
            image: Picture, scene-linear, (H, W, 3); light above 1 is clipped, as in photos.
            height: Height of the input, pixels.
            width: Width of the input, pixels.
        """
        srgb = linear_to_srgb(np.clip(np.asarray(image, np.float32), 0, 1))
        values = resample(srgb, height, width, self.kernel)
        values = (values * self.white - np.array(self.mean)) / np.array(self.std)
        if self.channels == "BGR":
            values = values[..., ::-1]
        if self.layout == "NCHW":
            values = values.transpose(2, 0, 1)
        return np.ascontiguousarray(values[None], np.float32)


def convention_names() -> list[str]:
    """Return the names of the shipped conventions in alphabetical order."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def find_convention(name: str | Path) -> DepthConvention:
    """Read a convention by its name, or from a TOML file with the attributes of :class:`DepthConvention`.

    Raises:
        ConfigError: There is no such convention, or the file is missing or invalid.
    """
    if str(name) in convention_names():
        path = _FOLDER / f"{name}.toml"
    elif Path(name).suffix == ".toml":
        path = Path(name)
    else:
        known = ", ".join(convention_names())
        raise ConfigError(f"unknown convention {str(name)!r}: expected a .toml file or one of {known}")
    convention = load_config(path, DepthConvention)
    for key, value, maximum in (
        ("size", convention.size, _MAX_SIDE_PX),
        ("multiple_of", convention.multiple_of, 1024),
    ):
        if not 1 <= value <= maximum:
            raise ConfigError(f"{path}: {key}: expected 1 to {maximum}, found {value}")
    if convention.shift == "unknown" and convention.component is None:
        raise ConfigError(f"{path}: shift: expected component with it, as only point maps have a shift")
    if convention.mask and convention.output != "depth":
        raise ConfigError(f"{path}: mask: expected depth as output, found {convention.output}")
    numbers = (convention.white, *convention.mean, *convention.std)
    if not all(np.isfinite(numbers)) or 0 in convention.std:
        raise ConfigError(f"{path}: white, mean, std: expected finite numbers, and std not 0")
    return convention
