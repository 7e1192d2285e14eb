"""Sample numbers of distribution ray tracing: one low-discrepancy sequence with a dimension per purpose.

All samples of a pixel are points of one Halton sequence; every pixel applies its own shift, so that
neighbours have independent noise. With shared views, all pixels use the same pupil point, pixel position,
time and wavelength in a sample.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.optics.sampling import disc_from_square, rotate_points
from bokehnet.raytrace.paths import DIMENSIONS_PER_BOUNCE

__all__ = ["Distribution", "LensSamples", "halton_points"]

# Dimensions of the sequence. Pupil and wavelength come first: together they fill a cylinder evenly (Jeong et
# al., "Expressive chromatic accumulation buffering for defocus blur", The Visual Computer 2016).
_PUPIL, _WAVELENGTH, _PIXEL, _TIME, _BOUNCES = (0, 1), 2, (3, 4), 5, 6


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LensSamples:
    """Parameters of camera rays; M = samples * pixels, with pixels in the fastest dimension.

    Attributes:
        pupil_uv: Pupil points in the unit disc, (M, 2).
        jitter: Offsets from the pixel centre, pixels, (M, 2).
        time: Times in [-0.5, 0.5) exposure times, (M,).
        wavelength: Positions in the spectrum, [0, 1), (M,).
    """

    pupil_uv: Tensor
    jitter: Tensor
    time: Tensor
    wavelength: Tensor


class Distribution:
    """Sample numbers of all pixels of a picture.

    Args:
        pixels: Number of pixels.
        bounces: Maximum number of scattering events.
        seed: Seed of the shifts.
        device: Device of the numbers.
        window: Range of pixels to serve, indexed from its start; a pixel's numbers do not depend on it.
        shared_views: True if all pixels use the same pupil point in each sample.
    """

    def __init__(
        self,
        pixels: int,
        bounces: int,
        seed: int,
        device: torch.device,
        *,
        window: slice | None = None,
        shared_views: bool = False,
    ) -> None:
        self._bases = _primes(_BOUNCES + (bounces + 1) * DIMENSIONS_PER_BOUNCE)
        generator = torch.Generator().manual_seed(seed)
        shifts = []
        for dimension in range(len(self._bases)):
            all_shifts = torch.rand(pixels, generator=generator)
            shift = all_shifts if window is None else all_shifts[window].clone()
            shifts.append(
                all_shifts[:1].expand(len(shift)) if shared_views and dimension < _BOUNCES else shift
            )
        self._shifts = torch.stack(shifts).to(device)

    def points(self, start: int, count: int) -> Tensor:
        """Return samples ``start`` to ``start + count`` without shifts, (count, D)."""
        points = np.stack([halton_points(count, base, start) for base in self._bases], -1)
        return torch.from_numpy(points.astype(np.float32)).to(self._shifts.device)

    def lens_samples(self, points: Tensor, pixels: Tensor) -> LensSamples:
        """Return the camera-ray parameters of ``pixels`` (P,) for ``points`` (S, D)."""

        def shifted(dimension: int) -> Tensor:
            return rotate_points(points[:, dimension, None], self._shifts[dimension, pixels]).flatten()

        return LensSamples(
            pupil_uv=disc_from_square(torch.stack([shifted(dimension) for dimension in _PUPIL], -1)),
            jitter=torch.stack([shifted(dimension) for dimension in _PIXEL], -1) - 0.5,
            time=shifted(_TIME) - 0.5,
            wavelength=shifted(_WAVELENGTH),
        )

    def path_number(self, points: Tensor, pixels: Tensor, dimension: Tensor, row: Tensor) -> Tensor:
        """Return the numbers (M,) of ``dimension`` (M,) for rays ``row`` (M,) of :meth:`lens_samples`."""
        width = len(pixels)
        index = _BOUNCES + dimension
        sample, pixel = torch.div(row, width, rounding_mode="floor"), pixels[row % width]
        return rotate_points(points[sample, index], self._shifts[index, pixel])


def halton_points(count: int, base: int, start: int = 0) -> np.ndarray:
    """Return elements ``start`` to ``start + count`` of a digit-scrambled radical inverse, in [0, 1).

    Without scrambling, Halton sequences of large bases are correlated for their first hundreds of points.
    Each base has one fixed permutation of its digits, which keeps 0.

    Source:
        Halton, 1960; Braaten and Weller, "An improved low-discrepancy sequence for multidimensional
        quasi-Monte Carlo integration", Journal of Computational Physics 1979, for scrambled digits.
    """
    digits = np.concatenate([[0], 1 + np.random.default_rng(base).permutation(base - 1)])
    index = np.arange(start + 1, start + count + 1)
    result = np.zeros(count)
    fraction = 1.0
    while index.any():
        fraction /= base
        result += fraction * digits[index % base]
        index //= base
    return result


def _primes(count: int) -> list[int]:
    primes: list[int] = []
    number = 2
    while len(primes) < count:
        if all(number % prime for prime in primes):
            primes.append(number)
        number += 1
    return primes
