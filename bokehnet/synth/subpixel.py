"""The pixel filters of training pictures, which are made of finer ones."""

import numpy as np

from bokehnet.optics.pixels.pixel_filter import PixelFilter

__all__ = ["draw_pixel_filter"]

# Share of pictures whose pixels are plain means, and widths of the Gaussians of the others, pixels. What
# Blackman-Harris filters 1.5 pixels wide weigh is as a Gaussian of 1.9; lenses and demosaicing are softer.
_BOX, _WIDTHS = 0.2, (1.3, 2.7)


def draw_pixel_filter(rng: np.random.Generator) -> PixelFilter:
    """Draw the filter of one picture."""
    gaussian = PixelFilter("gaussian", rng.uniform(*_WIDTHS))
    return PixelFilter("box", 1) if rng.random() < _BOX else gaussian
