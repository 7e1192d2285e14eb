"""The exact area of a disc on every pixel, against counting, formulas and finite differences."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.classical.scatter.disc_table import TABLE_RADIUS, disc_table, find_step, list_row
from bokehnet.classical.scatter.oracle import disc_coverage, disc_weights

RADII = [0.5, 0.52, 0.7, 1.0, 1.3, math.sqrt(2.5), 2.6, 3.015, 5.5, 8.3, 20.4, 40.0]


def listed(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (n, 2) of all ends of a disc, their weights and derivatives (n, 2)."""
    size = math.ceil(radius) + 2
    places, weights = np.empty((8 * size, 2), np.int16), np.empty((8 * size, 2))
    count = 0
    for k in range(size):
        count = list_row(radius, k, size, count, places, weights)
    return places[:count], weights[:count]


def tabulated(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """The same from the table."""
    table = disc_table()
    step, along, far = find_step(table, radius)
    part = slice(table.first[step, 0], table.first[step, far + 1])
    start, slope = table.weights[part].T
    return table.places[part], np.stack([start + along * slope, slope], 1)


def picture(places: np.ndarray, weights: np.ndarray, reach: int) -> np.ndarray:
    """Return the sum of the ends on a (2 reach + 1)^2 window: intervals in two halves, row 0 in both."""
    out = np.zeros((2 * reach + 1, 2 * reach + 1))
    for (k, j), weight in zip(places, weights, strict=True):
        for row in (reach - k, reach + k):
            out[row, reach - j : reach + j + 1] += weight
    return out


@pytest.mark.parametrize("radius", RADII)
def test_listed_disc_is_the_exact_area_on_every_pixel(radius):
    """Authority: 800^2 sub-pixels per pixel, whose own error falls with the rim's length."""
    reach = math.ceil(radius) + 1
    places, weights = listed(radius)
    counted = disc_coverage(radius, reach, 800 if radius < 6 else 200)
    assert_allclose(
        picture(places, weights[:, 0], reach) * math.pi * radius**2,
        counted,
        atol=4e-4 if radius < 6 else 2e-3,
    )
    thin = disc_weights(radius, reach, 20000) * math.pi * radius**2
    assert_allclose(picture(places, weights[:, 0], reach) * math.pi * radius**2, thin, atol=2e-6)


@pytest.mark.parametrize("radius", [*RADII, 63.99, 150.2, 300.0, 1e3, 1e4])
def test_parts_of_a_disc_sum_to_one_and_do_not_change_their_sum(radius):
    places, weights = listed(radius)
    total = (2 * (2 * places[:, 1].astype(int) + 1))[:, None] * weights
    assert_allclose(total.sum(axis=0), [1, 0], atol=1e-9)
    assert weights[:, 0].min() >= -1e-18


@pytest.mark.parametrize("radius", [0.52, 0.7, 1.0, 1.3, 2.6, 3.015, 8.3, 20.4, 40.0])
def test_listed_slopes_are_the_derivative_by_the_radius(radius):
    """Authority: central differences of the listed weights, away from radii that touch a new pixel."""
    reach, step = math.ceil(radius) + 1, 1e-6
    above, below = (picture(p, w[:, 0], reach) for p, w in map(listed, (radius + step, radius - step)))
    places, weights = listed(radius)
    assert_allclose(picture(places, weights[:, 1], reach), (above - below) / (2 * step), atol=2e-8, rtol=1e-4)


def test_table_stays_close_to_the_exact_disc_for_every_radius():
    """Light on a wrong pixel, as a part of all: linear interpolation moves less than one in a thousand."""
    radii = np.concatenate([np.linspace(0.5, 4, 200), np.random.default_rng(0).uniform(4, TABLE_RADIUS, 40)])
    for radius in radii:
        reach = math.ceil(radius) + 2
        exact, approximate = (picture(p, w[:, 0], reach) for p, w in (listed(radius), tabulated(radius)))
        assert np.abs(exact - approximate).sum() / 2 < 1e-3
        assert approximate.sum() == pytest.approx(1, abs=1e-12)


def test_ends_beyond_the_border_are_gathered_in_it():
    """On the columns up to the border nothing changes, and no end lies behind it."""
    rows = []
    for border in (40, 5):
        places, weights = np.empty((40, 2), np.int16), np.empty((40, 2))
        count = list_row(9.3, 2, border, 0, places, weights)
        assert places[:count, 1].max() <= border
        rows.append(picture(places[:count], weights[:count, 0], 12)[:, 12 - 5 : 12 + 6])
    assert_allclose(*rows, atol=1e-15)
