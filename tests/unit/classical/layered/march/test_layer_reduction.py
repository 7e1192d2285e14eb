"""Layers at half their size. Authority: means of blocks, by hand."""

import numpy as np
import pytest

from bokehnet.classical.known_layers import Layers
from bokehnet.classical.layered.march.layer_reduction import half_layers, half_shape


def two_layers(defocus, coverage, colors, behind) -> Layers:
    """Return layers with one pixel deep arrays (H, W); the second is black at ``behind``."""
    defocus, coverage = np.asarray(defocus, np.float32), np.asarray(coverage, np.float32)
    light = np.repeat(np.asarray(colors, np.float32)[..., None], 3, -1)
    return Layers(
        colors=np.stack([light, np.zeros_like(light)], 2),
        defocus=np.stack([defocus, np.full_like(defocus, behind)], 2),
        coverage=np.stack([coverage, np.ones_like(coverage)], 2),
    )


def test_a_block_of_one_surface_is_its_mean():
    colors = np.arange(16.0).reshape(4, 4)
    half = half_layers(two_layers(np.full((4, 4), -20.0), np.ones((4, 4)), colors, -20.0))
    assert half.colors.shape[:2] == half_shape(4, 4) == (4, 4)
    np.testing.assert_allclose(half.colors[1:3, 1:3, 0, 0], colors.reshape(2, 2, 2, 2).mean((1, 3)))
    np.testing.assert_allclose(half.defocus[..., 0], -10)
    np.testing.assert_allclose(half.coverage, 1)


def test_pixels_beyond_the_border_repeat_the_border_alone():
    colors = np.arange(16.0).reshape(4, 4)
    half = half_layers(two_layers(np.full((4, 4), -20.0), np.ones((4, 4)), colors, -20.0))
    np.testing.assert_allclose(half.colors[1, 0, 0, 0], colors[0:2, 0].mean())
    np.testing.assert_allclose(half.colors[0, 0, 0, 0], colors[0, 0])
    np.testing.assert_allclose(half.colors[3, 2, 0, 0], colors[3, 2:4].mean())


def test_a_foreground_covers_its_fraction_of_a_block():
    """One pixel of four, and half of another: 3/8 of the block; the rest shows what is behind."""
    defocus = [[30.0, 30.0], [-30.0, -30.0]]
    half = half_layers(two_layers(defocus, [[1, 0.5], [1, 1]], [[0.8, 0.8], [0.2, 0.2]], -30.0))
    assert half.coverage[1, 1, 0] == np.float32(0.375)
    np.testing.assert_allclose(half.colors[1, 1, 0], 0.8, rtol=1e-6)
    np.testing.assert_allclose(half.defocus[1, 1], [15, -15])
    assert 0 < half.colors[1, 1, 1, 0] < 0.2  # the wall, and what the post hides: black


@pytest.mark.parametrize("occluded", [12.0, 18.0, 25.0])
def test_surfaces_on_both_sides_of_focus_do_not_become_a_sharp_one(occluded):
    """A post over half of the block hides a near surface; the other half shows a far one."""
    defocus = np.array([[40.0, -20.0], [40.0, -20.0]])
    layers = two_layers(defocus, np.ones((2, 2)), np.full((2, 2), 0.5), -20.0)
    layers.defocus[:, 0, 1] = occluded
    half = half_layers(layers)
    np.testing.assert_allclose(half.defocus[1, 1], [20, -10])


def test_a_layer_has_the_defocus_of_its_larger_part():
    """Behind glass: three far pixels and a near one; authority: the mean of the three."""
    defocus = np.array([[50.0, 50.0], [50.0, 50.0]])
    layers = two_layers(defocus, np.full((2, 2), 0.25), np.full((2, 2), 0.5), -20.0)
    layers.defocus[:, :, 1] = [[-20.0, -22.0], [-24.0, 30.0]]
    assert half_layers(layers).defocus[1, 1, 1] == np.float32(-11)
