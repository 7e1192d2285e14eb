"""The two post-processes of games against their listings, written out for one pixel."""

import math

import numpy as np
import pytest

from bokehnet.baselines import abadie, jimenez, tan
from bokehnet.baselines.apertures import outline, psf_image
from bokehnet.baselines.gather import scatter_as_you_gather as sayg
from bokehnet.baselines.gather.layered_gather import split_lights
from bokehnet.baselines.gather.tiles import dilated_tiles
from bokehnet.optics.aperture import Aperture


def saturate(value):
    return min(max(value, 0.0), 1.0)


def smoothstep(value):
    value = saturate(value)
    return value * value * (3 - 2 * value)


def test_kernels_have_the_published_numbers_of_taps():
    assert len(sayg.ring_taps(3)) == 1 + 48
    assert len(sayg.ring_taps(4)) == 81


def test_weights_are_those_of_the_listings():
    for behind in (-1.0, 0.0, 0.3, 0.7, 2.0):
        assert sayg.presort(2 * behind, 2.0) == pytest.approx(smoothstep(behind))
    for ring, radius in ((0, 0.4), (1, 0.5), (2, 1.5), (3, 9.0), (3, 1.0)):
        spread = saturate(radius - ring + 1)
        assert sayg.spread_weight(float(ring), radius) == pytest.approx(spread**4 if ring <= 1 else spread)
    assert sayg.sample_alpha(5.0) == pytest.approx(1 / (25 * math.pi))
    assert sayg.sample_alpha(0.0) == pytest.approx(2 / math.pi)


