"""Number of rays. Authority: noise of known variance, and the formula of the optimal allocation."""

import math

import numpy as np
import pytest

from bokehnet.classical.layered.march.ray_accumulators import BACK_GROUP, GROUPS, PLAIN, SHARP_GROUP
from bokehnet.classical.layered.march.sample_counts import _NOISE, FIRST_RAYS, FirstPass, counts_by_variance

USUAL, MOST = 64, 128
GREY = 0.2
SLOPE = 1.055 / 2.4 * GREY ** (1 / 2.4 - 1)  # of the sRGB curve


def known(
    group: int, colors: np.ndarray, radius: float = 48.0, squares: np.ndarray | None = None
) -> FirstPass:
    """All rays of each pixel meet surfaces of one group."""
    sums = np.zeros((*colors.shape[:2], GROUPS, PLAIN), np.float32)
    sums[:, :, group, :3] = colors
    sums[:, :, group, 3] = 1.0
    sums[:, :, group, 4] = 1.0 / radius if squares is None else squares
    cells = np.ones((*colors.shape[:2], 2, 2), np.float32)
    return FirstPass(sums, np.ones(colors.shape[:2], bool), cells, USUAL, MOST)


@pytest.mark.parametrize("radius", [5.0, 48.0])
def test_rays_grow_with_the_root_of_the_variance(radius):
    """Neyman's allocation, for the noise that the window leaves; counts are the next powers of two."""
    side = 3 if radius < 12 else 9
    for expected in (12.0, 24.0, 48.0, 96.0):
        left = _NOISE * expected / USUAL  # of 64 rays
        sigma = left * side * math.sqrt(USUAL / FIRST_RAYS) / SLOPE
        noise = np.random.default_rng(0).normal(GREY, sigma, (64, 64, 3)).astype(np.float32)
        counts = counts_by_variance(known(BACK_GROUP, noise, radius))
        assert np.median(counts) == 2 ** math.ceil(math.log2(expected))


def test_smooth_slopes_take_the_first_rays_only():
    x = np.linspace(0.1, 0.9, 64, dtype=np.float32)
    counts = counts_by_variance(known(BACK_GROUP, np.tile(x[None, :, None], (40, 1, 3))))
    assert counts.shape == (5, 8)
    assert (counts == FIRST_RAYS).all()


def test_texture_in_focus_is_no_noise():
    """All rays of a pixel see one colour, whatever the next pixel's is."""
    texture = np.random.default_rng(1).random((64, 64, 3), dtype=np.float32)
    squares = texture.mean(-1) ** 2
    assert (counts_by_variance(known(SHARP_GROUP, texture, squares=squares)) == FIRST_RAYS).all()
    squares = squares + 0.3  # rays of a pixel that see different ones
    assert (counts_by_variance(known(SHARP_GROUP, texture, squares=squares)) == MOST).all()


def test_edges_in_focus_take_the_usual_number():
    first = known(SHARP_GROUP, np.full((32, 32, 3), GREY, np.float32), squares=np.full((32, 32), GREY**2))
    first.cells[10, 20, 0] = (0.0, 0.5)
    counts = counts_by_variance(first)
    assert counts[1, 2] == USUAL
    assert np.delete(counts.ravel(), 1 * 4 + 2).max() == FIRST_RAYS


def test_pixels_without_rays_do_not_count():
    first = known(BACK_GROUP, np.random.default_rng(2).random((32, 32, 3), dtype=np.float32))
    first.rays_mask[:, 16:] = False
    counts = counts_by_variance(first)
    assert counts[:, :2].min() > FIRST_RAYS
    assert counts[:, 2:].max() == FIRST_RAYS
