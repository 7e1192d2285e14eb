"""Diffraction rings in the blur discs of lamps, and stars around them, added to a blurred picture.

Both move light from its geometric distribution to the diffracted one: the sum of the light in the picture is
constant, except for light that stars send beyond the border.
"""

import numpy as np

from bokehnet.effects.convolution import convolve
from bokehnet.effects.lamps import Lamps
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.diffraction import disc_kernel, ring_kernel, star_kernel

__all__ = ["add_rings", "add_stars"]

# Discs of a smaller radius, pixels, show no rings.
_MIN_RADIUS_PX = 3.0
# A surface nearer than a lamp by this many pixels of blur radius occludes it.
_OCCLUSION_THRESHOLD_PX = 1.0


def _drawn_in_window(
    lamps: Lamps, reach: int, shape: tuple[int, ...]
) -> tuple[tuple[slice, slice], np.ndarray]:
    """Return the window that discs of this radius reach from the lamps, and the lamps' light in it."""
    rows = slice(max(0, lamps.row.min() - reach), min(shape[0], lamps.row.max() + reach + 1))
    columns = slice(max(0, lamps.column.min() - reach), min(shape[1], lamps.column.max() + reach + 1))
    size = rows.stop - rows.start, columns.stop - columns.start
    return (rows, columns), lamps.drawn(rows.start, columns.start, *size)


def add_rings(
    bokeh: np.ndarray, lamps: Lamps, defocus: np.ndarray, aperture: Aperture, unit: float
) -> np.ndarray:
    """Return the picture with Fresnel rings in the discs of lamps that are out of focus.

    Args:
        bokeh: Blurred picture, scene-linear, (H, W, 3).
        lamps: Lamps of the picture before the blur.
        defocus: Signed blur radius of each pixel, (H, W): nearer surfaces occlude discs.
        aperture: Shape of the aperture at the centre of the picture; rings are not vignetted.
        unit: F-number over the width of a pixel in micrometres.
    """
    bokeh = bokeh.copy()
    for radius, group in lamps.grouped_by_blur():
        if abs(radius) < _MIN_RADIUS_PX:
            continue
        rays, waves = disc_kernel(aperture, radius), ring_kernel(aperture, radius, unit)
        window, light = _drawn_in_window(group, len(rays) // 2, bokeh.shape)
        visible = (defocus[window] <= radius + _OCCLUSION_THRESHOLD_PX)[..., None]
        disc, wave = (visible * convolve(light, kernel) for kernel in (rays, waves))
        # The border and nearer surfaces clip both slightly differently: scale to the same light.
        old_light, new_light = disc.sum((0, 1)), wave.sum((0, 1))
        bokeh[window] += (
            wave * np.where(new_light > 0, old_light / np.where(new_light > 0, new_light, 1), 0) - disc
        )
    return bokeh


def add_stars(bokeh: np.ndarray, lamps: Lamps, aperture: Aperture, unit: float) -> np.ndarray:
    """Return the picture with the diffraction stars of lamps; arguments as in :func:`add_rings`.

    The blurred light of lamps is convolved with the far field of the aperture.
    """
    height, width = bokeh.shape[:2]
    light = np.zeros((height, width, 3))
    for radius, group in lamps.grouped_by_blur():
        if abs(radius) < 1:
            light += group.drawn(0, 0, height, width)
            continue
        rays = disc_kernel(aperture, radius)
        window, sharp = _drawn_in_window(group, len(rays) // 2, bokeh.shape)
        light[window] += convolve(sharp, rays)
    star = star_kernel(aperture, unit, max(height, width) - 1)
    return np.asarray(bokeh + (convolve(light, star) - light), bokeh.dtype)
