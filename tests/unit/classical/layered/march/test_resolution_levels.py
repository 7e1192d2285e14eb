"""Rays at the scale of the blur. Authority: rays at the full size with more samples, and formulas."""

import numpy as np
import pytest

from bokehnet.classical.layered.march import resolution_levels
from bokehnet.classical.layered.march.resolution_levels import MIN_RADIUS_PX, layers_halo, levels_halo
from bokehnet.classical.rays_renderer import rays
from bokehnet.io.color.srgb import linear_to_srgb

SIDE = 224


def texture(height: int, width: int, seed: int = 0) -> np.ndarray:
    """Return noise of all scales up to 16 pixels, scene-linear, (height, width, 3)."""
    rng, picture = np.random.default_rng(seed), np.full((height, width, 3), 0.05, np.float32)
    for scale in (1, 2, 4, 8, 16):
        blocks = rng.random((-(-height // scale), -(-width // scale), 3), dtype=np.float32)
        picture += 0.15 * np.repeat(np.repeat(blocks, scale, 0), scale, 1)[:height, :width]
    return picture


def post_before_wall(post: float, wall: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a picture and the defocus of a post in front of a wall, pixels."""
    image, defocus = texture(SIDE, SIDE), np.full((SIDE, SIDE), wall, np.float32)
    image[:, 90:130] = texture(SIDE, 40, 1)[..., ::-1] * np.float32([1.6, 1, 0.4])
    defocus[:, 90:130] = post
    return image, defocus


def at_full_size(monkeypatch: pytest.MonkeyPatch, image, defocus, seeds: int = 4) -> np.ndarray:
    """Return the mean of several draws at the full size."""
    with monkeypatch.context() as patch:
        patch.setattr(resolution_levels, "MAX_LEVELS", 0)
        return np.mean([rays(image, defocus, seed=seed) for seed in range(1, seeds + 1)], 0)


def rms(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.sqrt(np.mean((linear_to_srgb(first) - linear_to_srgb(second)) ** 2)))


@pytest.mark.parametrize(("post", "wall"), [(24.0, -24.0), (40.0, 20.0), (-18.0, -40.0)])
def test_smaller_sizes_differ_from_the_full_one_by_less_than_a_level(monkeypatch, post, wall):
    """Everything is blurred by 16 pixels or more: the mean of four draws is within 1/255, noise included."""
    image, defocus = post_before_wall(post, wall)
    truth = at_full_size(monkeypatch, image, defocus)
    smaller = np.mean([rays(image, defocus, seed=seed) for seed in range(1, 5)], 0)
    assert not np.array_equal(smaller, truth)
    assert rms(smaller, truth) < 1 / 255


@pytest.mark.parametrize("wall", [-60.0, 0.0])
def test_pixels_near_what_is_in_focus_are_marched_at_the_full_size(monkeypatch, wall):
    """Bits of the pixels that a sharp surface reaches do not change."""
    image, defocus = post_before_wall(0.0 if wall else 60.0, wall)
    truth = at_full_size(monkeypatch, image, defocus, seeds=1)
    result = rays(image, defocus, seed=1)
    sharp = slice(96, 124) if wall else slice(None)
    np.testing.assert_array_equal(result[:, sharp], truth[:, sharp])


def test_half_the_size_keeps_the_light_of_a_border_that_differs_from_the_picture(monkeypatch):
    """Rays that leave the picture read its border row, not the mean of the rows next to it."""
    image, defocus = post_before_wall(30.0, -30.0)
    image[0] = image[-1] = 0.9
    image[:, 0] = image[:, -1] = 0.02
    truth = at_full_size(monkeypatch, image, defocus)
    smaller = np.mean([rays(image, defocus, seed=seed) for seed in range(1, 5)], 0)
    assert rms(smaller, truth) < 1.5 / 255


@pytest.mark.parametrize(
    ("height", "width", "radius"), [(1, 1, 3.0), (2, 3, 12.0), (33, 47, 120.0), (64, 48, 40.0)]
)
def test_small_pictures_with_large_blur_equal_the_full_size(monkeypatch, height, width, radius):
    image, defocus = texture(height, width), np.full((height, width), -radius, np.float32)
    defocus[height // 3 :, : width // 2] = radius
    truth = at_full_size(monkeypatch, image, defocus)
    smaller = np.mean([rays(image, defocus, seed=seed) for seed in range(1, 5)], 0)
    assert rms(smaller, truth) < 2 / 255


def test_a_checkerboard_of_focus_and_blur_is_marched_at_the_full_size(monkeypatch):
    image = texture(96, 96)
    board = np.indices((96, 96)) // 12
    defocus = np.where(board.sum(0) % 2, 0.0, 40.0).astype(np.float32)
    truth = at_full_size(monkeypatch, image, defocus, seeds=1)
    np.testing.assert_array_equal(rays(image, defocus, seed=1), truth)


@pytest.mark.parametrize("radius", [0.0, 30.0, -30.0])
def test_one_surface_in_focus_or_all_blurred_equals_the_full_size(monkeypatch, radius):
    image, defocus = texture(64, 96), np.full((64, 96), radius, np.float32)
    truth = at_full_size(monkeypatch, image, defocus, seeds=1)
    np.testing.assert_array_equal(rays(image, defocus, seed=1), truth)


def test_halos_grow_with_the_radius():
    """No level is in use below twice the smallest blur of a level; more rows are never needed for less."""
    assert layers_halo(2 * MIN_RADIUS_PX - 1) == levels_halo(2 * MIN_RADIUS_PX - 1)
    halos = [2 * radius + layers_halo(radius) for radius in range(400)]
    assert halos == sorted(halos)
