"""Polygonal apertures in the file. Authorities: closed forms, and the package with blades."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.classical.rays_renderer import rays
from bokehnet.classical.scatter_renderer import scatter_inside as package_scatter
from bokehnet.onnx_file import renderer
from bokehnet.onnx_file.polygon import read_polygon
from bokehnet.onnx_file.scatter import scatter
from bokehnet.optics.aperture import Aperture
from tests.unit.onnx_file.running import compiled, decibels, picture, start, steps

TRIANGLE = np.float32([[-1, 0], [0.5, -(0.75**0.5)], [0.5, 0.75**0.5]])


def regular(corners, turn=0.5):
    """Corners of a polygon in the unit disc; an even one has an edge at the left, as in the package."""
    angles = 2 * np.pi * (np.arange(corners) + turn) / corners
    return np.stack([np.cos(angles), np.sin(angles)], 1).astype(np.float32)


@pytest.fixture(scope="module")
def spread():
    """``spread(image (H, W, 3), defocus, corners)`` to bokeh (H, W, 3)."""
    run = compiled(lambda g, x, d, corners: scatter(g, x, d, read_polygon(g, corners)), 3, 2, 2)
    return lambda image, *rest: run(image.transpose(2, 0, 1), *rest).transpose(1, 2, 0)


@pytest.mark.parametrize("radius", [6.0, -6.0, 25.0, -25.0])
@pytest.mark.parametrize("corners", [regular(6), regular(6)[::-1], regular(5, 0.0)])
def test_a_lamp_shows_the_blades_of_the_package(spread, radius, corners):
    image, defocus = np.full((71, 81, 3), 0.05, np.float32), np.full((71, 81), radius, np.float32)
    image[35, 40] = 3 * radius**2
    blades = Aperture(blades=len(corners))
    expected = package_scatter(image, defocus, aperture=blades)
    result = spread(image, defocus, corners)
    assert result.sum() == pytest.approx(expected.sum(), rel=1e-3)
    assert np.abs(result - expected).mean() < 0.01 * expected.max()


@pytest.mark.parametrize("radius", [20.0, -20.0])
def test_triangles_point_to_the_left_in_front_and_to_the_right_behind(spread, radius):
    image, defocus = np.zeros((61, 61, 3), np.float32), np.full((61, 61), radius, np.float32)
    image[30, 30] = 1000
    light = spread(image, defocus, TRIANGLE)[..., 0].sum(0)
    lit = np.nonzero(light > 1e-3 * light.max())[0] - 30
    ends = (-20, 10) if radius > 0 else (-10, 20)
    np.testing.assert_allclose((lit.min(), lit.max()), ends, atol=1)


def test_the_centroid_of_an_off_centre_polygon_is_kept(spread):
    corners = np.float32([[0.1, -0.6], [0.9, -0.6], [0.9, 0.2], [0.1, 0.2]])
    image, defocus = np.zeros((61, 61, 3), np.float32), np.full((61, 61), 20.0, np.float32)
    image[30, 30] = 1000
    light = spread(image, defocus, corners)[..., 0].astype(float)
    rows, columns = np.mgrid[:61, :61] - 30
    centroid = [(light * axis).sum() / light.sum() for axis in (columns, rows)]
    np.testing.assert_allclose(centroid, (10, -4), atol=0.02)


@pytest.mark.parametrize("radius", [9, 40, 90])
def test_many_corners_are_a_disc(spread, radius):
    image, defocus = picture(110, 130), steps(110, 130, radius)
    none = np.zeros((0, 2), np.float32)
    assert decibels(spread(image, defocus, regular(64)), spread(image, defocus, none)) > 39


def test_samples_of_a_polygon_are_as_even_as_those_of_the_disc():
    axis = (np.arange(200) + 0.5) / 100 - 1
    u, v = (x.ravel() for x in np.meshgrid(axis, axis))
    inside = u * u + v * v < 1
    u, v = u[inside], v[inside]
    run = compiled(lambda g, corners: list(read_polygon(g, corners).samples(u, v)), 2)
    x, y = run(TRIANGLE)
    assert len(x) == inside.sum()
    for k in range(3):
        corner, begin, end = (TRIANGLE[(k + i) % 3] for i in range(3))
        edge = end - begin
        distance = (x - begin[0]) * edge[1] - (y - begin[1]) * edge[0]
        fraction = distance / ((corner[0] - begin[0]) * edge[1] - (corner[1] - begin[1]) * edge[0])
        assert fraction.min() > -0.01
        for part in (0.25, 0.5, 0.75):  # the part beyond a line parallel to an edge is a smaller triangle
            assert (fraction > part).mean() == pytest.approx((1 - part) ** 2, abs=0.01)
    same_u, same_v = run(np.zeros((0, 2), np.float32))
    np.testing.assert_allclose((same_u, same_v), (u, v), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("front", "back"), [(9.0, -4.0), (0.0, -8.0)])
def test_rays_through_a_polygon_equal_those_of_the_package(front, back):
    session = start(renderer.build_model(engine="rays"), threads=2)
    y, x = np.mgrid[:90, :110].astype(np.float32)
    coverage = np.clip(20.5 - np.hypot(y - 45, x - 55), 0, 1)[..., None]
    image = np.float32(coverage * (0.9, 0.2, 0.1) + (1 - coverage) * (0.1, 0.3, 0.8))
    image[20, 20] = 40.0
    defocus = np.where(coverage[..., 0] > 0.5, front, back).astype(np.float32)
    numbers = {name: np.array(value, np.float32) for name, value in {"K": 1, "focus": 0, "gamma": 1}.items()}
    fed = {"image": image, "disparity": defocus, **numbers}
    expected = rays(image, defocus, aperture=Aperture(blades=3))
    assert decibels(session.run(None, {**fed, "aperture": regular(3, 0.0)})[0], expected) > 40
    assert decibels(session.run(None, fed)[0], expected) < 35
