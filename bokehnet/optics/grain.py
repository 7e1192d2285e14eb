"""Sensor grain: the noise of counting light, and of reading the count.

A pixel with scene-linear light x has counted ``x N`` electrons on average, N those at white. Counting
scatters by the root of the count and reading by ``read_noise`` electrons, so that x gets noise of variance
``x / N + (read_noise / N)^2`` and keeps its mean. Noise hangs on the pixel's place in the picture, the seed
and the number of the frame, never on how the picture was cut to be computed.
"""

import math
from dataclasses import dataclass

import numpy as np

from bokehnet.checks import (
    Array,
    array_namespace,
    check_at_least,
    check_flag,
    check_number,
    check_range,
    check_whole,
    constant_like,
)
from bokehnet.errors import ParameterError
from bokehnet.kernels import njit

__all__ = ["Grain", "noise_kernel", "white_noise"]

# Of white: its square is still a number.
_MOST_NOISE = 1e15


@dataclass(frozen=True, kw_only=True, slots=True)
class Grain:
    """Noise of a sensor; see the module. It cannot be undone.

    Attributes:
        iso: Sensitivity: white is ``full_well * 100 / iso`` electrons. Above 0.
        size: Distance in pixels over which noise is alike: two pixels at distance d correlate by
            ``exp(-(d / size)^2)``, below 2 pixels a little less; 0 to 50. The variance of a pixel does not
            depend on it.
        monochrome: Whether red, green and blue share one noise, as in black-and-white film; each still has
            the variance of its own light.
        seed: From 0 up; another one gives another noise.
        full_well: Electrons at white and ISO 100.
        read_noise: Electrons, at least 0.1.

    Raises:
        ParameterError: A number is out of range.
    """

    iso: float
    size: float = 1.0
    monochrome: bool = False
    seed: int = 0
    full_well: float = 50000.0
    read_noise: float = 3.0

    def __post_init__(self) -> None:
        for name in ("iso", "full_well"):
            value = getattr(self, name)
            check_number(name, value)
            if value <= 0:
                raise ParameterError(name, "above 0", value)
        check_range("size", self.size, 0, 50, "pixels")
        check_flag("monochrome", self.monochrome)
        check_at_least("seed", self.seed, 0)
        check_whole("seed", self.seed)
        check_at_least("read_noise", self.read_noise, 0.1)
        if self.read_noise * (self.iso / self.full_well) > _MOST_NOISE:
            expected = "noise that is small enough to be a number: read_noise * iso / full_well of at most"
            raise ParameterError("iso", f"{expected} {_MOST_NOISE:g}", self.iso)

    @property
    def white(self) -> float:
        """Electrons at white."""
        return self.full_well * 100 / self.iso

    def variance(self, light: Array, coverage: Array = 1.0) -> Array:
        """Variance of the noise of scene-linear light, any shape; light below 0 counts as 0.

        Where coverage (alpha) is below 1, reading takes part by it: an empty place stays empty, and layers
        laid over each other are read once.
        """
        xp = array_namespace(light)
        return xp.clip(light, 0, None) / self.white + (coverage * (self.read_noise / self.white)) ** 2

    def noise(
        self, height: int, width: int, channels: int, *, left: int = 0, top: int = 0, frame: int = 0
    ) -> np.ndarray:
        """Noise of mean 0 and variance 1, (height, width, channels), float32.

        Args:
            height: Rows.
            width: Columns.
            channels: How many; all alike where ``monochrome``.
            left: Column of the first pixel in the picture.
            top: Row of the first pixel in the picture.
            frame: Number of the frame.
        """
        kernel = noise_kernel(self.size)
        reach = len(kernel) // 2
        found = []
        for channel in range(1 if self.monochrome else channels):
            white = white_noise(
                height + 2 * reach,
                width + 2 * reach,
                left=left - reach,
                top=top - reach,
                key=(self.seed, frame, channel),
            )
            rows = sum(kernel[i] * white[i : i + height] for i in range(len(kernel)))
            found.append(sum(kernel[i] * rows[:, i : i + width] for i in range(len(kernel))))
        return np.stack(found * (channels if self.monochrome else 1), -1)

    def add(
        self, image: Array, coverage: Array = 1.0, *, left: int = 0, top: int = 0, frame: int = 0
    ) -> Array:
        """Return ``image`` with grain; values may fall below 0, or the mean would rise.

        Args:
            image: Scene-linear, (..., H, W, C), array or tensor. Differentiable. All of a batch get the same
                noise: give each its own ``frame``.
            coverage: Alpha, (..., H, W, 1), of premultiplied light.
            left: Column of its first pixel in the picture that the noise belongs to.
            top: Row of its first pixel there.
            frame: Number of the frame; another one gives another noise.
        """
        height, width, channels = image.shape[-3:]
        noise = self.noise(height, width, channels, left=left, top=top, frame=frame)
        xp, variance = array_namespace(image), self.variance(image, coverage)
        there = variance > 0  # else the root has no finite slope
        deviation = xp.where(there, xp.where(there, variance, 1.0) ** 0.5, 0.0)
        return image + deviation * constant_like(noise, image)


def noise_kernel(size: float) -> np.ndarray:
    """Weights of white noise, (2 r + 1,), float32, whose squares sum to 1: a Gaussian.

    The Gaussian of standard deviation s gives sums that correlate by ``exp(-d^2 / (4 s^2))`` at distance d:
    s is half of ``size``. Sums over whole pixels keep to this from a size of 2 on; smaller grain correlates
    less, at size 1 by 0.26 with its neighbour in place of 0.37.
    """
    deviation = size / 2
    reach = math.ceil(5 * deviation) + 1 if size > 0 else 0
    k = np.arange(-reach, reach + 1)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        weights = np.exp(-0.5 * np.where(k == 0, 0.0, k / deviation) ** 2) if size > 0 else np.ones(1)
    return (weights / math.sqrt((weights**2).sum())).astype(np.float32)


def white_noise(
    height: int, width: int, *, left: int = 0, top: int = 0, key: tuple[int, int, int] = (0, 0, 0)
) -> np.ndarray:
    """Normal noise of variance 1 without correlation, (height, width), float32.

    Args:
        height: Rows.
        width: Columns.
        left: Column of the first pixel; each pixel has its own hash, wherever the picture is cut.
        top: Row of the first pixel.
        key: Seed, frame and channel.
    """
    result = np.empty((height, width), np.float32)
    seed, frame, channel = (number & 0xFFFFFFFFFFFFFFFF for number in key)
    _fill(left, top, np.uint64(seed), np.uint64(frame), np.uint64(channel), result)
    return result


@njit(cache=True)
def _mix(z):  # type: ignore[no-untyped-def]
    """A hash of 64 bits: the finaliser of Steele, Lea and Flood, "Fast splittable random numbers", 2014."""
    z += np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ z >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ z >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return z ^ z >> np.uint64(31)


@njit(cache=True, nogil=True)
def _fill(left, top, seed, frame, channel, result):  # type: ignore[no-untyped-def]
    """By Box and Muller, "A note on the generation of random normal deviates", 1958."""
    key = _mix(_mix(_mix(seed) ^ frame) ^ channel)
    unit = 2.0**-53
    for i in range(result.shape[0]):
        row = _mix(key ^ np.uint64(np.int64(top + i)))
        for j in range(result.shape[1]):
            first = _mix(row ^ np.uint64(np.int64(left + j)))
            second = _mix(first)
            u = (np.float64(first >> np.uint64(11)) + 0.5) * unit
            v = np.float64(second >> np.uint64(11)) * unit
            result[i, j] = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)
