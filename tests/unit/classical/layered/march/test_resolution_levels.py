"""Rays at the scale of the blur. Authority: rays at the full size with more samples, and formulas."""

import numpy as np
import pytest

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical import rays_renderer
from bokehnet.classical.layered.march import resolution_levels
from bokehnet.classical.layered.march.aberrated_rays import lens_table
from bokehnet.classical.layered.march.bundle_extents import LEVELS, bundle_extents, sharp_limits
from bokehnet.classical.layered.march.resolution_levels import (
    MIN_RADIUS_PX,
    layers_halo,
    levels_halo,
    march_levels,
)
from bokehnet.classical.rays_renderer import pupil_pattern, rays
from bokehnet.io.color.srgb import linear_to_srgb
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.aberrations.sliders import AberrationSliders
from bokehnet.optics.aperture import Aperture

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


def lens_with(**sliders: float) -> LensResponse:
    return LensResponse(aberration_map=AberrationSliders(**sliders).aberration_map())


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
    """Bits of the pixels that another surface at the right border does not reach, where its rays run."""
    image, defocus = texture(64, 256), np.full((64, 256), radius, np.float32)
    defocus[:, 240:] = radius + 8.0
    calls = []

    def counted(*arguments, **keywords):
        calls.append(arguments)
        march_levels(*arguments, **keywords)

    monkeypatch.setattr(rays_renderer, "march_levels", counted)
    truth = at_full_size(monkeypatch, image, defocus, seeds=1)
    result = rays(image, defocus, seed=1)
    assert len(calls) == 2
    assert np.array_equal(result, truth) == (radius == 0)
    np.testing.assert_array_equal(result[:, :96], truth[:, :96])


def test_halos_grow_with_the_radius():
    """No level is in use below twice the smallest blur of a level; more rows are never needed for less."""
    assert layers_halo(2 * MIN_RADIUS_PX - 1) == levels_halo(2 * MIN_RADIUS_PX - 1)
    halos = [2 * radius + layers_halo(radius) for radius in range(400)]
    assert halos == sorted(halos)


@pytest.mark.parametrize("field_curvature", [0.0, 3.0])
def test_smaller_sizes_behind_an_aberrated_lens_differ_by_less_than_a_level(monkeypatch, field_curvature):
    """Spherical aberration and coma of some pixels, and a curved field; four draws each, noise included."""
    lens = lens_with(spherical=1.0, coma=1.0, field_curvature=field_curvature)
    image, defocus = post_before_wall(60.0, -60.0)
    with monkeypatch.context() as patch:
        patch.setattr(resolution_levels, "MAX_LEVELS", 0)
        truth = np.mean([rays(image, defocus, lens_response=lens, seed=seed) for seed in range(1, 5)], 0)
    smaller = np.mean([rays(image, defocus, lens_response=lens, seed=seed) for seed in range(1, 5)], 0)
    assert not np.array_equal(smaller, truth)
    assert rms(smaller, truth) < 1 / 255


def test_pixels_to_which_a_curved_field_brings_a_surface_into_focus_have_limits_above_its_blur():
    """Authority: the extent of traced rays, which is smaller than the limit at some defocus of each block."""
    points, _, chances = pupil_pattern(Aperture())
    lens = lens_table(lens_with(field_curvature=4.0), Viewport.whole(640, 960), chances)
    extents = bundle_extents(points, lens)
    _, aberration = lens.footprint
    assert aberration > 4
    smallest = 6.0 + 0.5 * aberration
    limits = sharp_limits((40, 60), 12.0, side=16, largest=80.0, extents=extents, lens=lens, above=0)
    is_sharp = smallest < limits.radii[limits.rings]
    assert is_sharp[0, 0]
    assert is_sharp[-1, -1]
    assert not is_sharp.all()
    rows, columns = (16 * np.arange(count) + 7.5 for count in is_sharp.shape)
    field = lens.scale * np.hypot(rows[:, None] - lens.row, columns - lens.column)
    rings = (field * (len(extents) - 1)).astype(int)
    levels = np.arange(-LEVELS, LEVELS + 1)
    focused = np.array([(extents[ring, :-1] < 12.0) & (np.abs(levels) >= smallest) for ring in rings.ravel()])
    assert 0 < focused.any(1).sum() < focused.shape[0]
    assert is_sharp.ravel()[focused.any(1)].all()
    assert (limits.reaches >= 12.0).all()


def test_limits_of_a_strip_are_those_of_its_rows_in_the_picture():
    points, _, chances = pupil_pattern(Aperture())
    lens = lens_table(lens_with(field_curvature=4.0, coma=2.0), Viewport.whole(640, 960), chances)
    keywords = {"side": 16, "largest": 80.0, "extents": bundle_extents(points, lens), "lens": lens}
    whole, strip = (sharp_limits((rows, 60), 12.0, above=16 * (40 - rows), **keywords) for rows in (40, 16))
    np.testing.assert_array_equal(strip.rings, whole.rings[24:])
    np.testing.assert_array_equal(strip.radii, whole.radii)
    np.testing.assert_array_equal(strip.reaches, whole.reaches)


def test_limits_of_a_lens_without_aberrations_are_those_of_a_perfect_one():
    points, _, chances = pupil_pattern(Aperture())
    lens = lens_table(LensResponse(), Viewport.whole(320, 480), chances)
    extents = bundle_extents(points, lens)
    limits = sharp_limits((20, 30), 12.0, side=16, largest=40.0, extents=extents, lens=lens, above=0)
    np.testing.assert_array_equal(limits.radii, 12.0)
    assert (limits.reaches >= 12).all()
    assert (limits.reaches < 14).all()
