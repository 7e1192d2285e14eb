"""Rings in the blur discs of lamps, and stars around them, laid over a blurred picture.

Both take light from where rays have it and put it where waves have it, so that no light comes or goes within
the picture but what stars send beyond its frame.
"""

import numpy as np

from bokehnet.effects.convolution import convolve
from bokehnet.effects.lamps import Lamps
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.diffraction import disc_kernel, ring_kernel, star_kernel

__all__ = ["add_rings", "add_stars"]

# Discs of a smaller radius, pixels, show no rings.
_SMALLEST = 3.0
# A surface so many pixels of blur radius nearer than a lamp hides it.
_NEARER = 1.0


def _drawn(lamps: Lamps, reach: int, shape: tuple[int, ...]) -> tuple[tuple[slice, slice], np.ndarray]:
    """The part of the picture that discs of this radius reach from the lamps, and their light in it."""
    rows = slice(max(0, lamps.row.min() - reach), min(shape[0], lamps.row.max() + reach + 1))
    columns = slice(max(0, lamps.column.min() - reach), min(shape[1], lamps.column.max() + reach + 1))
    size = rows.stop - rows.start, columns.stop - columns.start
    return (rows, columns), lamps.drawn(rows.start, columns.start, *size)


def add_rings(
    bokeh: np.ndarray, lamps: Lamps, defocus: np.ndarray, aperture: Aperture, unit: float
) -> np.ndarray:
    """Return the picture with Fresnel rings in the discs of lamps that are out of focus.

    Args:
        bokeh: The blurred picture, scene-linear, (H, W, 3).
        lamps: Of the picture before it was blurred.
        defocus: Signed blur radius of each pixel, (H, W): nearer surfaces hide discs.
        aperture: The opening, as in the middle of the picture; barrels do not clip rings.
        unit: F-number over the width of a pixel in micrometres.
    """
    bokeh = bokeh.copy()
    for radius, group in lamps.by_blur():
        if abs(radius) < _SMALLEST:
            continue
        rays, waves = disc_kernel(aperture, radius), ring_kernel(aperture, radius, unit)
        cut, light = _drawn(group, len(rays) // 2, bokeh.shape)
        seen = (defocus[cut] <= radius + _NEARER)[..., None]
        disc, wave = (seen * convolve(light, kernel) for kernel in (rays, waves))
        # What the frame and nearer surfaces hide of both differs a little: as much light comes as goes.
        had, has = disc.sum((0, 1)), wave.sum((0, 1))
        bokeh[cut] += wave * np.where(has > 0, had / np.where(has > 0, has, 1), 0) - disc
    return bokeh


def add_stars(bokeh: np.ndarray, lamps: Lamps, aperture: Aperture, unit: float) -> np.ndarray:
    """Return the picture with the stars that the edges of the opening make of lamps; others as above.

    The light of lamps, blurred as rays blur it, goes where the far field of the opening sends it.
    """
    height, width = bokeh.shape[:2]
    light = np.zeros((height, width, 3))
    for radius, group in lamps.by_blur():
        if abs(radius) < 1:
            light += group.drawn(0, 0, height, width)
            continue
        rays = disc_kernel(aperture, radius)
        cut, sharp = _drawn(group, len(rays) // 2, bokeh.shape)
        light[cut] += convolve(sharp, rays)
    star = star_kernel(aperture, unit, max(height, width) - 1)
    return np.asarray(bokeh + (convolve(light, star) - light), bokeh.dtype)
