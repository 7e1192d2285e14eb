"""Grain: mean, variance and correlation as stated, and the same however a picture is cut."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ParameterError
from bokehnet.optics.grain import Grain, white_noise

SIDE = 600
COUNT = SIDE * SIDE


def grey(light):
    return np.full((SIDE, SIDE, 3), light, np.float64)


@pytest.mark.parametrize("light", [0.0, 0.02, 0.18, 1.0, 20.0])
def test_mean_stays_and_variance_is_that_of_a_counting_sensor(light):
    """Oracle: electrons counted by Poisson and read with a normal error, from NumPy's own generator."""
    grain = Grain(iso=3200, size=0)
    rng = np.random.default_rng(1)
    counted = rng.poisson(light * grain.white, COUNT) + rng.normal(0, grain.read_noise, COUNT)
    added = grain.add(grey(light))[..., 0] - light
    deviation = math.sqrt(grain.variance(light))
    assert abs(added.mean()) < 4 * deviation / SIDE
    assert added.var() == pytest.approx((counted / grain.white).var(), rel=0.015)
    assert added.var() == pytest.approx(light / 1562.5 + (3 / 1562.5) ** 2, rel=0.01)


@pytest.mark.parametrize("size", [0.0, 0.5, 1.0, 2.0, 5.0])
def test_the_variance_does_not_depend_on_the_size(size):
    noise = Grain(iso=100, size=size).noise(SIDE, SIDE, 1)
    assert noise.dtype == np.float32
    assert noise.mean() == pytest.approx(0, abs=4 * max(2 * size, 1) / SIDE)
    assert noise.var() == pytest.approx(1, rel=0.01 * max(2 * size, 1))


@pytest.mark.parametrize("size", [2.0, 5.0])
def test_pixels_correlate_as_stated(size):
    """Authority: a Gaussian of deviation s correlates by exp(-d^2 / 4 s^2), in all directions."""
    noise = Grain(iso=100, size=size).noise(SIDE, SIDE, 3)
    for dx, dy in ((1, 0), (0, 2), (2, 2), (round(size), 0), (3 * round(size), 0)):
        first, second = noise[: SIDE - dy, : SIDE - dx], noise[dy:, dx:]
        expected = math.exp(-(dx * dx + dy * dy) / size**2)
        assert (first * second).mean() == pytest.approx(expected, abs=0.01 * size)


def test_small_grain_correlates_less_by_the_documented_factor():
    """Arithmetic for size 1: sum of exp(-2 k^2 - 2 (k + 1)^2) over sum of exp(-4 k^2) = 0.261."""
    noise = Grain(iso=100, size=1.0).noise(SIDE, SIDE, 3)
    assert (noise[:, 1:] * noise[:, :-1]).mean() == pytest.approx(0.261, abs=0.006)
    fine = Grain(iso=100, size=0.0).noise(SIDE, SIDE, 3)
    assert (fine[:, 1:] * fine[:, :-1]).mean() == pytest.approx(0, abs=0.005)


def test_noise_is_normal_and_channels_have_their_own():
    """Fourth moment of the normal distribution: 3; correlation of channels: 0, or 1 in monochrome."""
    noise = Grain(iso=100, size=0).noise(SIDE, SIDE, 3).astype(float)
    assert (noise**4).mean() == pytest.approx(3, abs=0.05)
    assert (noise**3).mean() == pytest.approx(0, abs=0.02)
    for first, second in ((0, 1), (1, 2), (0, 2)):
        assert (noise[..., first] * noise[..., second]).mean() == pytest.approx(0, abs=4 / SIDE)
    equal = Grain(iso=100, monochrome=True).noise(20, 20, 3)
    assert_array_equal(equal[..., 0], equal[..., 2])
    assert equal.std() > 0.5


@pytest.mark.parametrize("size", [0.0, 1.3, 6.0])
def test_a_cut_picture_gets_the_same_bits(size):
    grain = Grain(iso=1600, size=size)
    image = np.random.default_rng(0).random((50, 70, 3), dtype=np.float32)
    whole = grain.add(image, left=-3, top=7, frame=2)
    part = grain.add(image[13:29, 31:52], left=28, top=20, frame=2)
    assert_array_equal(part, whole[13:29, 31:52])


