"""Edge profile of maps whose distance from the edges of the picture is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from bokehnet.depth_repair.edge_bias import shift_edges
from bokehnet.depth_repair.edge_profile import (
    DepthEdges,
    EdgeProfile,
    accepted_offset,
    accepted_shift,
    edge_profile,
    find_depth_edges,
)
from bokehnet.depth_repair.map_offset import translate_map
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from tests.unit.depth_repair.test_edge_bias import blobs
from tests.unit.depth_repair.test_map_offset import textured


def picture(truth: np.ndarray) -> np.ndarray:
    """Return a textured picture with different colours near and far, scene-linear (3, H, W)."""
    return textured(truth).transpose(2, 0, 1)


def noise(seed: int, shape: tuple[int, ...] = (3, 200, 320)) -> np.ndarray:
    """Return texture without edges, scene-linear (3, H, W)."""
    values = gaussian_filter(np.random.default_rng(seed).standard_normal(shape), (0, 1, 1))
    return (0.3 * np.exp(0.4 * values / values.std())).astype(np.float32)


def discs(radius: float, height: int = 200, width: int = 320) -> np.ndarray:
    """Return a map of near discs with a radius in pixels, 64 pixels apart, (H, W)."""
    y, x = np.mgrid[:height, :width]
    return (np.hypot(y % 64 - 32, x % 64 - 32) < radius).astype(np.float32)


def test_depth_edges_lie_on_a_circle_with_normals_to_its_centre():
    """Authority: the equation of the circle."""
    y, x = np.mgrid[:120, :140]
    edges = find_depth_edges(3 + 7 * (np.hypot(y - 60.3, x - 70.8) < 35).astype(np.float32))
    down, right = edges.places - np.array([[60.3], [70.8]])
    distance = np.hypot(down, right)
    assert_allclose(distance, 35, atol=0.8)
    assert abs(distance.mean() - 35) < 0.1
    inward = -(edges.normals[0] * down + edges.normals[1] * right) / distance
    assert inward.min() > 0.95
    assert_allclose(np.hypot(*edges.normals), 1, atol=1e-5)
    # A digital circle has between 8 r / sqrt(2) and 8 r pixels.
    assert 8 * 35 / np.sqrt(2) < len(edges.slopes) < 8 * 35


@pytest.mark.parametrize("pixels", range(-4, 5))
def test_the_offset_equals_the_growth_of_near_discs(pixels):
    """Authority: the radius of the discs."""
    profile = edge_profile(picture(discs(24)), find_depth_edges(discs(24 + pixels)))
    assert abs(profile.offset - pixels) < 0.5
    assert profile.is_certain
    assert profile.is_centred == (pixels == 0)
    assert accepted_shift(profile, -pixels) == -pixels
    assert accepted_shift(profile, pixels) == 0


@pytest.mark.parametrize("scale", [-1, 0.002, 50])
def test_profiles_do_not_depend_on_the_unit_of_the_map(scale):
    """A negative scale exchanges near and far: offsets change their sign."""
    truth = blobs()
    shifted = shift_edges(truth, 2)
    plain = edge_profile(picture(truth), find_depth_edges(shifted))
    scaled = edge_profile(picture(truth), find_depth_edges((scale * shifted + 3).astype(np.float32)))
    assert_allclose(scaled.offset, np.sign(scale) * plain.offset, atol=0.1)
    assert_allclose(scaled.certainty, plain.certainty, rtol=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_profiles_of_pictures_without_edges_are_uncertain(seed):
    edges = find_depth_edges(blobs())
    for image in (np.full((3, 200, 320), 0.4, np.float32), noise(seed)):
        profile = edge_profile(image, edges)
        assert not profile.is_certain
        assert accepted_shift(profile, 3) == accepted_shift(profile, -3) == 0
        assert accepted_offset(image, edges, (2, -3)) == (0, 0)


@pytest.mark.parametrize("pixels", [-3, 3])
def test_square_windows_move_slanted_edges_further(pixels):
    """Authority: the square's diagonal; the filter moves edges by 3 pixels along the axes."""
    truth = blobs()
    profile = edge_profile(picture(truth), find_depth_edges(shift_edges(truth, pixels)))
    assert 3 - 0.5 < np.sign(pixels) * profile.offset < 3 * np.sqrt(2) + 0.5
    assert accepted_shift(profile, -pixels) == -pixels


def test_texture_on_the_near_side_alone_supports_no_shift():
    """The gradient is larger everywhere inside near things, but it has no peak there."""
    truth = discs(24)
    image = np.where(truth > 0, noise(0), 0.3).astype(np.float32)
    profile = edge_profile(image, find_depth_edges(truth))
    assert accepted_shift(profile, -3) == 0


@pytest.mark.parametrize("shape", [(1, 1), (24, 400), (25, 25)])
def test_maps_without_edges_away_from_the_border_have_no_profile(shape):
    edges = find_depth_edges(np.random.default_rng(0).random(shape, dtype=np.float32))
    assert edge_profile(np.ones((3, *shape), np.float32), edges).certainty == 0


def test_constant_maps_have_no_edges():
    assert len(find_depth_edges(np.full((64, 64), 2, np.float32)).slopes) == 0


