"""What a monocular depth network wants to see and what it gives back: a small TOML file."""

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

_LARGEST_SIDE = 8192  # pixels


@dataclass(frozen=True, kw_only=True)
class DepthConvention:
    """Input and output of a network.

    Attributes:
        size: Pixels of a side, where the network leaves its size open; else the network's counts.
        fit: Which side has that size: the shorter, the longer, or both ("stretch").
        multiple_of: Both sides are rounded to a multiple of this.
        kernel: How the picture is resized.
        channels: Their order.
        layout: Of the input array.
        white: Value of white before mean and deviation.
        mean: Subtracted from the sRGB values, for red, green, blue.
        std: Divided by afterwards.
        output: Inverse depth (near is large) or depth.
        unit: Of the output; "none" for one that is known up to scale and shift.
        map: Name of the output that holds the map; empty for the first.
        component: Which of three coordinates is the depth, where that output is a map of points; None where
            it is a map of numbers.
        shift: "unknown" where points are known up to a shift along the axis, which is then found.
        scale: Name of the output that holds what depth is multiplied by; empty for none.
        mask: Name of the output that is above 0.5 where there is a surface; all else is infinitely far.
        tokens: Value of the further input ``num_tokens`` of networks that take their resolution so.
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
        """Return the height and width that the network sees.

        Args:
            height: Of the picture, pixels.
            width: Of the picture, pixels.
            fixed: Height and width that the network fixes; None where it leaves them open.
        """
        side = {"shorter": min(height, width), "longer": max(height, width)}.get(self.fit)
        sizes = []
        for own, wanted in zip((height, width), fixed, strict=True):
            scaled = self.size if side is None else own * self.size / side
            rounded = max(1, round(scaled / self.multiple_of)) * self.multiple_of
            sizes.append(min(rounded, _LARGEST_SIDE // self.multiple_of * self.multiple_of))
            if wanted is not None:
                sizes[-1] = wanted
        return sizes[0], sizes[1]

    def prepare(self, image: np.ndarray, height: int, width: int) -> np.ndarray:
        """Return a picture as the network wants it, a batch of one, float32.

        Args:
            image: Scene-linear, (H, W, 3); light above 1 is clipped, as in photographs.
            height: Of the input, pixels.
            width: Of the input, pixels.
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
    """Names of the conventions that come with the package, in alphabetical order."""
    return sorted(path.stem for path in _FOLDER.glob("*.toml"))


def find_convention(name: str | Path) -> DepthConvention:
    """Read a convention by its name, or from a TOML file with the attributes of :class:`DepthConvention`.

    Raises:
        ConfigError: There is no such convention, or the file is missing or wrong.
    """
    if str(name) in convention_names():
        path = _FOLDER / f"{name}.toml"
    elif Path(name).suffix == ".toml":
        path = Path(name)
    else:
        known = ", ".join(convention_names())
        raise ConfigError(f"unknown convention {str(name)!r}: expected a .toml file or one of {known}")
    convention = load_config(path, DepthConvention)
    for key, value, most in (
        ("size", convention.size, _LARGEST_SIDE),
        ("multiple_of", convention.multiple_of, 1024),
    ):
        if not 1 <= value <= most:
            raise ConfigError(f"{path}: {key}: expected 1 to {most}, found {value}")
    if convention.shift == "unknown" and convention.component is None:
        raise ConfigError(f"{path}: shift: expected component beside it, since only points tell their shift")
    if convention.mask and convention.output != "depth":
        raise ConfigError(f"{path}: mask: expected depth as output, found {convention.output}")
    numbers = (convention.white, *convention.mean, *convention.std)
    if not all(np.isfinite(numbers)) or 0 in convention.std:
        raise ConfigError(f"{path}: white, mean, std: expected finite numbers, and std not 0")
    return convention
