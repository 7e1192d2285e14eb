import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.optics.pixels.pixel_layers import merge_surfaces


def over(colors, coverage):
    """Layers (P, L, C) composited by Porter and Duff, 1984."""
    clear = np.cumprod(1 - coverage, -1)
    ahead = np.concatenate([np.ones_like(clear[:, :1]), clear[:, :-1]], -1)
    return ((ahead * coverage)[..., None] * colors).sum(1)


@pytest.mark.slow
@pytest.mark.parametrize("layers", [1, 2, 4, 9])
def test_merged_layers_show_what_the_samples_show(layers):
    """Authority: the mean over the samples, each composited by Porter and Duff's rule."""
    rng = np.random.default_rng(layers)
    colors = rng.random((50, 8, 3, 3))
    disparity = -np.sort(-rng.random((50, 8, 3)), -1)
    coverage = np.where(rng.random((50, 8, 3)) < 0.4, rng.random((50, 8, 3)), 1.0)
    coverage[:, :, 2] = 1
    expected = np.mean([over(colors[:, s], coverage[:, s]) for s in range(8)], 0)
    result, depths, covers = merge_surfaces(colors, disparity, coverage, layers)
    assert (np.diff(depths, axis=1) <= 0).all()
    assert covers.min() >= 0
    assert covers.max() <= 1
    np.testing.assert_allclose(over(result, covers), expected, atol=0.01)


def test_an_edge_covers_its_share_and_what_is_behind_it_all():
    colors = np.zeros((1, 4, 2, 3))
    colors[0, 0, 0] = colors[0, 1, 0] = [1, 0, 0]  # two samples meet a leaf before the wall
    disparity = np.array([[[0.8, 0.1], [0.82, 0.1], [0.1, 0], [0.1, 0]]])
    coverage = np.array([[[1, 1], [1, 1], [1, 0], [1, 0]]], float)
    result, depths, covers = merge_surfaces(colors, disparity, coverage, 3, 0.05)
    np.testing.assert_allclose(covers, [[0.5, 1, 0]])
    np.testing.assert_allclose(depths, [[0.81, 0.1, 0.1]], rtol=1e-5)
    np.testing.assert_allclose(result[0, 0], [1, 0, 0], atol=1e-6)


def test_surfaces_side_by_side_let_nothing_through():
    """A leaf on the left half and one behind it on the right: the wall is not seen."""
    disparity = np.array([[[0.8, 0.1], [0.5, 0.1]]])
    coverage = np.ones((1, 2, 2))
    _, _, covers = merge_surfaces(np.ones((1, 2, 2, 3)), disparity, coverage, 3)
    np.testing.assert_allclose(np.prod(1 - covers[:, :2], -1), 0, atol=1e-6)


def test_empty_pixels_stay_empty_and_no_layers_are_refused():
    empty = np.zeros((2, 3, 2))
    result, _, covers = merge_surfaces(np.ones((2, 3, 2, 3)), empty, empty, 2)
    assert covers.max() == result.max() == 0
    with pytest.raises(ParameterError, match="layers: expected"):
        merge_surfaces(np.ones((2, 3, 2, 3)), empty, empty, 0)
