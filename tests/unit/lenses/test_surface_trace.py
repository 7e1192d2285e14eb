"""Refraction at single surfaces against formulas, and rays that do not get through."""

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.lenses.surface_trace import Surface, beam_between, trace

PLANE = Surface(vertex=10.0, curvature=0.0, semi_diameter=50.0, before=1.0, behind=1.5)


def parallel(height, xp=np):
    return beam_between((height, 0 * height, 0 * height - 20.0), (height, 0 * height, 0 * height))


def test_a_plane_bends_by_the_law_of_snell():
    angle = np.radians([5.0, 30.0, 60.0])
    beam = trace([PLANE], beam_between((0.0, 0.0, 0.0), (np.sin(angle), 0.0, np.cos(angle))))
    assert_allclose(beam.direction[0], np.sin(angle) / 1.5)
    assert_allclose(beam.position[0], 10 * np.tan(angle))
    assert beam.passes.all()


def test_rays_meet_the_sphere_where_it_is():
    sphere = Surface(vertex=3.0, curvature=1 / 20, semi_diameter=19.0, before=1.0, behind=1.7)
    height = np.linspace(-18, 18, 13)
    x, y, t = trace([sphere], parallel(height)).position
    assert_allclose(x * x + y * y + (t - 23) ** 2, 400)


def test_an_ellipsoid_of_the_right_conic_focuses_parallel_light_in_one_point():
    """Descartes: conic -1 / n^2, focus at n R / (n - 1) behind the vertex, for any aperture."""
    n, radius = 1.6, 30.0
    surface = Surface(vertex=0.0, curvature=1 / radius, semi_diameter=25.0, conic=-1 / n**2, behind=n)
    beam = trace([surface], parallel(np.linspace(-24, 24, 9)))
    assert_allclose(beam.at(n * radius / (n - 1))[0], 0, atol=1e-10)
    spherical = Surface(vertex=0.0, curvature=1 / radius, semi_diameter=25.0, behind=n)
    assert abs(trace([spherical], parallel(np.array([24.0]))).at(n * radius / (n - 1))[0]) > 1


def test_light_goes_the_same_way_back():
    surfaces = [
        Surface(vertex=0.0, curvature=1 / 40, semi_diameter=20.0, conic=0.3, behind=1.6),
        Surface(vertex=8.0, curvature=-1 / 25, semi_diameter=20.0, conic=-0.5, before=1.6, behind=1.3),
    ]
    start = beam_between((np.linspace(-8, 8, 5), 3.0, -10.0), (np.linspace(-9, 10, 5), 2.0, 0.0))
    ahead = trace(surfaces, start)
    x, y, t = ahead.position
    dx, dy, dt = ahead.direction
    back = trace(surfaces, beam_between((x + 5 * dx, y + 5 * dy, t + 5 * dt), (x, y, t)), backwards=True)
    assert_allclose(back.at(-10.0), start.at(-10.0), atol=1e-10)
    assert_allclose(back.direction, [-d for d in start.direction], atol=1e-12)


def test_total_reflection_begins_at_the_critical_angle():
    out = Surface(vertex=1.0, curvature=0.0, semi_diameter=50.0, before=1.5, behind=1.0)
    critical = math.asin(1 / 1.5)
    angle = np.array([critical - 1e-3, critical + 1e-3, 1.4])
    beam = trace([out], beam_between((0.0, 0.0, 0.0), (np.sin(angle), 0.0, np.cos(angle))))
    assert_allclose(beam.passes, [True, False, False])
    assert np.isfinite(beam.direction).all()


def test_rims_and_stop_clip_apart():
    stop = Surface(vertex=5.0, curvature=0.0, semi_diameter=2.0, stop=True)
    beam = trace([PLANE, stop], parallel(np.array([1.0, 3.0, 60.0])), backwards=False)
    assert_allclose(beam.stop_fill, [0.5, 1.5, 30])
    assert_allclose(beam.fill, [0.02, 0.06, 1.2])
    assert_allclose(beam.passes, [True, False, False])


def test_lost_rays_stay_finite_and_so_do_gradients():
    """A ball lens: rays miss it, are clipped, or are totally reflected at its back."""
    surfaces = [
        Surface(vertex=0.0, curvature=1 / 10, semi_diameter=9.9, behind=1.9),
        Surface(vertex=12.0, curvature=-1 / 6, semi_diameter=5.9, before=1.9),
        Surface(vertex=13.0, curvature=1 / 7, semi_diameter=6.0, behind=2.0),
    ]
    height = torch.linspace(-40, 40, 161, requires_grad=True)
    beam = trace(surfaces, parallel(height))
    assert 0 < beam.passes.float().mean() < 1
    for values in (*beam.position, *beam.direction, beam.fill):
        assert values.isfinite().all()
        (gradient,) = torch.autograd.grad(values.sum(), height, retain_graph=True, allow_unused=True)
        assert gradient is None or gradient.isfinite().all()


def test_numpy_and_torch_trace_the_same_rays():
    surface = Surface(vertex=0.0, curvature=1 / 30, semi_diameter=25.0, conic=-0.4, behind=1.6)
    height = np.linspace(-28, 28, 15)
    array, tensor = trace([surface], parallel(height)), trace([surface], parallel(torch.from_numpy(height)))
    assert_allclose(torch.stack(tensor.position).numpy(), array.position, rtol=1e-13)
    assert_allclose(tensor.passes.numpy(), array.passes)


def test_gradients_by_ray_and_by_lens_are_right():
    def final(height, curvature, conic, index):
        surfaces = [
            Surface(vertex=0.0, curvature=curvature, semi_diameter=20.0, conic=conic, behind=index),
            Surface(vertex=5.0, curvature=-0.02, semi_diameter=20.0, before=index),
        ]
        beam = trace(surfaces, beam_between((height, 0.5, -30.0), (height, 0.2 * height, 0.0)))
        return torch.stack([*beam.at(60.0), *beam.direction])

    height = torch.tensor([-6.0, 0.0, 4.0], dtype=torch.float64, requires_grad=True)
    numbers = [torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (0.03, -0.5, 1.6)]
    assert torch.autograd.gradcheck(final, (height, *numbers))


@pytest.mark.parametrize("sign", [-1, 1])
def test_one_index_per_ray_is_one_wavelength_per_ray(sign):
    index = np.array([1.5, 1.6])
    both = Surface(vertex=0.0, curvature=sign / 30, semi_diameter=25.0, behind=index)
    beam = trace([both], parallel(np.array([7.0, 7.0])))
    for i, one in enumerate(index):
        single = Surface(vertex=0.0, curvature=sign / 30, semi_diameter=25.0, behind=one)
        alone = trace([single], parallel(np.array([7.0])))
        assert beam.direction[0][i] == pytest.approx(alone.direction[0][0])
