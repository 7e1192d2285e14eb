"""Recovered light of shots: steady, of the level of its frames, and equal in any part of a shot."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.light.recovery import recover_light
from bokehnet.light.temporal import REACH_FRAMES, measure_frame, steady_light, steady_sums

HEIGHT, WIDTH = 120, 180
LAMPS = ((30, 40, 2.0, 60.0), (80, 120, 3.0, 15.0))


def frame(number, gain=1.0, step=0.37):
    """A dark wall with two lamps and their halos that move by ``step`` pixels a frame, in 8 bits."""
    rng = np.random.default_rng(number)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    light = 0.006 * (1 + 0.1 * rng.standard_normal((HEIGHT, WIDTH, 1))) * np.ones(3)
    for row, column, radius, radiance in LAMPS:
        distance = np.hypot(y - row, x - column - step * number)
        glow = np.pi * radius**2 * radiance * 0.6 / (np.pi**3 * np.maximum(distance, radius + 0.5) ** 3)
        light += (np.clip(radius + 0.5 - distance, 0, 1) * radiance + glow)[..., None] * [1, 0.7, 0.4]
    codes = np.round(255 * linear_to_srgb(np.clip(gain * light, 0, 1).astype(np.float32)))
    return srgb_to_linear((codes / 255).astype(np.float32))


def shot(count, **kwargs):
    frames = {number: frame(number, **kwargs) for number in range(count)}
    sums = steady_sums({number: measure_frame(image, None) for number, image in frames.items()}, frames)
    return frames, sums


def lamp_sums(image):
    return np.array([image[:, : WIDTH // 2].sum(), image[:, WIDTH // 2 :].sum()])


def change(pictures):
    """Root mean square of the change from frame to frame of the logarithm of the light of each lamp."""
    logs = np.log([lamp_sums(image) for image in pictures])
    return float(np.sqrt((np.diff(logs, axis=0) ** 2).mean()))


def test_light_changes_less_than_the_estimate_of_each_frame_and_keeps_its_level():
    frames, sums = shot(16)
    single = [recover_light(image).image for image in frames.values()]
    steady = [steady_light(image, None, sums[number]).image for number, image in frames.items()]
    assert change(steady) < 0.25 * change(single)
    levels = [np.log([lamp_sums(image) for image in pictures]).mean() for pictures in (single, steady)]
    assert_allclose(*levels, atol=0.1)


def test_a_part_of_a_shot_has_the_light_of_the_shot():
    lights = {number: measure_frame(frame(number, step=0.1), None) for number in range(2 * REACH_FRAMES + 8)}
    whole = steady_sums(lights, lights)
    chosen = [REACH_FRAMES + 2, REACH_FRAMES + 3]
    near = range(chosen[0] - REACH_FRAMES, chosen[-1] + REACH_FRAMES + 1)
    part = steady_sums({number: lights[number] for number in near}, chosen)
    for number in chosen:
        assert_array_equal(part[number], whole[number])


@pytest.mark.parametrize("gain", [0.7, 1.4])
def test_light_follows_the_exposure(gain):
    """Formula: light is proportional to the exposure, which the unclipped wall shows."""
    first, second = measure_frame(frame(0), None), measure_frame(frame(0, gain=gain), None)
    sums = steady_sums({1: first, 2: second}, [1, 2])
    estimated, steady = (
        np.log(x) - np.log(gain) for x in (np.exp(second.recovered - first.recovered), sums[2] / sums[1])
    )
    assert np.abs(steady).max() < 0.1
    assert np.abs(steady).max() < 0.5 * np.abs(estimated).max()


def test_a_cut_ends_the_shot():
    first = measure_frame(frame(0), None)
    other = frame(0)[::-1].copy() + np.random.default_rng(2).random((HEIGHT, WIDTH, 1), np.float32) ** 8
    other[: HEIGHT // 2] *= 0.3
    second = measure_frame(np.minimum(other, 1), None)
    sums = steady_sums({1: first, 2: second}, [1])
    assert_allclose(np.log(sums[1]), first.recovered)


def test_a_frame_without_clipped_light_is_left_out():
    dark = measure_frame(np.full((HEIGHT, WIDTH, 3), 0.1, np.float32), None)
    assert dark is None
    assert 2 not in steady_sums({1: measure_frame(frame(0), None), 2: dark}, [1, 2])


def test_sums_of_another_picture_recover_nothing():
    image = frame(0)
    assert steady_light(image, None, np.ones((7, 3))).image is image
