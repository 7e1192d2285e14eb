"""The numbers behind a distributed picture: one even sequence, in its own dimension for each purpose.

All samples of a pixel are points of one Halton sequence; every pixel shifts it by its own amount, so that
neighbours do not share their noise. Where pixels share their views, lens, place in the pixel, time and
wavelength of a sample are the same for all of them.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bokehnet.optics.sampling import disc_from_square, rotate_points
from bokehnet.raytrace.paths import DIMENSIONS_PER_BOUNCE

__all__ = ["Distribution", "LensSamples", "halton_points"]

# Dimensions. The pupil comes first and the wavelength with it: together they fill a cylinder evenly (Jeong et
# al., "Expressive chromatic accumulation buffering for defocus blur", The Visual Computer 2016).
_PUPIL, _WAVELENGTH, _PIXEL, _TIME, _BOUNCES = (0, 1), 2, (3, 4), 5, 6


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class LensSamples:
    """What camera rays are made of; M = samples * pixels, pixels run fastest.

    Attributes:
        pupil_uv: Points of the unit disc, (M, 2).
        jitter: Offset from the pixel's centre, pixels, (M, 2).
        time: In [-0.5, 0.5) of the shutter's opening, (M,).
        wavelength: In [0, 1) of the spectrum, (M,).
    """

    pupil_uv: Tensor
    jitter: Tensor
    time: Tensor
    wavelength: Tensor


class Distribution:
    """The numbers of all pixels of a picture.

    Args:
        pixels: How many there are.
        bounces: How often light is scattered at most.
        seed: Same seed, same numbers.
        device: Where they are used.
        window: Which pixels are asked for, counted from there on; a pixel's numbers do not depend on it.
        shared_views: Whether all pixels see through the same point of the pupil in each sample.
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
            whole = torch.rand(pixels, generator=generator)
            part = whole if window is None else whole[window].clone()
            shifts.append(whole[:1].expand(len(part)) if shared_views and dimension < _BOUNCES else part)
        self._shifts = torch.stack(shifts).to(device)

    def points(self, start: int, count: int) -> Tensor:
        """Samples ``start`` to ``start + count`` before they are shifted, (count, D)."""
        points = np.stack([halton_points(count, base, start) for base in self._bases], -1)
        return torch.from_numpy(points.astype(np.float32)).to(self._shifts.device)

    def lens_samples(self, points: Tensor, pixels: Tensor) -> LensSamples:
        """What the camera rays of ``pixels`` (P,) need for ``points`` (S, D)."""

        def shifted(dimension: int) -> Tensor:
            return rotate_points(points[:, dimension, None], self._shifts[dimension, pixels]).flatten()

        return LensSamples(
            pupil_uv=disc_from_square(torch.stack([shifted(dimension) for dimension in _PUPIL], -1)),
            jitter=torch.stack([shifted(dimension) for dimension in _PIXEL], -1) - 0.5,
            time=shifted(_TIME) - 0.5,
            wavelength=shifted(_WAVELENGTH),
        )

    def path_number(self, points: Tensor, pixels: Tensor, dimension: Tensor, row: Tensor) -> Tensor:
        """Number (M,) of a path's ``dimension`` (M,) for rays ``row`` (M,) of :meth:`lens_samples`."""
        width = len(pixels)
        place = _BOUNCES + dimension
        sample, pixel = torch.div(row, width, rounding_mode="floor"), pixels[row % width]
        return rotate_points(points[sample, place], self._shifts[place, pixel])


def halton_points(count: int, base: int, start: int = 0) -> np.ndarray:
    """Elements ``start`` to ``start + count`` of a radical inverse whose digits are shuffled, in [0, 1).

    The digits of a large base come in an order that follows nothing in other large bases; plain Halton
    sequences of such bases run in parallel for their first hundreds of points. One order of the digits
    belongs to each base, and 0 stays 0.

    Source:
        Halton, 1960; Braaten and Weller, "An improved low-discrepancy sequence for multidimensional
        quasi-Monte Carlo integration", Journal of Computational Physics 1979, for shuffled digits.
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
    found: list[int] = []
    number = 2
    while len(found) < count:
        if all(number % prime for prime in found):
            found.append(number)
        number += 1
    return found
