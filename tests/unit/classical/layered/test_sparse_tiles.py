"""Tiles of large discs, of which every fourth pixel sends rays. Authority: those of which all do."""

import numpy as np
from skimage import data

import bokehnet.classical.layered.ray_marching as ray_marching
from bokehnet.classical.layered.defocus_bins import BINS, DefocusBins, blurred_tiles
from bokehnet.classical.rays_renderer import rays


def test_tiles_are_blurred_where_no_bin_holds_less():
    """64 bins of 4 pixels from -128 to 128; discs of 96 pixels and more lie in the first and last 8."""
    bits = np.array([[1, 1 << 7, 1 << 8], [1 << 55, 1 << 56, (1 << 63) | 1]], np.uint64)
    flags = np.zeros(bits.shape, bool)
    bins = DefocusBins(bits=bits, smooth=flags, held=bits, low=-4.0 * BINS / 2, thickness=4.0)
    np.testing.assert_array_equal(blurred_tiles(bins, 96.0), [[True, True, False], [False, True, True]])
    assert blurred_tiles(bins, 0.0).all()


def test_a_quarter_of_the_pixels_gives_the_picture_of_all(monkeypatch):
    """A blurred ground, one nearer that is blurred alike, and a thing in focus, whose tiles send all rays."""
    image = (data.astronaut()[:360, :400] / 255.0).astype(np.float32) ** 2.2
    defocus = np.full(image.shape[:2], -110.0, np.float32)
    defocus[:, 250:] = 120.0
    defocus[60:120, 40:90] = 0.0
    found = rays(image, defocus)
    sent = []
    tiles_of = ray_marching.blurred_tiles

    def all_send(bins, radius):
        sent.append(tiles_of(bins, radius).mean())
        return np.zeros(bins.bits.shape, bool)

    monkeypatch.setattr(ray_marching, "blurred_tiles", all_send)
    seeds = [rays(image, defocus, seed=seed) for seed in range(3)]
    assert 0.3 < sent[0] < 0.99
    expected = np.mean(seeds, axis=0)
    noise = -10 * np.log10(np.mean((seeds[0] - np.mean(seeds[1:], axis=0)) ** 2))
    assert -10 * np.log10(np.mean((found - expected) ** 2)) > min(noise - 3, 50)
    assert np.abs(found.mean((0, 1)) / expected.mean((0, 1)) - 1).max() < 2e-3