@pytest.mark.parametrize("two_layers", [True, False])
def test_main_pass_is_what_the_theses_write(two_layers):
    rng = np.random.default_rng(8)
    light = rng.random((24, 28, 3)).astype(np.float32)
    coc = np.where(rng.random((24, 28)) < 0.4, 3.0, -2.0).astype(np.float32)
    coc[12, 14] = -2
    nearest, largest = dilated_tiles(coc, 16)
    rings = 3 if two_layers else 4
    taps, shape = sayg.ring_taps(rings), outline(Aperture())
    ways, table = np.full(largest.shape, rings), sayg.tap_table(rings)
    result = np.empty((24, 28, 4), np.float32)
    sayg._main(light, coc, nearest, largest, 16, ways, table, shape, 2.0, two_layers, 0.0, result)
    for y, x in ((12, 14), (9, 16), (15, 11)):
        reach, first = largest[y // 16, x // 16], nearest[y // 16, x // 16]
        fore, back = np.zeros(4), np.zeros(4)
        for angle, place in taps.astype(float):
            row = math.floor(y + place * reach * math.sin(angle) + 0.5)
            column = math.floor(x + place * reach * math.cos(angle) + 0.5)
            r = abs(coc[row, column])
            ring = round(place * rings)
            spread = saturate(rings / reach * r - ring + 1)
            spread = spread**4 if ring <= 1 else spread
            alpha = spread / (math.pi * max(r * r, 0.5))
            behind = smoothstep((first - coc[row, column]) / 2)
            fore += alpha * (1 - behind) * np.append(light[row, column], 1)
            back += alpha * behind * np.append(light[row, column], 1)
        share = saturate(2 * fore[3] / (len(taps) / (math.pi * max(reach**2, 0.5))))
        if two_layers:
            expected = back[:3] / back[3] + share * (fore[:3] / fore[3] - back[:3] / back[3])
        else:  # eq. 5.1: (v_f + v_b) over the sum of D sampleAlpha of all
            expected = (fore[:3] + back[:3]) / (fore[3] + back[3])
        assert result[y, x, :3] == pytest.approx(expected, rel=1e-4)
        assert result[y, x, 3] == pytest.approx(share, rel=1e-4)


def test_tans_sum_does_not_depend_on_the_layers():
    """Both weights of the presort add up to 1, so eq. 5.1 cancels them."""
    rng = np.random.default_rng(9)
    light = rng.random((20, 20, 3)).astype(np.float32)
    coc = rng.uniform(-3, 3, (20, 20)).astype(np.float32)
    nearest, largest = dilated_tiles(coc, 16)
    ways, table, shape = np.full(largest.shape, 4), sayg.tap_table(4), outline(Aperture())
    results = []
    for fade in (0.1, 50.0):
        result = np.empty((20, 20, 4), np.float32)
        sayg._main(light, coc, nearest, largest, 16, ways, table, shape, fade, False, 0.0, result)
        results.append(result[..., :3])
    assert np.allclose(*results, atol=1e-5)


def test_rings_reach_too_far():
    """Taps on rings k / n of the radius, 8 k each: the blur's variance over that of a disc."""
    for rings, expected in ((3, 1.306), (4, 1.235)):
        radius = sayg.ring_taps(rings)[:, 1].astype(float)
        assert 2 * (radius**2).mean() == pytest.approx(expected, abs=1e-3)


def test_tiles_know_the_nearest_and_the_most_blurred_around():
    defocus = np.zeros((100, 130))
    defocus[40, 50], defocus[90, 120] = 5, -7
    nearest, largest = dilated_tiles(defocus, 32)
    assert nearest.shape == (4, 5)
    assert nearest[0, 0] == 5  # the tile beside
    assert nearest[3, 4] == 0
    assert largest[2, 3] == 7
    far = np.zeros((200, 200))
    far[0, 0] = 70
    assert dilated_tiles(far, 32)[1][3, 0] == 70  # further than a tile
    assert dilated_tiles(far, 32)[1][4, 0] == 0


@pytest.mark.parametrize("method", [jimenez, tan])
def test_tiles_of_one_depth_lose_nothing_by_the_cheap_way(method):
    """All weights are equal at one blur, which needs as many rings as are published."""
    image = np.random.default_rng(2).random((96, 128, 3)).astype(np.float32)
    rings = 3 if method is jimenez else 4
    defocus = np.full((96, 128), 2.0 * rings - 0.5, np.float32)
    defocus[:, 64:] = 0
    whole, cheap = (method(image, defocus, by_tile=way) for way in (False, True))
    assert np.abs(whole - cheap)[:, :32].max() < 1e-5
    assert np.array_equal(cheap[:, 96:], image[:, 96:])


def test_tiles_are_distinguished():
    nearest = np.array([0.3, 4.0, 4.0, 30.0])
    farthest = np.array([-0.3, 3.9, -2.0, 29.0])
    assert sayg.tile_strategies(nearest, farthest, np.abs(nearest)).tolist() == [0, -4, 4, -8]


def test_a_median_takes_single_bright_pixels_away():
    image = np.zeros((5, 6, 3))
    image[2, 3] = 9
    assert not sayg.median_of_nine(image).any()
    rng = np.random.default_rng(0)
    image = rng.random((5, 6, 3))
    assert sayg.median_of_nine(image)[2, 3, 1] == np.median(image[1:4, 2:5, 1])


def disc_means(image, radius):
    psf = psf_image(Aperture(), radius, 1)
    windows = np.lib.stride_tricks.sliding_window_view(image[..., 0], psf.shape)
    return np.einsum("yxvu,vu->yx", windows, psf), len(psf) // 2


@pytest.mark.parametrize(
    ("method", "wider", "most"), [(jimenez, 1.306, 0.01), (tan, 1.235, 0.01), (abadie, 1, 0.004)]
)
def test_an_even_blur_is_the_mean_over_a_disc_of_the_variance_of_the_taps(method, wider, most):
    y, x = np.mgrid[:64, :80]
    image = np.repeat((0.5 + 0.3 * np.sin(x / 6) * np.cos(y / 8))[..., None], 3, axis=2).astype(np.float32)
    expected, half = disc_means(image, 6.0 * math.sqrt(wider))
    for sign in (1, -1):
        result = method(image, np.full(image.shape[:2], sign * 6.0, np.float32))
        assert np.abs(result[half:-half, half:-half, 0] - expected).mean() < most


def test_far_light_stays_off_what_is_sharp():
    image = np.zeros((48, 64, 3), np.float32)
    image[:, 32:] = 1
    far = np.where(image[..., 0] > 0, -8, 0).astype(np.float32)
    for method in (jimenez, tan, abadie):
        assert np.abs(method(image, far)[:, :30]).max() < 1e-6


def test_lights_are_separated_and_keep_their_energy():
    rng = np.random.default_rng(3)
    light = (0.2 * rng.random((40, 40, 3))).astype(np.float32)
    light[20, 20] = 50
    coc = np.full((40, 40), -6.0, np.float32)
    rest, lights = split_lights(light, coc, 3.0)
    assert np.allclose(rest + lights, light)
    assert np.argwhere(lights.any(axis=2)).tolist() == [[20, 20]]
    image = np.full((80, 80, 3), 0.1, np.float32)
    image[40:42, 40:42] = 50
    bokeh = abadie(image, np.full((80, 80), -9.0, np.float32))
    assert bokeh.sum() == pytest.approx(image.sum(), rel=0.02)
    assert bokeh[40, 33, 0] == pytest.approx(0.1 + 4 * 49.9 / (math.pi * 81), rel=0.1)
