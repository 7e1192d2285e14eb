"""Bins that rays skip. Oracle: the same picture when they search all bins."""

import numpy as np
import pytest

import bokehnet.classical.rays_renderer
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.defocus_bins import BINS, TILE, occupied_bins
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.rays_renderer import rays
from tests.unit.classical.aberrated_lenses import CHARACTER


def scene() -> tuple[np.ndarray, np.ndarray]:
    """A leaning ground, a post and a floating plate; most of the right half is plain ground."""
    data = pytest.importorskip("skimage.data", reason="takes a photograph of scikit-image")
    image = (data.astronaut()[100:228, 100:420] / 255.0).astype(np.float32)
    defocus = np.tile(np.linspace(-3, -5, 320, dtype=np.float32), (128, 1))
    defocus[20:, 30:38] = 8
    defocus[50:70, 90:110] = 2
    return image, defocus


@pytest.mark.parametrize("lens_response", [None, CHARACTER])
def test_rays_miss_nothing_where_they_do_not_look(monkeypatch, lens_response):
    image, defocus = scene()
    picture = rays(image, defocus, lens_response=lens_response)
    shares = []

    def look_everywhere(*arguments):
        slices = occupied_bins(*arguments)
        shares.append(slices.smooth.mean())
        every = np.full_like(slices.bits, 2**64 - 1)
        return slices._replace(bits=every, smooth=np.zeros_like(slices.smooth))

    monkeypatch.setattr(bokehnet.classical.rays_renderer, "occupied_bins", look_everywhere)
    expected = rays(image, defocus, lens_response=lens_response)
    assert 0.3 < shares[0] < 0.9
    assert np.sqrt(np.mean((picture - expected) ** 2)) < 3e-4
    assert np.abs(picture - expected).max() < 0.01


def test_a_tile_looks_behind_the_first_layer_within_reach_of_a_hidden_one():
    depths = np.zeros((64, 256, 2), np.float32)
    depths[:, 100:104, 0] = 40
    layers = Layers(colors=np.zeros((*depths.shape, 3)), defocus=depths, coverage=np.ones_like(depths))
    smooth = occupied_bins(layer_cells(layers)).smooth
    columns = np.arange(smooth.shape[1]) * TILE
    near = (columns + TILE > 60) & (columns < 144)
    assert not smooth[:, near].any()
    assert smooth[:, (columns < 60 - 3 * TILE) | (columns > 144 + 2 * TILE)].all()


def test_half_covered_pixels_and_what_is_behind_them_are_looked_at():
    depths = np.full((32, 32, 2), 3.0, np.float32)
    cover = np.ones_like(depths)
    cover[16, 16, 0] = 0.5
    layers = Layers(colors=np.zeros((*depths.shape, 3)), defocus=depths, coverage=cover)
    slices = occupied_bins(layer_cells(layers))
    assert not slices.smooth[2, 2]
    assert slices.thickness == pytest.approx(0.002 / BINS, rel=1e-3)


@pytest.mark.parametrize(("slope", "expected"), [(0.2, True), (0.4, False)])
def test_steep_surfaces_are_walked_over(slope, expected):
    """One surface without a depth discontinuity, as soft maps have it: rays may meet it at several places."""
    depths = np.tile(np.clip((np.arange(256) - 120) * slope, 0, 6), (32, 1)).astype(np.float32)
    depths = depths[..., None]
    layers = Layers(colors=np.zeros((*depths.shape, 3)), defocus=depths, coverage=np.ones_like(depths))
    assert (occupied_bins(layer_cells(layers)).smooth[:, 120 // TILE] == expected).all()


def test_far_reaching_discs_find_no_fewer_bins(monkeypatch):
    """Authority: the search over all single tiles within reach."""
    rng = np.random.default_rng(0)
    depths = rng.uniform(-5, 5, (330, 270, 1)).astype(np.float32)
    depths[200:210, 100:120], depths[40:44, 220:224] = 150.0, -120.0
    cells = layer_cells(Layers(colors=np.zeros((*depths.shape, 3)), defocus=depths, coverage=depths * 0 + 1))
    found = occupied_bins(cells)
    monkeypatch.setattr("bokehnet.classical.layered.march.defocus_bins._MAX_REACH_TILES", 1000)
    expected = occupied_bins(cells)
    assert not (expected.bits & ~found.bits).any()
    assert not (found.smooth & ~expected.smooth).any()
    more, all_bits = (
        np.unpackbits(np.ascontiguousarray(bits).view(np.uint8)).sum()
        for bits in (found.bits & ~expected.bits, found.bits)
    )
    assert 0 < more < 0.2 * all_bits
