"""Authority: edges whose coverage is known by construction."""

import numpy as np
import pytest

from bokehnet.classical.layered.layers import Layers, split_layers, split_picture
from bokehnet.classical.rays_renderer import rays
from bokehnet.errors import ParameterError, ShapeError

GREEN, RED = np.array([0.1, 0.9, 0.2], np.float32), np.array([0.8, 0.1, 0.1], np.float32)


def edge(share, labelled_front):
    """Green before red; column 10 holds ``share`` of green and has the depth of the given side."""
    image = np.empty((12, 24, 3), np.float32)
    image[:, :10], image[:, 11:] = GREEN, RED
    image[:, 10] = share * GREEN + (1 - share) * RED
    defocus = np.where(np.arange(24) < 10 + labelled_front, 6.0, -9.0).astype(np.float32)
    return image, np.repeat(defocus[None], 12, 0)


@pytest.mark.parametrize(
    ("share", "labelled_front"), [(0.88, True), (0.95, True), (0.12, False), (0.1, False)]
)
def test_a_mixed_pixel_is_unmixed(share, labelled_front):
    layers = split_layers(*edge(share, labelled_front))
    assert abs(layers.coverage[6, 10, 0] - share) < 0.03
    np.testing.assert_allclose(layers.colors[6, 10, 0], GREEN, atol=0.05)
    np.testing.assert_allclose(layers.defocus[6, 10], (6.0, -9.0), atol=1e-5)
    if not labelled_front:
        np.testing.assert_allclose(layers.colors[6, 10, 1], RED, atol=0.03)


@pytest.mark.parametrize(("share", "labelled_front"), [(0.6, True), (0.4, False)])
def test_a_pixel_whose_edge_is_misplaced_gets_purer(share, labelled_front):
    """Its share is far from what the map and the pixel filter say: colour and share both give way."""
    layers = split_layers(*edge(share, labelled_front))
    mixed = share * GREEN + (1 - share) * RED
    own, pure = layers.colors[6, 10, 0 if labelled_front else 1], GREEN if labelled_front else RED
    assert np.abs(own - pure).max() < 0.75 * np.abs(mixed - pure).max()
    assert abs(layers.coverage[6, 10, 0] - share) < 0.2


def test_away_from_the_edge_the_picture_covers_all():
    image, defocus = edge(0.7, True)
    layers = split_layers(image, defocus)
    away = np.r_[0:9, 12:24]
    assert (layers.coverage[:, away, 0] == 1).all()
    np.testing.assert_array_equal(layers.colors[:, away, 0], image[:, away])


def test_sides_of_one_colour_stay_of_one_colour():
    image, defocus = edge(0.7, True)
    image[:] = 0.5
    np.testing.assert_allclose(split_layers(image, defocus).colors, 0.5, atol=1e-6)


def test_bad_layers_are_refused():
    colors, ones = np.ones((4, 5, 2, 3)), np.ones((4, 5, 2))
    with pytest.raises(ParameterError, match="coverage: expected 0 to 1, got 2 to 2"):
        Layers(colors=colors, defocus=ones, coverage=2 * ones)
    with pytest.raises(ParameterError, match="front to back"):
        Layers(colors=colors, defocus=np.cumsum(ones, 2), coverage=ones)
    with pytest.raises(ParameterError, match=r"^defocus"):
        Layers(colors=colors, defocus=np.inf * ones, coverage=ones)
    with pytest.raises(ShapeError, match="layer defocus"):
        Layers(colors=colors, defocus=ones[..., :1], coverage=ones)
    with pytest.raises(ShapeError, match="3 channels"):
        Layers(colors=colors[..., :2], defocus=ones, coverage=ones)


def test_what_is_hidden_hides_in_turn():
    """Bars before crossing bars before a wall, all blurred: light of each is its share of the area."""
    period, size = 12, 96
    bars = np.arange(size) % period < 3
    which = np.where(bars[None], 0, np.where(bars[:, None], 1, 2))
    colors = np.array([[0.9, 0.1, 0.1], [0.1, 0.9, 0.1], [0.2, 0.2, 0.9]], np.float32)
    image, defocus = colors[which], np.array([16.0, 11.0, -6.0], np.float32)[which]
    layers = split_layers(image, defocus)
    assert layers.defocus.shape[2] == 3
    periods = np.s_[2 * period + 6 : -2 * period - 6, 2 * period + 6 : -2 * period - 6]
    seen = [1 / 4, 3 / 4 * 1 / 4, 3 / 4 * 3 / 4]  # by two bars of three in twelve, independent of each other
    result = rays(image, defocus, layers=layers)[periods].mean((0, 1))
    np.testing.assert_allclose(result, seen @ colors, atol=0.002)


def test_there_is_no_third_layer_where_nothing_is_hidden_twice():
    assert split_layers(*edge(0.7, True)).defocus.shape[2] == 2


def test_the_stages_of_the_work_are_reported_in_order():
    shares = []
    result = split_picture(*edge(0.6, True), progress=shares.append).layers
    untold = split_picture(*edge(0.6, True)).layers
    assert len(shares) > 2
    assert shares == sorted(shares)
    assert shares[0] > 0
    assert shares[-1] == 1
    np.testing.assert_array_equal(result.colors, untold.colors)
