"""Motion against shifts that are known; steady maps against the truth that noise was added to."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.ndimage import maximum_filter

from bokehnet.depth_repair.repair import DisparityRepair
from bokehnet.depth_repair.repair_plan import RepairPlan, common_plan
from bokehnet.sequence.filtered_shot import FilteredShot
from bokehnet.sequence.optical_flow import optical_flow, warp
from bokehnet.sequence.temporal_filter import REACH_FRAMES, FrameWindow


def texture(x, y):
    """A smooth pattern at any place, 0.2 to 0.8."""
    grey = 0.5 + 0.1 * (np.sin(x / 3.1 + 0.4 * np.sin(y / 7)) + np.cos(y / 4.3) + np.sin((x + y) / 5.7))
    return np.repeat(grey[..., None], 3, 2).astype(np.float32)


def places(height=64, width=96):
    y, x = np.mgrid[:height, :width].astype(np.float32)
    return x, y


@pytest.mark.parametrize("shift", [(1.0, 0.0), (2.5, -1.25), (-6.0, 3.0)])
def test_motion_of_a_known_shift_is_found_within_a_tenth_of_a_pixel(shift):
    x, y = places()
    flow = optical_flow(texture(x, y), texture(x - shift[0], y - shift[1]))
    inner = flow[10:-10, 10:-10]
    assert np.abs(inner - np.array(shift, np.float32)).max() < 0.1


def test_equal_pictures_have_no_motion_exactly():
    x, y = places()
    assert not optical_flow(texture(x, y), texture(x, y)).any()


def test_motion_of_large_pictures_has_their_size_and_unit():
    x, y = places(200, 1500)
    flow = optical_flow(texture(x / 4, y / 4), texture((x - 4) / 4, y / 4))
    assert flow.shape == (200, 1500, 2)
    assert abs(np.median(flow[40:-40, 40:-40, 0]) - 4) < 0.1


def test_following_a_motion_undoes_it():
    x, y = places()
    moved = texture(x - 3, y + 2)
    flow = np.broadcast_to(np.array([3, -2], np.float32), (64, 96, 2))
    np.testing.assert_allclose(warp(moved, flow)[4:-4, 4:-4], texture(x, y)[4:-4, 4:-4], atol=1e-6)


def shot(frames, seed=0):
    """A near square that moves over a far ground, with maps of which each has noise of its own."""
    rng, x, y = np.random.default_rng(seed), *places()
    images, maps, truth = [], [], []
    for t in range(frames):
        inside = (abs(x - 30 - t) < 12) & (abs(y - 32) < 14)
        image = np.where(inside[..., None], 1 - texture(x - t, y), 0.4 * texture(x, y)).astype(np.float32)
        true = np.where(inside, 0.8, 0.2).astype(np.float32)
        images.append(image)
        truth.append(true)
        maps.append((true + 0.02 * rng.standard_normal(true.shape)).astype(np.float32))
    return images, maps, truth


def test_steady_maps_lose_their_noise_and_keep_their_edges_where_things_move(tmp_path):
    images, maps, truth = shot(12)
    steady = FilteredShot(tmp_path)
    steady.filter(zip(images, maps, strict=True), range(12))
    for t in (0, 6, 11):
        result = steady.read(t)
        away, before = np.abs(result - truth[t]), np.abs(maps[t] - truth[t])
        # A mean of 12 draws has 1 / sqrt(12) of their deviation, a line at its ends up to twice that.
        assert np.median(away) < (0.35 if t == 6 else 0.6) * np.median(before)
        assert np.mean(away > 0.1) < 0.005  # of 24 % in the square
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json"] + [".npy"] * 12


def test_a_shot_that_is_done_is_not_read_again(tmp_path):
    images, maps, _ = shot(3)
    FilteredShot(tmp_path).filter(zip(images, maps, strict=True), range(3))

    def never():
        raise AssertionError("was read")
        yield

    FilteredShot(tmp_path).filter(never(), range(3))


CURVES = {
    "level": lambda s: 0.4 + 0 * s,
    "velocity": lambda s: 0.2 + 0.6 * s,
    "acceleration": lambda s: 0.2 + 0.6 * s**2,
    "braking": lambda s: 0.8 - 0.6 * (1 - s) ** 2,
    "rising acceleration": lambda s: 0.2 + 0.6 * s**3,
}


def filtered(folder, frames, numbers=None, selected=None):
    """The filtered maps of (picture, map) pairs, by number."""
    numbers = range(len(frames)) if numbers is None else numbers
    steady = FilteredShot(folder)
    steady.filter(frames, numbers, selected=selected)
    return {n: steady.read(n) for n in (numbers if selected is None else selected)}


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("count", [1, 2, 3, 5, 12, 60])
def test_smooth_motion_in_depth_without_noise_passes_unchanged(tmp_path, curve, count):
    """Authority: the maps themselves, to the rounding of float32."""
    picture, inside = texture(*places(24, 32)), np.zeros((24, 32), bool)
    inside[6:18, 8:24] = True
    times = np.arange(count) / max(count - 1, 1)
    maps = [np.where(inside, CURVES[curve](s), 0.1).astype(np.float32) for s in times]
    kept = filtered(tmp_path, [(picture, values) for values in maps])
    assert max(np.abs(kept[t] - maps[t]).max() for t in range(count)) < 2.5e-7


def test_motion_that_starts_and_stops_softly_passes_almost_unchanged(tmp_path):
    """Authority: the maps, half a cosine over 40 frames: not a polynomial."""
    picture = texture(*places(24, 32))
    maps = [np.full((24, 32), 0.5 - 0.3 * np.cos(np.pi * t / 39), np.float32) for t in range(40)]
    kept = filtered(tmp_path, [(picture, values) for values in maps])
    assert max(np.abs(kept[t] - maps[t]).max() for t in range(40)) < 1e-5


def test_noise_is_taken_from_motion(tmp_path):
    """Authority: the variance of a line fitted to 49 frames, 1/49 in the middle, under noise of one."""
    rng, picture = np.random.default_rng(3), texture(*places(24, 32))
    truth = [np.full((24, 32), 0.2 + 0.01 * t, np.float32) for t in range(60)]
    maps = [(values + 0.01 * rng.standard_normal(values.shape)).astype(np.float32) for values in truth]
    kept = filtered(tmp_path, [(picture, values) for values in maps])
    assert np.std(kept[30] - truth[30]) < 1.3 * 0.01 / np.sqrt(49)


@pytest.mark.slow  # in the quick tests: test_parts_of_a_shot_have_its_frames, by the command line
def test_a_part_of_a_shot_with_its_surroundings_has_the_maps_of_the_whole(tmp_path):
    """Authority: the whole shot, bit by bit."""
    images, maps, _ = shot(60)
    frames = list(zip(images, maps, strict=True))
    whole = filtered(tmp_path / "whole", frames)
    for first, last in ((0, 6), (25, 31), (53, 59)):
        read = range(max(0, first - REACH_FRAMES), min(59, last + REACH_FRAMES) + 1)
        part = filtered(
            tmp_path / f"{first}", [frames[t] for t in read], read, selected=range(first, last + 1)
        )
        assert len(part) == 7
        assert all(part[t].tobytes() == whole[t].tobytes() for t in part)


def test_equal_frames_keep_their_map_to_the_last_bit(tmp_path):
    images, _, truth = shot(1)
    steady = FilteredShot(tmp_path)
    steady.filter([(images[0], truth[0])] * 5, range(5))
    assert {steady.read(t).tobytes() for t in range(5)} == {truth[0].tobytes()}


def test_an_edge_that_jumps_has_no_slope(tmp_path):
    """Authority: the deviation of a mean of the draws with the weights of the filter."""
    rng, picture = np.random.default_rng(2), np.full((32, 32, 3), 128, np.uint8)
    draws = rng.choice([0.2, 0.8], (41, 32, 32)).astype(np.float32)
    window = FrameWindow(tmp_path, (32, 32))
    for number, values in enumerate(draws):
        window.add(number, picture, values)
    weights = 1 - (np.arange(-20, 21) / (REACH_FRAMES + 1)) ** 2
    expected = 0.3 * np.sqrt(np.square(weights).sum()) / weights.sum()
    assert np.std(window.filtered(20).values - 0.5) < 1.2 * expected


@pytest.mark.parametrize("speed", [0.4, 2.3])
def test_edges_stay_where_things_move_by_parts_of_a_pixel(tmp_path, speed):
    """Mixed from frame to frame by bilinear interpolation, 1.1 % of the pixels would be wrong."""
    rng, x, y = np.random.default_rng(0), *places()
    images, maps, truth = [], [], []
    for t in range(12):
        places_within = [(i + 0.5) / 8 - 0.5 for i in range(8)]
        covered = np.mean([(abs(x + d - 30 - speed * t) < 12) & (abs(y - 32) < 14) for d in places_within], 0)
        light = covered[..., None] * (1 - texture(x - speed * t, y)) + (
            1 - covered[..., None]
        ) * 0.4 * texture(x, y)
        true = np.where(covered > 0.5, 0.8, 0.2).astype(np.float32)
        images.append(light.astype(np.float32))
        truth.append(true)
        maps.append((true + 0.02 * rng.standard_normal(true.shape)).astype(np.float32))
    steady = FilteredShot(tmp_path)
    steady.filter(zip(images, maps, strict=True), range(12))
    assert np.mean([np.abs(steady.read(t) - truth[t]) > 0.1 for t in range(12)]) < 0.009


def test_a_cut_forgets_what_was_before(tmp_path):
    """Authority: each shot alone, six frames of noise about another level."""
    rng, (x, y) = np.random.default_rng(0), places(32, 32)
    pictures = [0.3 * texture(x, y)] * 6 + [1 - 0.3 * texture(x, y)] * 6
    maps = [(t // 6 + 0.01 * rng.standard_normal((32, 32))).astype(np.float32) for t in range(12)]
    kept = filtered(tmp_path, list(zip(pictures, maps, strict=True)))
    for t in (5, 6):
        assert np.abs(np.median(kept[t]) - t // 6) < 0.005


def test_a_plan_is_what_most_maps_ask_for():
    plans = [RepairPlan(repaired=x != 3, softness=x / 10, shift=x, offset=(2 * x, -x)) for x in (1, 3, 0)]
    assert common_plan(plans) == RepairPlan(repaired=True, softness=0.1, shift=1, offset=(2, -1))


def test_the_repair_follows_a_given_plan():
    """A map that stands right stays although the shot is repaired; a wrong one stays where the shot stays."""
    images, _, truth = shot(1)
    repair = DisparityRepair()
    wrong = maximum_filter(truth[0], 7, mode="nearest")
    plan = repair.repair(images[0], wrong, "auto").plan
    assert plan.repaired
    assert repair.repair(images[0], wrong, "auto", plan=plan).repaired
    right = repair.repair(images[0], truth[0], "auto", plan=replace(plan, shift=0, local_shift=plan.shift))
    assert_array_equal(right.disparity, truth[0])
    still = repair.repair(images[0], wrong, "auto", plan=replace(plan, repaired=False))
    assert_array_equal(still.disparity, wrong)
    assert (still.repaired, still.plan) == (False, replace(plan, repaired=False))
