"""Authorities: a disc's segment area for a half-plane, and pictures that must not change."""

import math

import numba
import numpy as np
import pytest

from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.rays_renderer import rays, render_rays
from bokehnet.classical.scatter_renderer import scatter_inside as scatter
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.optics.aperture import Aperture

FRONT, BACK = np.array([0.9, 0.2, 0.1], np.float32), np.array([0.1, 0.3, 0.8], np.float32)
SIZE, EDGE = 96, 48


def half_plane(front, back, size=SIZE):
    """The left half of the picture stands in front of the right one; defocus and plain colours."""
    left = np.arange(size) < size // 2
    image = np.where(left[None, :, None], FRONT, BACK).astype(np.float32)
    defocus = np.where(left, front, back).astype(np.float32)
    return np.repeat(image, size, 0), np.repeat(defocus[None], size, 0)


def segment(t):
    """Share of a unit disc on one side of a line at distance t from its centre (circular segment)."""
    t = np.clip(t, -1, 1)
    return 0.5 + (t * np.sqrt(1 - t * t) + np.arcsin(t)) / math.pi


def rms(a, b):
    return float(np.sqrt(np.mean((a - b) ** 2)))


@pytest.mark.parametrize("back", [0.0, -8.0, 5.0])
def test_a_blurred_foreground_covers_by_its_segment(back):
    radius = 14.0
    image, defocus = half_plane(radius, back)
    share = segment((EDGE - 0.5 - np.arange(SIZE)) / radius)[None, :, None]
    expected = np.broadcast_to(share * FRONT + (1 - share) * BACK, image.shape)
    picture = rays(image, defocus)
    assert rms(picture, expected) < 0.006
    assert rms(scatter(image, defocus), expected) > 2 * rms(picture, expected)


def test_a_sharp_foreground_keeps_its_edge_before_blur():
    """The outline of this picture went through no pixel filter, which is reckoned with: 2 % are left."""
    image, defocus = half_plane(0.0, -14.0)
    assert np.abs(rays(image, defocus) - image).max() < 0.02
    assert np.abs(scatter(image, defocus) - image).max() > 0.1


def test_without_gaps_it_is_the_scatter():
    rng = np.random.default_rng(0)
    image = rng.random((40, 60, 3), dtype=np.float32)
    defocus = np.repeat(np.linspace(-6, 6, 60, dtype=np.float32)[None], 40, 0)
    inner = np.s_[6:-6, 6:-6]
    np.testing.assert_allclose(rays(image, defocus)[inner], scatter(image, defocus)[inner], rtol=1e-5)


@pytest.mark.parametrize("aperture", [Aperture(), Aperture(blades=5, cats_eye=0.8, spherical_profile=0.5)])
def test_one_colour_stays_one_colour(aperture):
    rng = np.random.default_rng(1)
    defocus = np.kron(rng.uniform(-15, 15, (6, 8)), np.ones((8, 8))).astype(np.float32)
    image = np.full((48, 64, 3), (0.2, 0.5, 3.0), np.float32)
    np.testing.assert_allclose(rays(image, defocus, aperture=aperture), image, rtol=2e-5)


def test_a_steep_slope_does_not_leak():
    """A slope of 0.9 a pixel over something bright behind it: none of the bright shows."""
    image = np.full((40, 80, 3), 0.2, np.float32)
    defocus = np.repeat((0.9 * np.arange(80) - 36).astype(np.float32)[None], 40, 0)
    image[:, 60:], defocus[:, 60:] = 0.2, -36.0  # a depth discontinuity, so that rays run
    layers = Layers(
        colors=np.stack([image, np.full_like(image, 5.0)], 2),
        defocus=np.stack([defocus, np.full_like(defocus, -36.5)], 2),
        coverage=np.ones((*defocus.shape, 2)),
    )
    picture = rays(image, defocus, layers=layers)
    np.testing.assert_allclose(picture[:, 5:20], 0.2, rtol=1e-4)


@pytest.mark.parametrize("gap", [0.4, 5.0])
def test_veils_one_behind_the_other_let_through_what_each_leaves(gap):
    """Authority: "over". Blades of grass, a third of each pixel, close to each other or not."""
    _, defocus = half_plane(6.0, -6.0)
    depths = np.float32([6.0, 6.0 - gap, 6.0 - 2 * gap, -6.0])
    shares = np.float32([1 / 3, 1 / 3, 1 / 3, 1])
    colors = np.float32([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]])
    rng = np.random.default_rng(3)
    sway = rng.uniform(-0.15, 0.15, (SIZE, SIZE, 1)).astype(np.float32)  # no two pixels at the same depth
    layers = Layers(
        colors=np.broadcast_to(colors, (SIZE, SIZE, 4, 3)),
        defocus=depths + sway,
        coverage=np.broadcast_to(shares, (SIZE, SIZE, 4)),
    )
    through = np.cumprod([1, *(1 - shares[:-1])])
    picture = rays(np.zeros((SIZE, SIZE, 3), np.float32), defocus, layers=layers)[24:-24, EDGE - 4 : EDGE + 4]
    assert np.abs(picture.mean(axis=(0, 1)) - (through * shares) @ colors).max() < 0.03


