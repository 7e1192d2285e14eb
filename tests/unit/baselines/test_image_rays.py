"""Rays through layers of pixels, and the shadows of surfaces, against slow literal oracles."""

import math

import numpy as np
import pytest

from bokehnet import baselines
from bokehnet.baselines.rays.height_field import walk_corners, walk_edges, walk_runs
from bokehnet.baselines.rays.image_based_rays import trace_height_fields
from bokehnet.baselines.rays.umbra import cull_umbra
from bokehnet.classical.known_layers import Layers
from bokehnet.errors import ParameterError, ShapeError

# Methods of the literature, which no default uses: their kernels are compiled for the tests.
pytestmark = pytest.mark.slow

WALKS = {"edges": walk_edges, "corners": walk_corners, "runs": walk_runs}


def first_square(z, start, end, slack):
    """Oracle: the ray's times inside each square, one after the other, and the first square met."""
    start, way = np.array(start), np.array(end) - start
    results = []
    for row, column in np.ndindex(z.shape[:2]):
        enter, leave = 0.0, 1.0
        for axis, low in ((0, column), (1, row)):
            if way[axis] == 0:
                if not low <= start[axis] < low + 1:
                    enter, leave = 1.0, 0.0
                continue
            times = sorted((edge - start[axis]) / way[axis] for edge in (low, low + 1))
            enter, leave = max(enter, times[0]), min(leave, times[1])
        if enter < leave or (enter == leave and not way[:2].any()):
            near, far = start[2] + enter * way[2], start[2] + leave * way[2] + slack
            for layer, depth in enumerate(z[row, column]):
                if near < depth <= far:
                    results.append((enter, row, column, layer))
                    break
    return min(results)[1:] if results else None


@pytest.mark.parametrize("walk", WALKS)
def test_all_walks_find_the_first_square(walk):
    rng = np.random.default_rng(3)
    z = np.sort(rng.random((9, 11, 3)), 2)
    count = np.full((9, 11), 3)
    hits = 0
    for trial in range(400):
        start = (*(rng.random(2) * (11, 9)), 0.0)
        end = (*(rng.random(2) * (11, 9)), 0.6)
        if trial % 5 == 0:  # along an axis, from an edge to an edge, and upright
            start = (float(rng.integers(1, 10)), start[1], 0.0)
            end = [(start[0], end[1], 0.6), (float(rng.integers(1, 10)), start[1], 0.6), (*start[:2], 0.6)][
                trial // 5 % 3
            ]
        expected = first_square(z, start, end, 0.01)
        row, column, layer = WALKS[walk](z, count, start, end, 0.01)
        if expected is None:
            assert layer == -1
        else:
            assert (row, column, layer) == expected
            hits += 1
    assert hits > 100


def test_layers_that_are_not_there_are_not_met():
    z = np.zeros((1, 4, 2))
    z[..., 0], z[..., 1] = 0.3, 0.6
    count = np.array([[0, 1, 2, 2]])
    for walk in WALKS.values():
        assert walk(z, count, (0.5, 0.5, 0.0), (0.5, 0.5, 1.0), 0.0)[2] == -1
        assert walk(z, count, (1.5, 0.5, 0.4), (1.5, 0.5, 1.0), 0.0)[2] == -1
        assert walk(z, count, (2.5, 0.5, 0.4), (2.5, 0.5, 1.0), 0.0) == (0, 2, 1)


def two_layers(far, near, cut, height=24, width=40):
    """A near card right of a column, a far one behind all."""
    defocus = np.empty((height, width, 2), np.float32)
    colors = np.zeros((height, width, 2, 3), np.float32)
    coverage = np.ones((height, width, 2), np.float32)
    defocus[..., 0], defocus[..., 1] = near, far
    colors[:, :, 0, 0], colors[:, :, 1, 1] = 1, 1
    coverage[:, :cut, 0] = 0
    return Layers(colors=colors, defocus=defocus, coverage=coverage)


