"""Accumulated views of meshes, against slow literal oracles."""

import math

import numpy as np
import pytest

from bokehnet.baselines.rays.mesh_views import (
    MeshObject,
    Picture,
    draw,
    level_of_detail,
    render_views,
    subsample_blur,
)
from bokehnet.baselines.rays.n_buffers import n_buffers, radius_bounds
from bokehnet.errors import ParameterError
from bokehnet.lenses import ThinLens

LENS = ThinLens(focal_length=50.0, f_number=1.4, focus_distance=1000.0)
PICTURE = Picture(width=48, height=36, pixel_pitch=0.5)


def card(depth, half, color, centre=(0.0, 0.0), coarse=True):
    """A card of four triangles, then of two."""
    x, y = centre
    corners = np.array(
        [
            (x - half, y - half, depth),
            (x + half, y - half, depth),
            (x + half, y + half, depth),
            (x - half, y + half, depth),
            (x, y, depth),
        ]
    )
    colors = np.tile(np.array(color, float), (5, 1))
    fine = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    return MeshObject(
        levels=((corners, colors, fine), (corners, colors, np.array([(0, 1, 2), (2, 3, 0)])))[: 1 + coarse]
    )


def test_triangles_are_drawn_where_rays_meet_them():
    """Oracle: each pixel's ray against each triangle, by a linear system."""
    rng = np.random.default_rng(2)
    corners = rng.uniform((-300, -200, 800), (300, 200, 2000), (30, 3))
    colors, faces = rng.random((30, 3)), np.arange(30).reshape(-1, 3)
    lens = np.array([6.0, -4.0])
    scale = LENS.sensor_distance / PICTURE.pixel_pitch
    light, inverse = np.zeros((36, 48, 3), np.float32), np.zeros((36, 48), np.float32)
    middle = np.array([24, 18]) + lens / LENS.focus_distance * scale
    draw(corners, colors, faces, scale, *middle, *lens, light, inverse)
    expected = np.zeros((36, 48, 3))
    for j in range(36):
        for i in range(48):
            sensor = -PICTURE.pixel_pitch * np.array([i + 0.5 - 24, j + 0.5 - 18])
            ray = LENS.sample_rays(sensor, lens / LENS.pupil_radius)
            way, nearest = np.array([*ray.slope, 1.0]), math.inf
            for face in faces:
                a, b, c = corners[face]
                u, v, z = np.linalg.solve(np.stack([b - a, c - a, -way], 1), np.array([*ray.origin, 0]) - a)
                if u >= 0 and v >= 0 and u + v <= 1 and 0 < z < nearest:
                    nearest = z
                    expected[j, i] = (1 - u - v) * colors[face[0]] + u * colors[face[1]] + v * colors[face[2]]
    assert (expected > 0).any(-1).mean() > 0.2
    assert np.abs(light - expected).max() < 1e-4


def test_the_mean_of_views_is_the_disc_of_confusion():
    """Authority: a small card far behind focus is imaged as a disc of ``coc_radius``."""
    depth = 4000.0
    thing = card(depth, 12.0, (1, 1, 1))
    picture = render_views([thing], LENS, PICTURE, 256).bokeh[..., 0]
    radius = abs(float(LENS.coc_radius(1 / depth))) / PICTURE.pixel_pitch
    y, x = np.mgrid[:36, :48] + 0.5
    second = (picture * ((x - 24) ** 2 + (y - 18) ** 2)).sum() / picture.sum()
    own = (2 * 12.0 / depth * LENS.sensor_distance / PICTURE.pixel_pitch) ** 2 / 6
    assert second == pytest.approx(radius**2 / 2 + own, rel=0.06)
    assert render_views([thing], LENS, PICTURE, 256).triangles == 256 * 4