def test_true_layers_show_the_true_background():
    radius = 14.0
    image, defocus = half_plane(radius, 0.0)
    hidden = np.array([0.0, 1.0, 0.0], np.float32)
    behind = np.where(np.arange(SIZE)[None, :, None] < EDGE, hidden, BACK)
    layers = Layers(
        colors=np.stack([image, np.broadcast_to(behind, image.shape)], 2),
        defocus=np.stack([defocus, np.zeros_like(defocus)], 2),
        coverage=np.ones((SIZE, SIZE, 2)),
    )
    share = segment((EDGE - 0.5 - np.arange(SIZE)) / radius)[None, :, None]
    expected = share * FRONT + (1 - share) * behind
    assert rms(rays(image, defocus, layers=layers), np.broadcast_to(expected, image.shape)) < 0.008


def test_two_seeds_differ_by_little_noise_and_equal_seeds_do_not():
    rng = np.random.default_rng(2)
    image, defocus = half_plane(12.0, -9.0)
    image = image * rng.uniform(0.5, 1.5, image.shape).astype(np.float32)
    first = rays(image, defocus)
    np.testing.assert_array_equal(first, rays(image, defocus))
    assert 0 < rms(first, rays(image, defocus, seed=1)) < 10 ** (-40 / 20)


def test_any_number_of_threads_gives_the_same_bits():
    rng = np.random.default_rng(3)
    image = rng.random((70, 90, 3), dtype=np.float32)
    image[20, 30] = 300.0
    defocus = np.kron(rng.uniform(-15, 15, (7, 9)), np.ones((10, 10))).astype(np.float32)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = rays(image, defocus)
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(one, rays(image, defocus))


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (3, 2)])
def test_small_pictures(size):
    rng = np.random.default_rng(4)
    image = rng.random((*size, 3), dtype=np.float32)
    picture = rays(image, rng.uniform(-50, 50, size).astype(np.float32))
    assert picture.shape == image.shape
    assert np.isfinite(picture).all()
    assert picture.min() >= image.min() - 1e-5
    assert picture.max() <= image.max() + 1e-5


def test_blur_far_beyond_the_picture_is_fine():
    image, defocus = half_plane(1e7, -300.0, size=40)
    picture = rays(image, defocus)
    assert np.isfinite(picture).all()
    assert picture.min() >= image.min() - 1e-4
    assert picture.max() <= image.max() + 1e-4


def test_strips_leave_no_seam(monkeypatch):
    rng = np.random.default_rng(5)
    image = rng.random((60, 50, 3), dtype=np.float32)
    defocus = np.kron(rng.uniform(-9, 9, (6, 5)), np.ones((10, 10))).astype(np.float32)
    whole = rays(image, defocus)
    monkeypatch.setattr("bokehnet.classical.layered.march.ray_marching._STRIP", 13)
    np.testing.assert_array_equal(whole, rays(image, defocus))


def test_an_aperture_picture_is_upright_behind_focus_and_turned_before_it():
    """The light comes from one half of the opening alone, so the blur moves to that half's side."""
    half = np.zeros((8, 8), np.float32)
    half[:, 4:] = 1.0
    for front in (12.0, -12.0):
        image, defocus = np.zeros((64, 64, 3), np.float32), np.full((64, 64), -30.0, np.float32)
        image[30:34, 30:34], defocus[20:44, 20:44] = 1.0, front
        picture = rays(image, defocus, aperture=Aperture(picture=half))[..., 0]
        centre = (picture * np.arange(64)).sum() / picture.sum() - 31.5
        assert centre * np.sign(front) < -3.0


def test_bad_input_is_refused():
    image, defocus = half_plane(3.0, -3.0)
    with pytest.raises(ShapeError):
        rays(image, defocus[1:])
    with pytest.raises(ParameterError, match="defocus"):
        rays(image, np.full_like(defocus, np.inf))
    small = Layers(
        colors=image[:50, :, None], defocus=defocus[:50, :, None], coverage=np.ones((50, SIZE, 1), np.float32)
    )
    with pytest.raises(ShapeError, match="image is 96x96 pixels but layers is 96x50"):
        rays(image, defocus, layers=small)


def test_the_renderer_gives_the_error_map_too():
    result = render_rays(*half_plane(6.0, 0.0))
    assert result.error_map[:, EDGE].min() == 1.0
    assert result.error_map[:, 0].max() == 0.0


def test_the_disocclusion_weight_is_the_share_of_the_occluded_background():
    """Beside a blurred half-plane nothing hidden shows; under it, what the disc's segment leaves does."""
    radius = 14.0
    result = render_rays(*half_plane(radius, 0.0))
    middle = np.s_[40:56]
    share = segment((EDGE - 0.5 - np.arange(SIZE)) / radius)
    assert np.abs(result.disocclusion_weight[middle, EDGE + 2 : EDGE + 12]).max() < 0.01
    np.testing.assert_allclose(
        result.disocclusion_weight[middle, EDGE - 12 : EDGE - 2].mean(0),
        1 - share[EDGE - 12 : EDGE - 2],
        atol=0.02,
    )
    np.testing.assert_allclose(
        result.occluded_background[middle, EDGE - 8 : EDGE - 2], np.broadcast_to(BACK, (16, 6, 3)), atol=2e-3
    )
    np.testing.assert_array_equal(
        result.features, np.dstack([result.occluded_background, result.disocclusion_weight, result.error_map])
    )


def test_light_from_beyond_the_border_is_guessed():
    """At the upper border half of each disc of the foreground lies outside the picture."""
    radius = 10.0
    image, defocus = half_plane(radius, 0.0)
    disocclusion_weight = render_rays(image, defocus).disocclusion_weight
    column = disocclusion_weight[:, EDGE - 4]
    assert column[0] > column[SIZE // 2] + 0.3
