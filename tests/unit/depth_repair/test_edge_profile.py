"""Edge profile of maps whose distance from the edges of the picture is known."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.ndimage import gaussian_filter1d

from bokehnet.depth_repair.edge_profile import sample_edges
from bokehnet.depth_repair.filters import shift_edges
from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.io.image import read_image
from bokehnet.io.maps import read_disparity
from tests.unit.depth_repair.scenes import blobs, texture, textured


def picture(truth: np.ndarray) -> np.ndarray:
    """Return a textured picture with different colours near and far, scene-linear (3, H, W)."""
    return textured(truth).transpose(2, 0, 1)


def discs(radius: float, height: int = 200, width: int = 320) -> np.ndarray:
    """Return a map of near discs with a radius in pixels, 64 pixels apart, (H, W)."""
    y, x = np.mgrid[:height, :width]
    return (np.hypot(y % 64 - 32, x % 64 - 32) < radius).astype(np.float32)


def test_depth_edges_lie_on_a_circle_with_normals_to_its_centre():
    """Authority: the equation of the circle."""
    y, x = np.mgrid[:120, :140]
    disc = 3 + 7 * (np.hypot(y - 60.3, x - 70.8) < 35).astype(np.float32)
    edges = sample_edges(np.ones((3, 120, 140), np.float32), disc)
    down, right = edges.places - np.array([[60.3], [70.8]])
    distance = np.hypot(down, right)
    assert_allclose(distance, 35, atol=0.8)
    assert abs(distance.mean() - 35) < 0.1
    inward = -(edges.normals[0] * down + edges.normals[1] * right) / distance
    assert inward.min() > 0.95
    assert_allclose(np.hypot(*edges.normals), 1, atol=1e-5)
    # A digital circle has between 8 r / sqrt(2) and 8 r pixels.
    assert 8 * 35 / np.sqrt(2) < len(edges.weights) < 8 * 35


@pytest.mark.parametrize("pixels", range(-4, 5))
def test_the_offset_equals_the_growth_of_near_discs(pixels):
    """Authority: the radius of the discs."""
    profile = sample_edges(picture(discs(24)), discs(24 + pixels)).profile()
    assert abs(profile.offset - pixels) < 0.5
    assert profile.certainty > 0.1


@pytest.mark.parametrize("scale", [-1, 0.002, 50])
def test_profiles_do_not_depend_on_the_unit_of_the_map(scale):
    """A negative scale exchanges near and far: offsets change their sign."""
    truth = blobs()
    shifted = shift_edges(truth, 2)
    plain = sample_edges(picture(truth), shifted).profile()
    scaled = sample_edges(picture(truth), (scale * shifted + 3).astype(np.float32)).profile()
    assert_allclose(scaled.offset, np.sign(scale) * plain.offset, atol=0.1)
    assert_allclose(scaled.certainty, plain.certainty, rtol=0.1)


@pytest.mark.parametrize("seed", range(4))
def test_profiles_of_pictures_without_edges_are_uncertain(seed):
    for image in (np.full((3, 200, 320), 0.4, np.float32), texture(seed)):
        assert sample_edges(image, blobs()).profile().certainty < 0.1


@pytest.mark.parametrize("pixels", [-3, 3])
def test_square_windows_move_slanted_edges_further(pixels):
    """Authority: the square's diagonal; the filter moves edges by 3 pixels along the axes."""
    truth = blobs()
    profile = sample_edges(picture(truth), shift_edges(truth, pixels)).profile()
    assert 3 - 0.5 < np.sign(pixels) * profile.offset < 3 * np.sqrt(2) + 0.5


def test_texture_on_the_near_side_alone_has_no_peak():
    """The gradient is larger everywhere inside near things."""
    truth = discs(24)
    image = np.where(truth > 0, texture(0), 0.3).astype(np.float32)
    profile = sample_edges(image, truth).profile()
    assert profile.certainty < 0.1 or abs(profile.offset) < 1


@pytest.mark.parametrize("shape", [(1, 1), (24, 400), (28, 28)])
def test_maps_without_edges_away_from_the_border_have_no_profile(shape):
    values = np.random.default_rng(0).random(shape, dtype=np.float32)
    assert sample_edges(np.ones((3, *shape), np.float32), values).profile().certainty == 0
    assert len(sample_edges(np.ones((3, 64, 64), np.float32), np.full((64, 64), 2, np.float32)).weights) == 0


def test_edges_are_selected_by_mask_and_evenly():
    mask = np.zeros((200, 320), bool)
    mask[:, :160] = True
    every = sample_edges(picture(blobs()), blobs())
    inside = sample_edges(picture(blobs()), blobs(), mask=mask)
    assert 0 < len(inside.weights) < len(every.weights)
    assert inside.places[1].max() < 161
    few = sample_edges(picture(blobs()), blobs(), 100)
    assert len(few.weights) == 100
    assert_array_equal(few.places[:, [0, -1]], every.places[:, [0, -1]])
    assert abs(few.profile().offset - every.profile().offset) < 0.5


def test_agreement_is_the_height_of_the_gradient_above_its_higher_side():
    """Authority: the closed form for a straight edge, whose pixels all have the same profile."""
    step = np.where(np.arange(96) < 48, 0.0, 1.0)
    light = np.expm1(gaussian_filter1d(step, 1.0) * np.log(21)) / 20  # encoded, it is the smooth step
    edges = sample_edges(
        np.tile(light, (3, 64, 1)).astype(np.float32), np.tile(step, (64, 1)).astype(np.float32)
    )
    distances = np.arange(-12.5, 12.6, 0.5)
    smooth = np.interp(np.arange(-13.5, 13.6, 0.5) + 47.5, np.arange(96), gaussian_filter1d(step, 1.0))
    gradient = (smooth[4:] - smooth[:-4]) / 2
    gradient /= gradient.mean() + 0.005
    middle = gradient[np.abs(distances) < 0.6].mean()
    side = gradient[(distances > 1.4) & (distances < 3.6)].mean()
    agreement, error = edges.agreement()
    assert_allclose(agreement, middle - side, rtol=2e-2)
    assert_allclose(error, 0, atol=1e-4)
    assert abs(edges.profile().offset) < 0.1  # light between pixels is interpolated before it is encoded
    assert edges.agreement(2.0)[0] < edges.agreement(1.0)[0] < agreement


@pytest.mark.slow
def test_the_repair_leaves_right_edges_between_equal_textures():
    """Authority: the exact map. Near square and background have one texture, so the network errs."""
    disparity = np.zeros((200, 260), np.float32)
    disparity[50:150, 80:180] = 1
    image = np.where(disparity > 0, texture(1, (3, 200, 260)), texture(2, (3, 200, 260)))
    result = DisparityRepair().repair(image.transpose(1, 2, 0), disparity, "auto")
    assert result.plan.shift == 0
    assert result.plan.offset == (0, 0)
    assert np.mean(result.disparity != disparity) < 0.002


@pytest.mark.slow
def test_the_repair_keeps_the_edges_of_an_accurate_map_by_plane_sweep(shared):
    """Authority: the map, accurate to less than a pixel at its edges."""
    folder = shared("real_lens/shop_seller/disparity.png").parent
    image = read_image(folder / "input.png")
    disparity = read_disparity(folder / "disparity.png")
    result = DisparityRepair().repair(image, disparity, "auto")
    assert result.plan.shift == 0
    assert result.plan.offset == (0, 0)
    near = shift_edges(disparity, 4) - shift_edges(disparity, -4) > 0.05
    assert (np.abs(result.disparity - disparity) > 0.05)[near].mean() < 0.05
