"""The gathers of thesis 004 against their listings, written out in plain Python."""

import math

import numpy as np
import pytest

from bokehnet.baselines import gather_basic, gather_bokeh, gather_passes, gather_spiral
from bokehnet.baselines.apertures import ANGLES, outline, psf_image
from bokehnet.baselines.gather.basic_gather import random_number
from bokehnet.baselines.gather.bokeh_gather import squeeze_cats_eye
from bokehnet.baselines.gather.half_size import doubled, extreme_of_four, halved
from bokehnet.baselines.gather.spiral import spiral
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.optics.aperture import Aperture

# Methods of the literature, which no default uses: their kernels are compiled for the tests.
pytestmark = pytest.mark.slow


def scene(height=18, width=22):
    rng = np.random.default_rng(3)
    image = rng.random((height, width, 3)).astype(np.float32)
    defocus = np.full((height, width), -2.5, np.float32)
    defocus[5:12, 6:14] = 3.5
    defocus[:, 16:] = 0.2
    return image, defocus


def texel(image, y, x):
    height, width = image.shape[:2]
    row, column = math.floor(y + 0.5), math.floor(x + 0.5)
    return image[min(max(row, 0), height - 1), min(max(column, 0), width - 1)].astype(float)


def test_random_numbers_are_uniform():
    numbers = np.array([random_number(x, y, k) for x in range(40) for y in range(40) for k in range(8)])
    assert abs(numbers.mean() - 0.5) < 0.01
    assert abs(np.histogram(numbers, 16)[0] / len(numbers) - 1 / 16).max() < 0.005


def test_basic_gather_is_the_first_listing_with_its_mean_corrected():
    image, defocus = scene()
    expected = np.zeros(image.shape)
    for y, x in np.ndindex(defocus.shape):
        color = image[y, x].astype(float)
        for i in range(32):
            ang = 2 * math.pi * random_number(x, y, 2 * i)
            length = math.sqrt(random_number(x, y, 2 * i + 1)) * defocus[y, x]
            color = color + texel(image, y - length * math.sin(ang), x - length * math.cos(ang))
        expected[y, x] = color / 33
    assert np.abs(gather_basic(image, defocus, samples=32) - expected).max() < 1e-5


def test_advanced_gather_is_the_second_listing():
    image, defocus = scene()
    rad_scale, largest = 0.7, np.abs(defocus).max()
    expected = np.zeros(image.shape)
    for y, x in np.ndindex(defocus.shape):
        center = float(defocus[y, x])
        color, steps, radius, ang = image[y, x].astype(float), 1.0, rad_scale, 0.0
        while radius < largest:
            at = y + math.sin(ang) * radius, x + math.cos(ang) * radius
            sample = float(texel(defocus, *at))
            blur = abs(sample)
            if sample < center:  # farther away
                blur = min(max(blur, 0.0), 2 * abs(center))
            t = min(max(blur - (radius - 0.5), 0.0), 1.0)
            m = t * t * (3 - 2 * t)
            color = color + (color / steps) * (1 - m) + texel(image, *at) * m
            steps += 1.0
            radius += rad_scale / radius
            ang += 2.39996323
        expected[y, x] = color / steps
    result = gather_spiral(image, defocus, scale=rad_scale)
    assert np.mean(np.abs(result - expected).max(axis=2) > 1e-4) < 0.02  # a place on the border of two texels


def test_the_spiral_gives_each_sample_the_same_area():
    points = spiral(60.0, 0.5)
    assert len(points) == pytest.approx(60**2 / (2 * 0.5), rel=0.01)
    inside = np.count_nonzero(points[:, 1] < 30)
    assert inside == pytest.approx(len(points) / 4, rel=0.02)


@pytest.mark.parametrize("blades", [3, 5, 6, 8])
def test_outlines_are_equation_2_2(blades):
    """A corner at angle 0 there; ours have an edge on the left, the third listing one on the right."""
    angle = np.arange(ANGLES) * 2 * math.pi / ANGLES
    edge = math.pi / blades
    expected = math.cos(edge) / np.cos((angle - math.pi + edge) % (2 * edge) - edge)
    assert np.abs(outline(Aperture(blades=blades)) - expected).max() < 2e-3
    listing = math.cos(edge) / np.cos(angle - 2 * edge * np.floor((blades * angle + math.pi) / 2 / math.pi))
    assert np.abs(outline(Aperture(blades=blades, rotation=180)) - listing).max() < 2e-3


