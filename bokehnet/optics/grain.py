"""Sensor grain: shot noise and read noise.

A pixel with scene-linear light x counts ``x N`` electrons on average, N being the count at white. Counting
has the variance of its mean and reading adds a deviation of ``read_noise`` electrons, so that x gets noise of
variance ``x / N + (read_noise / N)^2`` and keeps its mean. Noise depends on the position of the pixel in the
picture, the seed and the number of the frame, never on how the picture is divided for rendering.
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

# Read noise as a fraction of white, such that its square does not overflow float32.
_MAX_READ_NOISE = 1e15


@dataclass(frozen=True, kw_only=True, slots=True)
class Grain:
    """Noise of a sensor; see the module. It cannot be removed again.

    Attributes:
        iso: Sensitivity, above 0: white is ``full_well * 100 / iso`` electrons.
        size: Correlation length of the noise in pixels, 0 to 50: two pixels at distance d correlate by
            ``exp(-(d / size)^2)``, slightly less for sizes below 2. The variance of a pixel does not
            depend on it.
        monochrome: True if red, green and blue share one noise pattern, as in black-and-white film; each
            still has the variance of its own light.
        seed: Seed of the noise, >= 0.
        full_well: Electrons at white and ISO 100.
        read_noise: Standard deviation of reading, electrons, at least 0.1.

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
        if self.read_noise * (self.iso / self.full_well) > _MAX_READ_NOISE:
            expected = "noise that is small enough to be a number: read_noise * iso / full_well of at most"
            raise ParameterError("iso", f"{expected} {_MAX_READ_NOISE:g}", self.iso)

    @property
    def white(self) -> float:
        """Number of electrons at white."""
        return self.full_well * 100 / self.iso

    def variance(self, light: Array, coverage: Array = 1.0) -> Array:
        """Return the variance of the noise of scene-linear light, any shape; clips light below 0.

        Coverage (alpha) below 1 scales the read noise: an empty pixel stays empty, and composited layers
        are read once.
        """
        xp = array_namespace(light)
        return xp.clip(light, 0, None) / self.white + (coverage * (self.read_noise / self.white)) ** 2

    def noise(
        self, height: int, width: int, channels: int, *, left: int = 0, top: int = 0, frame: int = 0
    ) -> np.ndarray:
        """Return noise of mean 0 and variance 1, (height, width, channels), float32.

        Args:
            height: Number of rows.
            width: Number of columns.
            channels: Number of channels; all are equal if ``monochrome``.
            left: Column of the first pixel in the picture.
            top: Row of the first pixel in the picture.
            frame: Number of the frame.
        """
        kernel = noise_kernel(self.size)
        reach = len(kernel) // 2
        planes = []
        for channel in range(1 if self.monochrome else channels):
            white = white_noise(
                height + 2 * reach,
                width + 2 * reach,
                left=left - reach,
                top=top - reach,
                key=(self.seed, frame, channel),
            )
            rows = sum(kernel[i] * white[i : i + height] for i in range(len(kernel)))
            planes.append(sum(kernel[i] * rows[:, i : i + width] for i in range(len(kernel))))
        return np.stack(planes * (channels if self.monochrome else 1), -1)

    def add(
        self, image: Array, coverage: Array = 1.0, *, left: int = 0, top: int = 0, frame: int = 0
    ) -> Array:
        """Return ``image`` with grain; values may be below 0, since clipping would raise the mean.

        Args:
            image: Scene-linear, (..., H, W, C), array or tensor. Differentiable. All images of a batch get
                the same noise: pass each with its own ``frame`` to avoid that.
            coverage: Alpha of premultiplied light, (..., H, W, 1).
            left: Column of the first pixel of ``image`` in the picture.
            top: Row of the first pixel of ``image`` in the picture.
            frame: Number of the frame; each frame has its own noise.
        """
        height, width, channels = image.shape[-3:]
        noise = self.noise(height, width, channels, left=left, top=top, frame=frame)
        xp, variance = array_namespace(image), self.variance(image, coverage)
        positive = variance > 0  # the square root has no finite slope at 0
        deviation = xp.where(positive, xp.where(positive, variance, 1.0) ** 0.5, 0.0)
        return image + deviation * constant_like(noise, image)


def noise_kernel(size: float) -> np.ndarray:
    """Return Gaussian weights of white noise whose squares sum to 1, (2 r + 1,), float32.

    A Gaussian of standard deviation s gives sums that correlate by ``exp(-d^2 / (4 s^2))`` at distance d, so
    s is half of ``size``. Sums over whole pixels follow this for sizes from 2 pixels; smaller grain
    correlates less, at size 1 by 0.26 with the next pixel instead of 0.37.
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
    """Return uncorrelated normal noise of variance 1, (height, width), float32.

    Args:
        height: Number of rows.
        width: Number of columns.
        left: Column of the first pixel; the noise is a hash of the position in the picture.
        top: Row of the first pixel.
        key: Seed, frame and channel.
    """
    result = np.empty((height, width), np.float32)
    seed, frame, channel = (number & 0xFFFFFFFFFFFFFFFF for number in key)
    _fill(left, top, np.uint64(seed), np.uint64(frame), np.uint64(channel), result)
    return result


@njit(cache=True)
def _mix(z: np.uint64) -> np.uint64:
    """Return a 64-bit hash by Steele, Lea and Flood, "Fast splittable random numbers", 2014."""
    z += np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ z >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ z >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return z ^ z >> np.uint64(31)


@njit(cache=True, nogil=True)
def _fill(
    left: int, top: int, seed: np.uint64, frame: np.uint64, channel: np.uint64, result: np.ndarray
) -> None:
    """Fill ``result`` with normal noise by Box and Muller.

    Source:
        Box and Muller, "A note on the generation of random normal deviates", 1958.
    """
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