@pytest.mark.parametrize("walk", WALKS)
def test_a_blurred_edge_is_the_share_of_the_disc_on_its_side(walk):
    """Authority: the pupil's segment beyond the edge, in closed form; what is behind it is seen there."""
    radius, cut = 6.0, 20
    bokeh, lost = trace_height_fields(two_layers(-1.0, radius, cut), samples=1024, walk=walk)
    x = np.clip((np.arange(40) + 0.5 - cut) / radius, -1, 1)
    expected = 0.5 + (x * np.sqrt(1 - x**2) + np.arcsin(x)) / math.pi
    inside = slice(8, -8)
    assert np.abs(bokeh[12, inside, 0] - expected[inside]).max() < 0.01
    assert np.abs(bokeh[12, inside, 1] - (1 - expected[inside])).max() < 0.01
    assert lost.max() == 0


def test_bounds_change_nothing_but_the_time():
    rng = np.random.default_rng(1)
    defocus = np.cumsum(-0.3 * rng.random((24, 40, 3)), 2).astype(np.float32) + 1
    colors = rng.random((24, 40, 3, 3)).astype(np.float32)
    layers = Layers(colors=colors, defocus=defocus, coverage=np.ones_like(defocus))
    bounded, other = (trace_height_fields(layers, bounded=way)[0] for way in (True, False))
    assert np.abs(bounded - other).max() < 1e-6
    walks = [trace_height_fields(layers, walk=walk)[0] for walk in WALKS]
    assert np.abs(walks[0] - walks[1]).max() < 1e-6


def test_a_picture_alone_has_nothing_behind_its_edges():
    flat = two_layers(-8.0, 6.0, 20)
    seen = np.where(flat.coverage[..., :1] > 0, flat.colors[:, :, 0], flat.colors[:, :, 1])
    defocus = np.where(flat.coverage[..., 0] > 0, 6.0, -8.0).astype(np.float32)
    one = Layers(colors=seen[:, :, None], defocus=defocus[..., None], coverage=np.ones((24, 40, 1)))
    assert trace_height_fields(one)[1][:, 18:24].max() > 0.05
    assert np.array_equal(baselines.image_rays(seen, defocus), trace_height_fields(one)[0])
    assert np.array_equal(baselines.image_rays(seen, defocus, layers=flat), trace_height_fields(flat)[0])


def test_mistakes_are_reported_by_name():
    layers = two_layers(-1.0, 2.0, 9)
    with pytest.raises(ParameterError, match="walk"):
        trace_height_fields(layers, walk="straight")
    with pytest.raises(ParameterError, match="samples"):
        trace_height_fields(layers, samples=0)
    image = np.zeros((10, 40, 3), np.float32)
    with pytest.raises(ShapeError, match="layers"):
        baselines.image_rays(image, image[..., 0], layers=layers)
    nothing = Layers(colors=layers.colors, defocus=layers.defocus, coverage=0 * layers.coverage)
    assert trace_height_fields(nothing)[1].min() == 1


def test_the_umbra_of_a_pixel_is_half_a_pixel_deep():
    """Authority: rays from the middle of a pixel pass the one before it inside its square."""
    for far, dark in ((1.55, True), (1.45, False)):
        kept = cull_umbra(two_layers(far, 2.0, 0)).coverage[..., 1]
        points = np.stack(np.meshgrid(*[np.linspace(-1, 1, 41)] * 2), -1).reshape(-1, 2)
        away = np.abs((2.0 - far) * points[np.hypot(*points.T) <= 1]).max()
        assert (away <= 0.5) == dark
        assert (kept == 0).all() == dark


def test_the_extended_umbra_ends_where_rays_pass_the_edge():
    """Authority: from a point r behind a card rays reach it r pixels of defocus beside."""
    layers = two_layers(-3.0, 2.0, 20)
    kept = cull_umbra(layers, extended=True).coverage
    assert np.array_equal(kept[..., 0], layers.coverage[..., 0])
    assert (kept[:, : 20 + 5, 1] == 1).all()
    assert (kept[:, 20 + 5 :, 1] == 0).all()
    whole, culled = (trace_height_fields(part)[0] for part in (layers, cull_umbra(layers, extended=True)))
    assert np.abs(whole - culled).max() < 1e-6


def test_what_does_not_hide_casts_no_shadow():
    layers = two_layers(-3.0, 2.0, 0)
    thin = Layers(
        colors=layers.colors, defocus=layers.defocus, coverage=layers.coverage * np.float32([0.3, 1])
    )
    assert np.array_equal(cull_umbra(thin, extended=True).coverage, thin.coverage)
