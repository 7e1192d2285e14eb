"""Lights before nothing but a dark wall, and what can stand in front of them."""

import numpy as np

from bokehnet.classical.highlights.lights import add_lights
from bokehnet.classical.layered.march.defocus_bins import occupied_bins, perfect_lens_reach
from bokehnet.optics.aperture import Aperture

DISC = Aperture()


def point(x, y, defocus, width=1.0, height=1.0):
    """One light of energy 1 in each colour."""
    return np.array([[x, y, defocus, 1.0, 1.0, 1.0, width, height]])


def draw(lights, size, aperture=DISC, *, front=None, **options):
    """Lights alone, (H, W, 3); ``front`` is the defocus of what stands before them, -2000 for nothing."""
    depths = np.full(size, -2000, np.float32) if front is None else np.asarray(front, np.float32)
    cells = np.stack([depths, np.ones_like(depths)], -1)[:, :, None]
    result = np.zeros((*size, 3), np.float32)
    slices = occupied_bins(cells, lambda defocus: 2 * perfect_lens_reach(defocus) + 60)
    add_lights(lights, cells, np.ones(size, bool), slices, aperture, result, **options)
    return result


def decibel(result, expected, peak):
    """Peak signal to noise ratio."""
    return 20 * np.log10(peak / max(np.sqrt(np.mean((result - expected) ** 2)), 1e-12 * peak))
