"""Matrices against the formulas that they replace."""

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.optics.paraxial import (
    RayMatrix,
    cardinal_points,
    entrance_pupil,
    exit_pupil,
    focused_rays,
    image_points,
)


def thick_singlet(index, front, back, thickness):
    return RayMatrix().refract((index - 1) / front).travel(thickness / index).refract((1 - index) / back)


def test_focal_length_is_that_of_the_lens_makers_formula():
    index, front, back, thickness = 1.5, 40.0, -70.0, 9.0
    system = thick_singlet(index, front, back, thickness)
    inverse = (index - 1) * (1 / front - 1 / back + (index - 1) * thickness / (index * front * back))
    assert cardinal_points(system, thickness).focal_length == pytest.approx(1 / inverse)


def test_principal_planes_are_those_of_the_thick_lens_formula():
    """Hecht, "Optics", 6.1: h1 = -f (n - 1) d / (R2 n), h2 = -f (n - 1) d / (R1 n)."""
    index, front, back, thickness = 1.6, 55.0, -35.0, 7.0
    points = cardinal_points(thick_singlet(index, front, back, thickness), thickness)
    common = -points.focal_length * (index - 1) * thickness / index
    assert points.front_principal == pytest.approx(common / back)
    assert points.rear_principal == pytest.approx(thickness + common / front)
    assert points.front_principal - points.front_focus == pytest.approx(points.focal_length)
    assert points.rear_focus - points.rear_principal == pytest.approx(points.focal_length)


def test_stop_before_a_thin_lens_is_its_own_entrance_pupil_and_the_lens_images_it():
    """Gauss: a stop 20 mm before f = 50 mm appears 33.3 mm before the lens, 5/3 as large."""
    assert entrance_pupil(RayMatrix(), 4.0).position == 0
    behind = RayMatrix().travel(20.0).refract(1 / 50)
    pupil = exit_pupil(behind, 20.0, 4.0)
    assert pupil.position == pytest.approx(20 - 100 / 3)
    assert pupil.radius == pytest.approx(4 * 5 / 3)


def test_stop_behind_a_thin_lens_mirrors_the_stop_before_it():
    pupil = entrance_pupil(RayMatrix().refract(1 / 50).travel(20.0), 4.0)
    assert pupil.position == pytest.approx(100 / 3)
    assert pupil.radius == pytest.approx(4 * 5 / 3)


def test_arrays_of_indices_give_arrays_of_focal_lengths():
    index = np.array([1.5, 1.6])
    together = cardinal_points(thick_singlet(index, 40.0, -70.0, 9.0), 9.0)
    alone = [cardinal_points(thick_singlet(float(n), 40.0, -70.0, 9.0), 9.0).focal_length for n in index]
    assert_allclose(together.focal_length, alone)


@pytest.mark.parametrize("depth", [-40.0, 0.0, 25.0])
def test_rays_from_an_image_point_meet_in_the_object_point(depth):
    """Imaging and ray generation are each other's inverse, wherever the principal plane lies."""
    points = np.array([[30.0, -20.0, 900.0], [0.0, 5.0, 2500.0]])
    xy, distance = image_points(points, 80.0, depth)
    for origin in (np.zeros((2, 2)), np.array([[6.0, -3.0], [-9.0, 1.0]])):
        slope = focused_rays(xy, origin, 80.0, depth, distance[:, None])
        assert_allclose(origin + points[:, 2:] * slope, points[:, :2], atol=1e-9)


def test_slopes_have_gradients_also_at_infinite_focus():
    xy = torch.tensor([[3.0, -4.0]], dtype=torch.float64, requires_grad=True)
    origin = torch.tensor([[1.0, 2.0]], dtype=torch.float64, requires_grad=True)
    distance = torch.tensor([[80.0]], dtype=torch.float64, requires_grad=True)
    inputs = (xy, origin, distance)
    assert torch.autograd.gradcheck(lambda a, b, c: focused_rays(a, b, 80.0, 5.0, c), inputs)
