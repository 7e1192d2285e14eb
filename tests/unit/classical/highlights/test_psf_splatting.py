"""Visibility of lights. Oracle: the same discs when every ray searches all bins of the defocus."""

import numpy as np
import pytest

from bokehnet.classical.highlights.lights import add_lights
from bokehnet.classical.layered.layers import split_layers
from bokehnet.classical.layered.march.defocus_bins import occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.optics.aperture import Aperture
from tests.unit.classical.aberrated_lenses import CHARACTER


@pytest.mark.parametrize("lens_response", [None, CHARACTER])
def test_rays_to_lights_search_all_bins_that_hold_an_occluder(lens_response):
    """Posts and plates before, at and behind the focus, and a leaning ground, in front of 40 lights."""
    rng = np.random.default_rng(3)
    defocus = np.tile(np.linspace(-30, -60, 192, dtype=np.float32), (160, 1))
    for depth in (-25.0, -6.0, 0.5, 18.0, 35.0):
        y, x = rng.integers(0, 140), rng.integers(0, 170)
        defocus[y : y + 60, x : x + 40], defocus[:, (x + 60) % 190] = depth, depth
    cells = layer_cells(split_layers(np.full((*defocus.shape, 3), 0.2, np.float32), defocus))
    bins = occupied_bins(cells)
    y, x = rng.integers(0, 160, 40), rng.integers(0, 192, 40)
    lights = np.column_stack([x, y, defocus[y, x] - 0.5, rng.uniform(10, 90, (40, 3)), np.ones((40, 2))])
    lights = lights[np.abs(lights[:, 2]) > 3]
    every = bins._replace(bits=np.full_like(bins.bits, 2**64 - 1), held=np.full_like(bins.held, 2**64 - 1))
    found, expected = np.zeros((2, *defocus.shape, 3), np.float32)
    for searched, result in ((bins, found), (every, expected)):
        mask = np.ones(defocus.shape, np.bool_)
        add_lights(lights, cells, mask, searched, Aperture(), result, lens_response=lens_response)
    open_sky = np.zeros_like(expected)
    no_cells = np.array(cells)
    no_cells[..., 0] = -100.0
    add_lights(
        lights, no_cells, mask, occupied_bins(no_cells), Aperture(), open_sky, lens_response=lens_response
    )
    assert expected.sum() < 0.9 * open_sky.sum()  # occluders do matter
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * expected.max())
