"""Kosloff's spreading and the published scatter against a double loop over pixels."""

import math

import numpy as np
import pytest

from bokehnet.baselines import bokehme_scatter, hybrid_spreading, perimeter, rectangle
from bokehnet.baselines.apertures import ladder_positions, psf_image, radius_ladder
from bokehnet.baselines.spread.psf_spreading import normalised, packed, spread_tables
from bokehnet.baselines.spread.spreading import local_contrast
from bokehnet.optics.aperture import Aperture


def scene(height=21, width=25):
    rng = np.random.default_rng(6)
    image = rng.random((height, width, 3)).astype(np.float32)
    image[4, 5] = 30
    defocus = np.full((height, width), -2.3, np.float32)
    defocus[6:15, 6:15] = 4.1
    defocus[:, 20:] = 0
    return image, defocus


def test_rectangle_spreads_squares_of_the_discs_area():
    image, defocus = scene()
    height, width = defocus.shape
    sums = np.zeros((height, width, 4))
    for y, x in np.ndindex(height, width):
        half = max(math.sqrt(math.pi) / 2 * abs(float(defocus[y, x])), 0.5)

        def covered(middle, count, half=half):
            at = np.arange(count)
            return np.clip(np.minimum(at + 0.5, middle + half) - np.maximum(at - 0.5, middle - half), 0, 1)

        light = np.outer(covered(y, height), covered(x, width)) / (2 * half) ** 2
        sums += light[..., None] * np.append(image[y, x], 1)
    assert np.allclose(rectangle(image, defocus), sums[..., :3] / sums[..., 3:], atol=1e-5)


@pytest.mark.parametrize("aperture", [Aperture(), Aperture(blades=5, rotation=10), Aperture(obstruction=0.5)])
def test_perimeter_spreads_the_whole_image_of_the_opening(aperture):
    image, defocus = scene()
    sums, weights = np.zeros(image.shape), np.zeros(defocus.shape)
    for side in (1, -1):
        radii = radius_ladder(max(0.0, float((side * defocus).max())))
        tables = [psf_image(aperture, float(radius), side) for radius in radii]
        spread_tables(image, *ladder_positions(defocus, radii, side), *packed(tables), sums, weights)
    assert np.allclose(perimeter(image, defocus, aperture), normalised(sums, weights, image), atol=1e-5)


def test_tables_are_spread_pixel_by_pixel():
    rng = np.random.default_rng(1)
    tables = [rng.random((2 * half + 1, 2 * half + 1)) for half in (0, 2, 3)]
    image = rng.random((7, 9, 2)).astype(np.float32)
    low, upper = rng.integers(-1, 2, (7, 9)).astype(np.int32), rng.random((7, 9)).astype(np.float32)
    sums, weights = np.zeros(image.shape), np.zeros(low.shape)
    spread_tables(image, low, upper, *packed(tables), sums, weights)
    expected = np.zeros((7 + 6, 9 + 6, 3))  # three pixels more on each side
    for y, x in np.argwhere(low >= 0):
        for k, share in ((low[y, x], 1 - upper[y, x]), (low[y, x] + 1, upper[y, x])):
            half = len(tables[k]) // 2
            part = expected[y + 3 - half : y + 4 + half, x + 3 - half : x + 4 + half]
            part += share * tables[k][..., None] * np.append(image[y, x], 1)
    assert np.allclose(np.dstack([sums, weights]), expected[3:-3, 3:-3], atol=1e-5)


def test_images_of_the_opening_are_turned_behind_focus_and_hold_its_area():
    aperture = Aperture(blades=3)
    before, behind = psf_image(aperture, 8.0, 1), psf_image(aperture, 8.0, -1)
    assert np.allclose(before[::-1, ::-1], behind)
    first, last = (np.flatnonzero(before.any(axis=0))[k] - len(before) // 2 for k in (0, -1))
    assert (first, last) == (-4, 8)  # an edge on the left, a corner on the right
    disc = psf_image(Aperture(), 8.0, 1)
    assert disc.sum() == pytest.approx(1)
    assert disc.max() == pytest.approx(1 / (math.pi * 64), rel=0.01)


def test_hybrid_takes_outlines_where_contrast_is_high():
    image, defocus = scene()
    assert np.allclose(hybrid_spreading(image, defocus, threshold=1e9), rectangle(image, defocus), atol=1e-6)
    assert np.allclose(hybrid_spreading(image, defocus, threshold=1e-9), perimeter(image, defocus), atol=1e-6)
    dark = np.zeros_like(image)
    dark[10, 10] = 1
    alone = hybrid_spreading(dark, np.full_like(defocus, 5), threshold=0.05)
    assert np.count_nonzero(alone[..., 0] > 0.5 * alone.max()) == pytest.approx(math.pi * 25, rel=0.15)


def test_local_contrast_is_the_distance_from_the_mean_around():
    image, _ = scene()
    result = local_contrast(image, 3)
    for y, x in ((0, 0), (10, 12), (20, 24), (4, 5)):
        window = image[max(0, y - 3) : y + 4, max(0, x - 3) : x + 4].mean()
        assert result[y, x] == pytest.approx(abs(image[y, x].mean() - window), abs=1e-5)


@pytest.mark.parametrize("gamma", [1.0, 2.5])
def test_the_published_scatter_is_its_double_loop(gamma):
    image, defocus = scene()
    y, x = np.mgrid[: defocus.shape[0], : defocus.shape[1]]
    sums = np.zeros((*defocus.shape, 4))
    for row, column in np.ndindex(defocus.shape):
        r = abs(float(defocus[row, column]))
        distance = np.hypot(y - row, x - column)
        weight = (0.5 + 0.5 * np.tanh(4 * (r - distance))) / (r * r + 0.2)
        weight[distance > r + 2] = 0
        sums += weight[..., None] * np.append(image[row, column].astype(float) ** gamma, 1)
    expected = (sums[..., :3] / sums[..., 3:]) ** (1 / gamma)
    assert np.allclose(bokehme_scatter(image, defocus, gamma=gamma), expected, rtol=2e-3, atol=2e-4)