def test_seeds_frames_and_channels_differ_and_come_back():
    keys = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2**64 - 1, 0, 0)]
    fields = [white_noise(200, 200, key=key) for key in keys]
    for i, first in enumerate(fields):
        assert_array_equal(first, white_noise(200, 200, key=keys[i]))
        for second in fields[i + 1 :]:
            assert abs((first * second).mean()) < 4 / 200


def test_neighbours_and_mirrored_places_are_unlike():
    """Coordinates below 0 and swapped ones must not share a hash."""
    noise = white_noise(201, 201, left=-100, top=-100)
    for other in (noise[::-1], noise[:, ::-1], noise.T, np.roll(noise, 1, 0), np.roll(noise, 64, 1)):
        same = noise == other
        assert same.mean() < 0.01  # but for the axis of the mirror
        assert abs((noise * other)[~same].mean()) < 4.5 / 201


def test_grain_grows_from_nothing():
    """Continuous in the ISO, also at 0: in the light the deviation goes with its root."""
    image = grey(0.2)[:40, :40]
    changes = [np.abs(Grain(iso=iso).add(image) - image).max() for iso in (1e-8, 1e-4, 1.0)]
    assert changes[0] < 1e-6
    assert changes[1] == pytest.approx(changes[2] / 100, rel=0.05)


def test_size_is_continuous():
    """Halving a step halves what it changes, also where the kernel gets longer."""
    image = np.full((30, 30, 3), 0.2)
    for start in (0.0, 0.4, 0.99, 2.0, 3.2):
        before = Grain(iso=1e4, size=start).add(image)
        changes = [
            np.abs(Grain(iso=1e4, size=start + step).add(image) - before).max() for step in (0.02, 0.01)
        ]
        assert changes[0] < 0.02
        assert changes[1] < 0.6 * changes[0] + 1e-6


def test_where_nothing_is_nothing_comes():
    """Alpha 0 and no light: no noise; half of it: light's share, and half of the reading."""
    grain = Grain(iso=3200, size=0)
    image, alpha = grey(0.0), np.zeros((SIDE, SIDE, 1))
    assert_array_equal(grain.add(image, alpha), 0)
    halved = grain.add(image, alpha + 0.5)
    assert halved.std() == pytest.approx(0.5 * grain.read_noise / grain.white, rel=0.01)


def test_gradients_of_the_picture():
    """Oracle: finite differences, by gradcheck, with black and light below 0."""
    rng = np.random.default_rng(0)
    image = torch.from_numpy(rng.uniform(0.05, 1, (2, 3, 3))).requires_grad_()
    assert torch.autograd.gradcheck(Grain(iso=3200).add, (image,))
    dark = torch.tensor([[[-0.1, 0.0, 1e-9]]], dtype=torch.float64, requires_grad=True)
    Grain(iso=3200).add(dark).sum().backward()
    assert torch.isfinite(dark.grad).all()
    Grain(iso=3200).add(dark, torch.zeros(1, 1, 1)).sum().backward()
    assert torch.isfinite(dark.grad).all()
    assert_allclose(
        Grain(iso=3200).add(image).detach().numpy(), Grain(iso=3200).add(image.detach().numpy()), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"iso": 0}, "iso: expected above 0"),
        ({"iso": math.nan}, "iso"),
        ({"iso": 1e308}, "iso: expected noise that is small enough"),
        ({"size": 51}, "size: expected 0 to 50"),
        ({"size": math.nan}, "size"),
        ({"seed": -1}, "seed: expected at least 0"),
        ({"full_well": 0}, "full_well"),
        ({"read_noise": 0}, "read_noise: expected at least 0.1"),
    ],
)
def test_a_number_out_of_range_is_reported(numbers, message):
    with pytest.raises(ParameterError, match=message):
        Grain(**{"iso": 100, **numbers})
