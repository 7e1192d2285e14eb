"""The thick lens between the thin one and real glass."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bokehnet.errors import LensError
from bokehnet.lenses import ThickLens, ThinLens

XY = np.array([[0.0, 0.0], [3.0, -7.0], [-11.0, 2.0]])
UV = np.array([[0.2, 0.9], [-1.0, 0.0], [0.3, -0.4]])


@pytest.mark.parametrize("focus", [700.0, math.inf])
@pytest.mark.parametrize("offset", [None, 0.4, np.array([-0.2, 0.0, 0.3])])
def test_with_planes_and_pupils_in_one_place_it_is_the_thin_lens(focus, offset):
    thin = ThinLens(focal_length=50.0, f_number=2.0, focus_distance=focus)
    thick = ThickLens(focal_length=50.0, f_number=2.0, focus_distance=focus)
    a, b = (lens.sample_rays(XY, UV, sensor_offset=offset) for lens in (thin, thick))
    assert_allclose(b.origin, a.origin)
    assert_allclose(b.slope, a.slope, atol=1e-15)
    assert thick.sensor_distance == pytest.approx(thin.sensor_distance)
    assert thick.coc_radius(1 / 300) == pytest.approx(thin.coc_radius(1 / 300))
    points = np.array([[20.0, 30.0, 400.0]])
    for mine, reference in zip(thick.image_of(points), thin.image_of(points), strict=True):
        assert_allclose(mine, reference)


@pytest.mark.parametrize("principal_depth", [-30.0, 45.0])
@pytest.mark.parametrize("focus", [800.0, math.inf])
def test_blur_is_what_rays_from_the_sensor_spread_at_the_scale_of_the_image(principal_depth, focus):
    """A point at depth z is sharp d mm behind the sensor; the cone to its image has the exit pupil as base.

    Radius by similar triangles in image space: R' d / (distance of the image from the exit pupil).
    """
    lens = ThickLens(focal_length=85.0, f_number=1.8, focus_distance=focus, principal_depth=principal_depth)
    for depth in (350.0, 2000.0):
        _, behind = lens.image_of(np.array([0.0, 0.0, depth]))
        exit_radius = lens.pupil_radius * abs(lens.exit_magnification)
        expected = exit_radius * behind / (lens.exit_pupil_distance + behind)
        assert lens.coc_radius(1 / depth) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("principal_depth", [-30.0, 45.0])
def test_a_sensor_further_back_is_focused_on_what_is_imaged_there(principal_depth):
    lens = ThickLens(focal_length=85.0, f_number=1.8, focus_distance=900.0, principal_depth=principal_depth)
    point = np.array([50.0, -80.0, 600.0])
    xy, behind = lens.image_of(point)
    rays = lens.sample_rays(np.broadcast_to(xy, (3, 2)), UV, sensor_offset=behind)
    assert_allclose(rays.origin + 600 * rays.slope, np.broadcast_to(point[:2], (3, 2)), atol=1e-10)


def test_focus_inside_the_front_focal_point_is_refused():
    with pytest.raises(LensError, match="cannot focus at 100 mm: need more than 120 mm"):
        ThickLens(focal_length=80.0, f_number=2.0, focus_distance=100.0, principal_depth=40.0)
