"""Authorities: hand-counted bins, and closed forms of rays that meet planes and steps."""

import numpy as np
import pytest

from bokehnet.pupil_rays import BINS, Slab, find_surface, first_scan, is_inside, max_bins_of, scan_bin


def bounds_of(bins: set[int], slabs: int) -> list[tuple[int, int]]:
    first, last = np.array([min(bins, default=0)]), np.array([max(bins, default=0)])
    scan = first_scan(np.zeros(1, np.int64), slabs)
    for bin in range(BINS):
        scan = scan_bin(scan, bin, np.array([bin in bins]), max_bins_of(first, last, slabs))
    return [(int(a[0]), int(b[0])) for a, b in zip(scan.bounds[:slabs], scan.bounds[slabs:], strict=True)]


def test_distant_surfaces_are_in_different_slabs():
    assert bounds_of({2, 3, 20}, 3) == [(2, 3), (20, 20), (-1, -1)]


def test_a_slope_is_divided_evenly():
    assert bounds_of(set(range(4, 16)), 3) == [(4, 7), (8, 11), (12, 15)]


def test_the_last_slab_contains_the_rest():
    assert bounds_of({0, 8, 16, 24, 31}, 3) == [(0, 0), (8, 8), (16, 31)]


def test_no_bin_makes_no_slab():
    assert bounds_of(set(), 2) == [(-1, -1), (-1, -1)]


@pytest.mark.parametrize("pupil", [0.9, -0.6, 0.0])
def test_rays_meet_a_slope_where_they_cross_it(pupil):
    """A slope D(x) = 3 + 0.1 x is met at s = D(x - s a) = (3 + 0.1 x) / (1 + 0.1 a)."""
    x, a = np.arange(0.0, 40.0), np.full(40, pupil)
    slab = Slab(*(np.full(40, value) for value in (7.0, 3.0, 9.0, -2.0)))
    result = find_surface(lambda u, v: [3 + 0.1 * u], (x, x), (a, 0 * a), slab)
    np.testing.assert_allclose(result, (3 + 0.1 * x) / (1 + 0.1 * a), atol=0.06)


def test_rays_behind_a_foreground_meet_the_hidden_layer():
    """At s = -4 the ray of pixel 10 is under a foreground, pixels 12 to 20, which is outside the slab."""

    def defocus_at(column, row):
        return [np.where((column >= 12) & (column <= 20), 6.0, -4.0), np.full(1, -4.0)]

    slab = Slab(*(np.full(1, value) for value in (-3.9, -4.1, -3.8, -4.2)))
    result = find_surface(defocus_at, (np.full(1, 10.0), np.zeros(1)), (np.full(1, 0.9), np.zeros(1)), slab)
    assert result == -4
    assert is_inside(slab, result)
