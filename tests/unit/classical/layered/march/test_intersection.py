"""Eight rays at once. Oracle: one ray at a time, pixel by pixel, in plain Python."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from bokehnet.classical.layered.depth_discontinuities import DISCONTINUITY_THRESHOLD
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march.defocus_bins import occupied_bins, tile_sets
from bokehnet.classical.layered.march.intersection import intersect, intersect_smooth, layer_cells
from bokehnet.classical.simd.float8 import LANES, load8


@njit
def meet_eight(cells, size, bins, runs, x, y, begin_x, begin_y, u, v, chance):
    hits = np.empty(4 * LANES, np.float32)
    starts = (load8(x, 0), load8(y, 0), load8(begin_x, 0), load8(begin_y, 0))
    lanes = (*starts, load8(u, 0), load8(v, 0), load8(chance, 0))
    intersect(cells, size, tile_sets(bins), runs, len(runs), *lanes, hits)
    return hits


def inside(packed: float, x: float, y: float) -> float:
    """Coverage at a place of a pixel: ten bits of level, six of the slope to the right, six downwards."""
    code = round(packed * 2**22)
    level, right, down = code >> 12, (code >> 6 & 63) - 32, (code & 63) - 32
    return (level + 0.5) / 1024 + (right * x + down * y) / 16


def meet_one(
    layers: Layers,
    runs: np.ndarray,
    x: float,
    y: float,
    begin_x: float,
    begin_y: float,
    u: float,
    v: float,
    chance: float,
):
    """Row, column and layer of the first surface, layer -1 where there is none; float64."""
    height, width, count = layers.defocus.shape
    packed = layer_cells(layers)[..., 1]
    for front, back in runs:
        cuts = {0.0, front - back}
        for place, slope in ((x + begin_x - u * front, u), (y + begin_y - v * front, v)):
            if slope != 0:
                ends = sorted((place, place + slope * (front - back)))
                grid = np.arange(math.ceil(ends[0]), math.floor(ends[1]) + 1)
                cuts |= {float(t) for t in (grid - place) / slope if 0 < t < front - back}
        below = -math.inf
        stretches = sorted(cuts)
        for start, end in itertools.pairwise(stretches):
            middle = front - (start + end) / 2
            row_there, column_there = (
                math.floor(y + begin_y - v * middle),
                math.floor(x + begin_x - u * middle),
            )
            row, column = min(max(row_there, 0), height - 1), min(max(column_there, 0), width - 1)
            entry, leave = front - start, front - end
            under = -math.inf
            for layer in range(count):
                depth = float(layers.defocus[row, column, layer])
                if depth < leave:
                    under = max(under, depth)
                    continue
                cover = float(packed[row, column, layer])
                riser = cover >= 1 and depth - below <= DISCONTINUITY_THRESHOLD
                if cover > 0 and (depth <= entry or riser):
                    if cover < 1:
                        away_x = x + begin_x - u * depth - column_there - 0.5
                        cover = max(inside(cover, away_x, y + begin_y - v * depth - row_there - 0.5), 0.0)
                    if chance >= cover:
                        chance = (chance - cover) / (1 - cover)
                        continue
                    return row, column, layer
            below = under
    return None, None, -1


def random_layers(rng: np.random.Generator, height: int, width: int, count: int) -> Layers:
    """Slopes and steps in front of each other, some of them half covered."""
    y, x = np.mgrid[:height, :width]
    far = -6 + 0.11 * x + 0.07 * y
    defocus = np.stack([far - 3 * layer for layer in range(count)], axis=-1)
    for _ in range(5):
        top, left = rng.integers(0, height - 4), rng.integers(0, width - 4)
        defocus[top : top + rng.integers(2, 9), left : left + rng.integers(2, 9), 0] = rng.uniform(-5, 9)
    defocus = -np.sort(-defocus, axis=-1)
    coverage = np.where(rng.random(defocus.shape) < 0.2, rng.random(defocus.shape), 1.0)
    return Layers(colors=np.zeros((*defocus.shape, 3)), defocus=defocus, coverage=coverage)


@pytest.mark.parametrize(("count", "stretch"), [(1, 1), (2, 1), (3, 1), (2, 15)])
def test_eight_rays_meet_what_each_meets_alone(count, stretch):
    """Rays pass empty tiles in one step where the defocus has a large range."""
    rng = np.random.default_rng(count)
    layers = random_layers(rng, 21, 26, count)
    layers = replace(layers, defocus=stretch * layers.defocus)
    bins, cells = occupied_bins(layer_cells(layers)), layer_cells(layers).reshape(-1)
    low, high = float(layers.defocus.min()) - 0.01, float(layers.defocus.max()) + 0.01
    met_by_layer = np.zeros(count + 1, int)
    wrong = 0
    for trial in range(260):
        middle = rng.uniform(low, high)
        runs = np.array([[high, low]] if trial % 2 else [[high, middle], [middle - 0.3, low]])
        x, y = rng.integers(0, 26, LANES), rng.integers(0, 21, LANES)
        begin = rng.uniform(-3, 4, (2, LANES)) if trial % 3 else np.full((2, LANES), 0.5)
        u, v, chance = rng.uniform(-1, 1, LANES), rng.uniform(-1, 1, LANES), rng.random(LANES)
        arrays = [np.asarray(a, np.float32) for a in (x, y, *begin, u, v, chance)]
        size = (21, 26, count)
        rows, columns, result, depths = meet_eight(cells, size, bins, runs, *arrays).reshape(4, LANES)
        for lane in range(LANES):
            row, column, layer = meet_one(layers, runs, *(float(a[lane]) for a in arrays))
            met_by_layer[layer] += 1
            same = layer == result[lane] and (layer < 0 or (row, column) == (rows[lane], columns[lane]))
            wrong += not same
            if same and layer >= 0:
                assert depths[lane] == layers.defocus[row, column, layer].astype(np.float32)
    assert (met_by_layer[:count] > 20).all()
    assert wrong <= 3  # of 2080: rays that float32 sends past the other side of a pixel's corner


@njit
def settle_eight(cells, size, x, y, begin_x, begin_y, u, v):
    hits = np.empty(4 * LANES, np.float32)
    starts = (load8(x, 0), load8(y, 0), load8(begin_x, 0), load8(begin_y, 0))
    return intersect_smooth(cells, size, *starts, load8(u, 0), load8(v, 0), hits), hits


@pytest.mark.parametrize("slope", [(0.0, 0.0), (0.05, -0.02), (-0.12, 0.1)])
def test_rays_come_to_rest_on_a_slope_where_they_cut_it(slope):
    """Oracle: the ray and the plane, cut by hand; both are read off at pixels, half a pixel away at most."""
    height, width = 60, 80
    y, x = np.mgrid[:height, :width]
    depth = 6 + slope[0] * (x - 40) + slope[1] * (y - 30)
    layers = Layers(
        colors=np.zeros((height, width, 1, 3)), defocus=depth[..., None], coverage=np.ones((height, width, 1))
    )
    cells, rng = layer_cells(layers).astype(np.float32).reshape(-1), np.random.default_rng(2)
    far = []
    for _ in range(50):
        column, row = rng.integers(32, 48, LANES), rng.integers(22, 38, LANES)
        begin, ray = rng.uniform(-2, 3, (2, LANES)), rng.uniform(-0.9, 0.9, (2, LANES))
        arrays = [np.asarray(a, np.float32) for a in (column, row, *begin, *ray)]
        rests, hits = settle_eight(cells, (height, width, 1), *arrays)
        assert rests
        rows, columns, result, depths = hits.reshape(4, LANES)
        away = column + begin[0] - 0.5 - 40, row + begin[1] - 0.5 - 30
        s = (6 + slope[0] * away[0] + slope[1] * away[1]) / (1 + slope[0] * ray[0] + slope[1] * ray[1])
        assert not result.any()
        place = column + begin[0] - 0.5 - s * ray[0], row + begin[1] - 0.5 - s * ray[1]
        far.append(np.hypot(columns - place[0], rows - place[1]))
        np.testing.assert_array_equal(depths, depth[rows.astype(int), columns.astype(int)].astype(np.float32))
    assert np.max(far) < math.hypot(0.5, 0.5) + 0.25
    assert np.mean(far) < 0.4  # 0.383: mean distance of a place from the middle of its pixel


def test_rays_that_never_rest_are_reported():
    depth = np.tile(np.arange(60.0) * 1.5, (20, 1))[..., None]  # steeper than any smooth surface
    cells = layer_cells(Layers(colors=np.zeros((20, 60, 1, 3)), defocus=depth, coverage=np.ones_like(depth)))
    arrays = [np.full(LANES, a, np.float32) for a in (30, 10, 0.5, 0.5, 0.9, 0.0)]
    assert not settle_eight(cells.astype(np.float32).reshape(-1), (20, 60, 1), *arrays)[0]
