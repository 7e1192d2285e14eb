"""Random pixel filters of training pictures that are downsampled from finer ones."""

import numpy as np

from bokehnet.optics.pixels.pixel_filter import PixelFilter

__all__ = ["draw_pixel_filter"]

# Probability of a box filter, and range of widths of the Gaussians otherwise, pixels. A Blackman-Harris
# filter 1.5 pixels wide resembles a Gaussian of 1.9; lenses and demosaicing are softer.
_BOX_PROBABILITY, _GAUSSIAN_WIDTHS = 0.2, (1.3, 2.7)


def draw_pixel_filter(rng: np.random.Generator) -> PixelFilter:
    """Draw the pixel filter of one picture."""
    gaussian = PixelFilter("gaussian", rng.uniform(*_GAUSSIAN_WIDTHS))
    return PixelFilter("box", 1) if rng.random() < _BOX_PROBABILITY else gaussian