def test_levels_are_those_of_the_formula_and_share_the_views():
    """Authority: thesis 002, 3.3 and 3.4: C = 8 A is level 3 at s = 2."""
    assert level_of_detail(8 * 100 / (0.5 * 50), 100, 50) == pytest.approx(3)
    assert level_of_detail(9 * 100 / (0.5 * 50), 100, 50, 3) == pytest.approx(2)
    assert level_of_detail(0.01, 100, 50) == 0
    blurred, sharp = card(250.0, 5.0, (1, 0, 0)), card(1000.0, 30.0, (0, 1, 0))
    picture = render_views([blurred, sharp], LENS, PICTURE, 20, finer=0.0)
    plain = render_views([blurred, sharp], LENS, PICTURE, 20)
    assert (picture.triangles, plain.triangles) == (20 * (2 + 4), 20 * (4 + 4))
    assert np.abs(picture.bokeh - plain.bokeh).max() < 1e-6  # flat cards look alike at all levels


def test_what_is_in_focus_is_drawn_once_for_all_views():
    thing, behind = card(1000.0, 60.0, (0.2, 0.5, 0.8)), card(3000.0, 500.0, (1, 1, 1))
    picture = render_views([behind, thing], LENS, PICTURE, 40, reuse=True)
    plain = render_views([behind, thing], LENS, PICTURE, 40)
    assert picture.triangles < plain.triangles == 40 * 8
    assert picture.triangles == 4 + 4 * 9  # a blur of 1.25 pixels falls on 3x3 of them
    assert np.abs(picture.bokeh[8:28, 12:36] - plain.bokeh[8:28, 12:36]).mean() < 0.02
    alone = render_views([thing], LENS, PICTURE, 40, reuse=True)
    assert alone.triangles == 4
    assert np.abs(alone.bokeh - render_views([thing], LENS, PICTURE, 40).bokeh).max() < 1e-6


def test_bounds_hold_all_values_around():
    """Oracle: windows, one by one."""
    values = np.random.default_rng(0).random((13, 17))
    low, high = n_buffers(values)
    for y, x, reach in ((0, 0, 3), (6, 9, 2), (12, 16, 1), (5, 5, 8)):
        least, most = radius_bounds(low, high, y, x, reach)
        window = values[max(0, y - reach) : y + reach + 1, max(0, x - reach) : x + reach + 1]
        assert least <= window.min()
        assert most >= window.max()
        wide = values[
            max(0, y - 2 * reach - 1) : y + 2 * reach + 2, max(0, x - 2 * reach - 1) : x + 2 * reach + 2
        ]
        assert least >= wide.min()


def test_subsamples_of_one_depth_are_moved_pictures():
    """Authority: through the point u of the pupil a surface of radius r lies at p - r u."""
    light, radius = np.random.default_rng(0).random((24, 32, 3)), np.full((24, 32), 6.0)
    points = np.array([[0.5, 0.0], [0.0, -1 / 3]])
    result = subsample_blur(light, radius, points, *n_buffers(radius))
    expected = (light + np.roll(light, -3, 1) + np.roll(light, 2, 0)) / 3
    assert np.abs(result - expected)[3:-3, :-3].max() < 1e-9


def test_subsamples_see_past_an_edge_what_is_nearer_first():
    """A near card's edge moves over the sharp wall behind it; the wall itself does not move."""
    light = np.zeros((16, 32, 3))
    light[:, :16] = 1
    radius = np.where(light[..., 0] > 0, 4.0, 0.0)
    result = subsample_blur(light, radius, np.array([[-1.0, 0.0]]), *n_buffers(radius))
    assert np.abs(result[:, 4:19] - 1).max() < 0.51
    assert result[8, 18, 0] == pytest.approx(0.5)
    assert result[8, 22, 0] == 0


def test_bad_meshes_and_views_are_reported():
    with pytest.raises(ParameterError, match="levels"):
        MeshObject(levels=())
    with pytest.raises(ParameterError, match="levels"):
        MeshObject(levels=((np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((0, 3), int)),))
    with pytest.raises(ParameterError, match="views"):
        render_views([], LENS, PICTURE, 0)
