"""Rings, stars, ghosts and glare on pictures: where the light goes, and that none comes or is lost."""

import numpy as np
import pytest

from bokehnet.effects.convolution import convolve
from bokehnet.effects.diffracted_lamps import add_rings, add_stars
from bokehnet.effects.ghosts import Ghosts
from bokehnet.effects.glare import Glare
from bokehnet.effects.lamps import find_lamps
from bokehnet.errors import ParameterError
from bokehnet.lenses import load_lens
from bokehnet.lenses.ghosts import trace_ghosts
from bokehnet.optics.aperture import Aperture
from bokehnet.optics.spectral.diffraction import disc_kernel, ring_kernel

SIZE = 161


def lamp(defocus, light=(50.0, 40.0, 30.0), at=(80, 80)):
    image, depth = np.zeros((SIZE, SIZE, 3), np.float32), np.full((SIZE, SIZE), defocus, np.float32)
    image[at] = light
    return find_lamps(image, depth, 1.0), depth


def disc(radius, light=(50.0, 40.0, 30.0)):
    lamps, _ = lamp(radius, light)
    return convolve(lamps.drawn(0, 0, SIZE, SIZE), disc_kernel(Aperture(), radius))


def test_convolution_is_that_of_a_plain_loop():
    rng = np.random.default_rng(0)
    image, kernel = rng.random((9, 7, 2)), rng.random((5, 3, 2))
    expected = np.zeros_like(image)
    for y in range(9):
        for x in range(7):
            for v in range(-2, 3):
                for u in range(-1, 2):
                    if 0 <= y + v < 9 and 0 <= x + u < 7:
                        expected[y + v, x + u] += image[y, x] * kernel[v + 2, u + 1]
    np.testing.assert_allclose(convolve(image, kernel), expected, atol=1e-12)


@pytest.mark.parametrize("radius", [18.0, -18.0])
def test_a_lamp_out_of_focus_becomes_its_rings(radius):
    lamps, defocus = lamp(radius)
    bokeh = 0.1 + disc(radius)
    result = add_rings(bokeh, lamps, defocus, Aperture(), 0.3)
    expected = 0.1 + convolve(lamps.drawn(0, 0, SIZE, SIZE), ring_kernel(Aperture(), radius, 0.3))
    np.testing.assert_allclose(result, expected, atol=1e-9)
    np.testing.assert_allclose(result.sum((0, 1)), bokeh.sum((0, 1)), rtol=1e-12)


def test_rings_stay_behind_what_is_nearer_and_no_light_is_lost():
    lamps, defocus = lamp(-18.0)
    defocus[:, 85:] = 0
    bokeh = disc(-18.0)
    bokeh[:, 85:] = 0.2
    result = add_rings(bokeh, lamps, defocus, Aperture(), 0.3)
    np.testing.assert_array_equal(result[:, 85:], bokeh[:, 85:])
    assert np.abs(result - bokeh).max() > 1e-3
    np.testing.assert_allclose(result.sum((0, 1)), bokeh.sum((0, 1)), rtol=1e-12)


def test_six_blades_make_six_spikes_and_round_apertures_no_spikes():
    lamps, _ = lamp(0.0)
    image = lamps.drawn(0, 0, SIZE, SIZE)
    angle = np.radians(np.arange(0, 360, 2))
    ring = np.rint(80 + 40 * np.stack([np.sin(angle), np.cos(angle)])).astype(int)
    around = {}
    for blades in (0, 6):
        result = add_stars(image, lamps, Aperture(blades=blades), 1.2)
        np.testing.assert_allclose(result.sum((0, 1)), image.sum((0, 1)), rtol=0.02)  # the rest leaves
        around[blades] = result[ring[0], ring[1], 1]
    strength = np.abs(np.fft.rfft(around[6]))
    assert strength[1:].argmax() + 1 == 6
    assert around[6].max() > 10 * np.median(around[6])
    assert around[0].max() < 4 * np.median(around[0])


def test_ghosts_have_the_light_of_their_shares():
    """All of those that fall into the picture; a lamp in the middle of a large one."""
    lens = load_lens("cooke_triplet", f_number=11.0)
    lamps, _ = lamp(0.0, (1e4, 1e4, 1e4), at=(90, 70))
    ghosts = Ghosts(lens=lens, half_diagonal=400.0)
    result = ghosts.light(lamps, SIZE, SIZE)
    scale = 0.5 * np.hypot(SIZE, SIZE) / 400
    place = ((70 - 80) / scale, (90 - 80) / scale)
    expected = [
        1e4 * sum(ghost.relative_flux for ghost in trace_ghosts(lens, place, wavelength=wavelength, side=96))
        for wavelength in (610.0, 550.0, 465.0)
    ]
    assert result.min() >= 0
    np.testing.assert_allclose(result.sum((0, 1)), expected, rtol=0.04)


def test_glare_veils_and_keeps_the_light():
    lamps, _ = lamp(0.0)
    image = lamps.drawn(0, 0, SIZE, SIZE)
    result = Glare(share=0.1).apply(image, 70.0)  # no scattered light leaves the array
    np.testing.assert_allclose(result.sum((0, 1)), image.sum((0, 1)), rtol=1e-9)
    assert 45 < result[80, 80, 0] < 50
    inner, outer = result[80, 90, 0], result[80, 120, 0]
    assert inner / outer == pytest.approx(16, rel=0.01)  # by the square of the distance
    with pytest.raises(ParameterError, match=r"share: expected 0 to 0\.5, got 0\.7"):
        Glare(share=0.7)