@pytest.mark.parametrize(
    ("offset", "certainty", "shift", "accepted"),
    [
        (2.6, 0.5, -2, -2),
        (2.6, 0.5, -7, -3),
        (-1.2, 0.5, 4, 1),
        (2.6, 0.09, -2, 0),
        (2.6, 0.5, 2, 0),
        (0.8, 0.5, -2, 0),
        (2.6, 0.5, 0, 0),
    ],
)
def test_shifts_need_a_certain_profile_of_their_direction_and_reach_no_further(
    offset, certainty, shift, accepted
):
    profile = EdgeProfile(offset=offset, certainty=certainty, edge_pixels=100)
    assert accepted_shift(profile, shift) == accepted


@pytest.mark.parametrize("offset", [(0, 1), (0, -2), (3, 0), (-4, 4), (5, -6)])
def test_translations_of_the_map_are_accepted_and_no_others(offset):
    """Authority: the translation that the map has undergone."""
    truth = blobs()
    image, edges = picture(truth), find_depth_edges(translate_map(truth, offset))
    back = (-offset[0], -offset[1])
    assert accepted_offset(image, edges, back) == back
    assert accepted_offset(image, edges, offset) == (0, 0)
    assert accepted_offset(image, find_depth_edges(truth), back) == (0, 0)


def test_a_wrong_component_of_a_translation_is_left_out():
    truth = blobs()
    edges = find_depth_edges(translate_map(truth, (0, 3)))
    assert accepted_offset(picture(truth), edges, (4, -3)) == (0, -3)


def test_edges_are_selected_by_block_and_evenly():
    edges = find_depth_edges(blobs())
    left = np.arange(40) < 20
    inside = edges.within(np.tile(left, (25, 1)))
    assert 0 < len(inside.slopes) < len(edges.slopes)
    assert inside.places[1].max() < 160
    few = edges.subsampled(100)
    assert len(few.slopes) == 100
    assert_array_equal(few.places[:, [0, -1]], edges.places[:, [0, -1]])
    assert edges.subsampled(len(edges.slopes)) is edges


def test_a_subsample_has_the_same_profile(monkeypatch):
    truth = blobs()
    edges = find_depth_edges(shift_edges(truth, 2))
    every = edge_profile(picture(truth), edges)
    monkeypatch.setattr("bokehnet.depth_repair.edge_profile._MAX_EDGE_PIXELS", 500)
    some = edge_profile(picture(truth), edges)
    assert some.edge_pixels == every.edge_pixels > 500
    assert abs(some.offset - every.offset) < 0.25


def test_certainty_is_the_height_of_the_peak_above_its_higher_side():
    """Authority: the closed form for a straight edge, whose pixels all have the same profile."""
    step = np.where(np.arange(96) < 48, 0.0, 1.0)
    light = np.expm1(gaussian_filter1d(step, 1.0) * np.log(21)) / 20  # encoded, it is the smooth step
    image = np.tile(light, (3, 64, 1)).astype(np.float32)
    edges = DepthEdges(
        np.array([np.full(64, 32.0), np.full(64, 47.5)]),
        np.array([np.zeros(64), np.ones(64)]),
        np.full(64, 0.3),
    )
    distances = np.arange(-11, 11.1, 0.5)
    smooth = np.interp(np.arange(-12, 12.1, 0.5) + 47.5, np.arange(96), gaussian_filter1d(step, 1.0))
    gradient = (smooth[4:] - smooth[:-4]) / 2
    gradient /= gradient.mean() + 0.005
    middle = gradient[np.abs(distances) < 0.6].mean()
    side = gradient[(distances > 1.4) & (distances < 3.6)].mean()
    profile = edge_profile(image, edges)
    assert_allclose(profile.certainty, middle - side, rtol=1e-2)
    assert abs(profile.offset) < 0.1  # light between pixels is interpolated before it is encoded


@pytest.mark.slow
def test_the_repair_leaves_maps_whose_edges_are_right_but_look_alike():
    """Authority: the exact map. Near square and background have one texture, so the network errs."""
    disparity = np.zeros((200, 260), np.float32)
    disparity[50:150, 80:180] = 1
    image = np.where(disparity > 0, noise(1, (3, 200, 260)), noise(2, (3, 200, 260)))
    found = DisparityRepair().repair(image.transpose(1, 2, 0), disparity, "auto")
    assert found.plan.shift == 0
    assert found.plan.offset == (0, 0)
    assert np.mean(found.disparity != disparity) < 0.002


@pytest.mark.slow
def test_the_repair_keeps_the_edges_of_an_accurate_map_by_plane_sweep(shared):
    """Authority: the map, accurate to less than a pixel at its edges."""
    folder = shared("real_lens/shop_seller/disparity.png").parent
    image = read_image(folder / "input.png")
    disparity = read_disparity(folder / "disparity.png")
    found = DisparityRepair().repair(image, disparity, "auto")
    assert found.plan.shift == 0
    assert found.plan.offset == (0, 0)
    near = shift_edges(disparity, 4) - shift_edges(disparity, -4) > 0.05
    assert (np.abs(found.disparity - disparity) > 0.05)[near].mean() < 0.05
