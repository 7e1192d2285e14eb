"""Pictures made of finer ones by a pixel filter, as renderers and cameras make them."""

import numpy as np

__all__ = ["draw_pixel_filter", "filter_pixels"]

# Share of pictures whose pixels are plain means; others have Gaussian filters of such deviations, pixels.
# Blackman-Harris filters 1.5 pixels wide lie near 0.39, and lenses and demosaicing are softer.
_BOX, _DEVIATIONS = 0.2, (0.28, 0.6)

# Reach of the filters, pixels.
_REACH = 1.5


def draw_pixel_filter(factor: int, rng: np.random.Generator) -> np.ndarray:
    """Draw the weights of fine pixels along one axis, (n,) of sum 1, even n, centred on a pixel.

    Args:
        factor: Fine pixels along the side of a pixel, even.
        rng: Random numbers.
    """
    count = int(_REACH * factor)
    away = (np.arange(-count, count) + 0.5) / factor
    deviation = rng.uniform(*_DEVIATIONS)
    gaussian = np.exp(-0.5 * (away / deviation) ** 2)
    weights: np.ndarray = np.abs(away) < 0.5 if rng.random() < _BOX else gaussian
    return (weights / weights.sum()).astype(np.float32)


def filter_pixels(fine: np.ndarray, factor: int, weights: np.ndarray) -> np.ndarray:
    """Make a picture (H, W, C) of a fine one (factor H, factor W, C); the border is repeated.

    Args:
        fine: Any unit.
        factor: Fine pixels along the side of a pixel, even.
        weights: From :func:`draw_pixel_filter`; columns and rows are weighted alike.
    """
    reach = (len(weights) - factor) // 2
    for axis in range(2):
        around = [(reach, reach) if i == axis else (0, 0) for i in range(fine.ndim)]
        padded = np.moveaxis(np.pad(fine, around, "edge"), axis, 0)
        size = (len(padded) - 2 * reach) // factor
        parts = (w * padded[i : i + factor * (size - 1) + 1 : factor] for i, w in enumerate(weights))
        fine = np.moveaxis(sum(parts), 0, axis)  # type: ignore[arg-type]
    return np.ascontiguousarray(fine)