def test_squeezing_is_the_three_matrices_of_the_listing():
    def turn(angle):
        return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

    rng = np.random.default_rng(1)
    for across, down, column, row in rng.normal(size=(20, 4)):
        angle = math.atan2(row, column)
        squeeze = turn(angle) @ np.diag([1.0 - 0.3, 1.0]) @ turn(-angle)
        assert squeeze_cats_eye(across, down, column, row, 0.3) == pytest.approx(
            tuple(squeeze @ (across, down))
        )
    assert squeeze_cats_eye(0.4, 0.2, 0.0, 0.0, 0.3) == (0.4, 0.2)


def test_bokeh_gather_is_its_description():
    image, defocus = scene()
    samples, aperture = 40, Aperture(cats_eye=0.8)
    height, width = defocus.shape
    largest = dilated_tiles(defocus, 32)[1][0, 0]
    area = math.pi * largest**2 / samples
    expected = np.zeros(image.shape)
    for y, x in np.ndindex(height, width):
        center = defocus[y, x]
        total = min(area / (math.pi * max(abs(center), 0.5) ** 2), 1)
        color = total * image[y, x].astype(float)
        away = np.array([x - (width - 1) / 2, y - (height - 1) / 2])
        narrower = 0.5 * 0.8 * 2 * np.hypot(*away) / math.hypot(width, height)
        for k in range(1, samples + 1):
            ang, rho = k * math.pi * (3 - math.sqrt(5)), math.sqrt(k / samples)
            p = rho * np.array([math.cos(ang), math.sin(ang)])
            p = p - narrower * (p @ away) * away / max(away @ away, 1e-12)
            sample = texel(defocus, y + largest * p[1], x + largest * p[0])
            blur = min(abs(sample), abs(center)) if sample < center else abs(sample)
            weight = min(max(blur - largest * rho + 0.5, 0), 1)
            weight *= min(area / (math.pi * max(blur, 0.5) ** 2), 1)
            color = color + weight * texel(image, y + largest * p[1], x + largest * p[0])
            total += weight
        expected[y, x] = color / total
    result = gather_bokeh(image, defocus, aperture, samples=samples)
    assert np.mean(np.abs(result - expected).max(axis=2) > 1e-4) < 0.02


def test_multi_pass_blurs_each_plane_by_its_own_disc():
    """An even blur of a smooth picture is the mean over the disc, but for the half resolution."""
    y, x = np.mgrid[:64, :80]
    image = np.repeat((0.5 + 0.3 * np.sin(x / 5) * np.cos(y / 7))[..., None], 3, axis=2).astype(np.float32)
    psf = psf_image(Aperture(), 6.0, 1)
    half = len(psf) // 2
    windows = np.lib.stride_tricks.sliding_window_view(image[..., 0], psf.shape)
    expected = np.einsum("yxvu,vu->yx", windows, psf)
    for sign in (1, -1):
        result = gather_passes(image, np.full(image.shape[:2], sign * 6.0, np.float32))
        inner = result[half:-half, half:-half, 0]
        assert np.abs(inner - expected).max() < 0.012


def test_multi_pass_keeps_far_light_off_what_is_sharp_and_lays_near_light_over_it():
    image = np.zeros((40, 60, 3), np.float32)
    image[:, 30:] = 1
    left, right = slice(0, 26), slice(34, 60)
    far = np.where(image[..., 0] > 0, -6, 0).astype(np.float32)
    assert np.abs(gather_passes(image, far)[:, left]).max() < 1e-6
    near = np.where(image[..., 0] > 0, 6, 0).astype(np.float32)
    profile = gather_passes(image, near)[20, :, 0]
    assert 0.3 < profile[29] < 0.7
    assert profile[22] < 0.05
    assert np.all(profile[right] > 0.9)


def test_half_size_and_back():
    rng = np.random.default_rng(2)
    values = rng.random((7, 9, 2)).astype(np.float32)
    small = halved(values)
    assert small.shape == (4, 5, 2)
    assert small[1, 2] == pytest.approx(values[2:4, 4:6].mean(axis=(0, 1)))
    assert extreme_of_four(values[..., 0], largest=True)[3, 0] == values[6, :2, 0].max()
    ramp = np.tile(np.arange(16, dtype=np.float32), (4, 1))
    assert np.abs(doubled(halved(ramp), 4, 16) - ramp)[:, 1:-1].max() < 1e-6
