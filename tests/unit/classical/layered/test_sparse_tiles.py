"""Every fourth pixel for all. Authority: counting, and the picture that all pixels' rays give."""

import numpy as np
import pytest

from bokehnet.classical.layered import ray_marching
from bokehnet.classical.layered.defocus_bins import BINS, TILE, DefocusBins
from bokehnet.classical.layered.sparse_tiles import STANDS_FOR, chosen_pixels, sparse_tiles, weigh
from bokehnet.classical.rays_renderer import rays


def bins_of(bits: np.ndarray) -> DefocusBins:
    """From -64 to 64 pixels of defocus, two a bin."""
    bits = bits.astype(np.uint64)
    return DefocusBins(bits=bits, smooth=bits == 0, held=bits, low=-float(BINS), thickness=2.0)


@pytest.mark.parametrize(
    ("number", "expected"), [(0, True), (6, True), (8, False), (32, False), (55, False), (56, True)]
)
def test_tiles_are_sparse_where_all_discs_are_large(number, expected):
    """A bin i holds the defocus from 2 i - 64 to 2 i - 62; discs of 48 pixels and more are large."""
    bits = np.full((3, 4), 1 << number, np.uint64)
    found = sparse_tiles(bins_of(bits), 3 * TILE, 4 * TILE - 1)
    assert (found[:, :3] == expected).all()
    assert not found[:, 3].any(), "the border cuts it"


def test_one_of_each_four_is_chosen_and_two_of_any_nine():
    sparse = np.array([[True, False], [True, True]])
    chosen = chosen_pixels(sparse, np.ones((2 * TILE, 2 * TILE), bool))
    assert chosen[:TILE, TILE:].all()
    below = chosen[TILE:]
    np.testing.assert_array_equal(below.reshape(TILE // 2, 2, TILE, 2).sum((1, 3)), 1)
    windows = np.lib.stride_tricks.sliding_window_view(below, (3, 3)).sum((2, 3))
    assert windows.min() >= 2
    rows, columns = np.nonzero(below)
    assert rows.mean() == (TILE - 1) / 2
    assert columns.mean() == TILE - 0.5
    sums = np.ones((2 * TILE, 2 * TILE, 3, 6), np.float32)
    weigh(sparse, sums)
    assert (sums[:TILE, TILE:] == 1).all()
    assert (sums[TILE:] == STANDS_FOR).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_the_picture_is_that_of_all_pixels_rays(sign, monkeypatch):
    y, x = np.mgrid[:160, :200].astype(np.float32)
    image = np.stack([0.4 + 0.3 * np.sin(x / 9), 0.4 + 0.3 * np.sin((x + y) / 7), (x + y) / 400], -1)
    defocus = np.where(x < 120, sign * 52.0, sign * 70.0).astype(np.float32)
    found, sent = rays(image, defocus), []

    def none(bins, height, width):
        sent.append(sparse_tiles(bins, height, width))
        return np.zeros_like(sent[-1])

    monkeypatch.setattr(ray_marching, "sparse_tiles", none)
    expected = rays(image, defocus)
    assert sent[-1].mean() > 0.9
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.004
    assert found.mean() == pytest.approx(expected.mean(), abs=2e-4)
