"""Real glass as a lens model."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from bokehnet.errors import LensError
from bokehnet.lenses import Rays, load_lens
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.vignette import disc_form_factor

UV = disc_from_square(np.stack([halton(256, 2), halton(256, 3)], -1))


@pytest.fixture(scope="module")
def gauss():
    return load_lens("double_gauss", focal_length=50.0, focus_distance=1500.0)


def test_stopped_down_rays_meet_in_the_focal_plane(gauss):
    """Gauss: near the axis every lens is perfect; the pinhole's blur is the size of the spot here."""
    lens = dataclasses.replace(gauss, f_number=22.0)
    rays = lens.sample_rays(np.tile([0.5, -0.3], (256, 1)), UV)
    met = rays.origin + 1500 * rays.slope
    ideal = lens.thick.sample_rays(np.array([0.5, -0.3]), np.zeros(2))
    assert_allclose(met, np.tile(1500 * ideal.slope, (256, 1)), atol=0.02)
    assert np.abs(met - met.mean(axis=0)).max() < 0.02


def test_light_sent_back_from_the_scene_reaches_the_sensor_point_that_it_came_from(gauss):
    xy = np.tile([6.0, -9.0], (256, 1))
    rays = gauss.sample_rays(xy, UV, wavelength=500.0)
    reached, passes = gauss.trace_to_sensor(rays, wavelength=500.0)
    assert_allclose(reached[rays.weight > 0], xy[rays.weight > 0], atol=1e-9)
    assert passes[rays.weight > 0].all()


def test_focusing_moves_the_lens_by_the_newton_formula():
    """x x' = f^2, both from the focal points."""
    lens = load_lens("telephoto", focus_distance=5000.0, focusing="paraxial")
    front = lens.focus_distance - (lens.paraxial.entrance.position - lens.paraxial.cardinal.front_focus)
    travel = lens.sensor_position - lens.paraxial.cardinal.rear_focus
    assert travel == pytest.approx(lens.focal_length**2 / front)


def test_impossible_settings_are_refused():
    with pytest.raises(LensError, match=r"Retrofocus.*cannot focus at 70 mm.*front of the lens is 70.94"):
        load_lens("retrofocus", focus_distance=70.0)
    with pytest.raises(LensError, match=r"Double Gauss.*cannot focus at 90 mm"):
        load_lens("double_gauss", focus_distance=90.0)
    with pytest.raises(LensError, match=r"f-number: expected 2.01 or more, got 1.4"):
        load_lens("double_gauss", f_number=1.4)


def test_the_engraved_f_number_is_the_fully_open_lens():
    assert load_lens("double_gauss", f_number=2.0).stop_radius == load_lens("double_gauss").stop_radius


def test_f_number_sets_the_entrance_pupil():
    lens = load_lens("cooke_triplet", f_number=8.0)
    assert 2 * lens.paraxial.entrance.radius == pytest.approx(lens.focal_length / 8)


def test_array_of_wavelengths_is_each_wavelength_alone(gauss):
    wavelength = np.linspace(420, 680, 256)
    xy = np.tile([8.0, 3.0], (256, 1))
    together = gauss.sample_rays(xy, UV, wavelength)
    for i in (0, 100, 255):
        alone = gauss.sample_rays(xy[i], UV[i], wavelength[i])
        assert_allclose(together.slope[i], alone.slope, rtol=1e-12)
    design = gauss.sample_rays(xy, UV)
    assert np.abs(together.slope - design.slope).max() > 1e-5
    assert_allclose(gauss.sample_rays(xy, UV, gauss.prescription.design_wavelength).slope, design.slope)


def test_torch_gives_the_rays_of_numpy(gauss):
    xy = np.random.default_rng(0).uniform(-14, 14, (256, 2))
    xy[0] = 0
    array = gauss.sample_rays(xy, UV, wavelength=np.full(256, 480.0))
    tensor = gauss.sample_rays(
        *map(torch.from_numpy, (xy, UV)), wavelength=torch.full((256,), 480.0, dtype=torch.float64)
    )
    for name in ("origin", "slope", "weight"):
        assert_allclose(getattr(tensor, name).numpy(), getattr(array, name), rtol=1e-11, atol=1e-12)
    single = gauss.sample_rays(torch.from_numpy(xy).float(), torch.from_numpy(UV).float())
    assert single.slope.dtype == single.weight.dtype == torch.float32
    assert_allclose(single.slope.numpy(), gauss.sample_rays(xy, UV).slope, atol=2e-6)


def test_gradients_are_right_and_finite_for_lost_rays(gauss):
    xy = torch.tensor([[2.0, -3.0], [0.0, 0.0], [9.0, 9.0]], dtype=torch.float64, requires_grad=True)
    uv = torch.tensor([[0.3, 0.1], [-0.6, 0.2], [0.1, 0.5]], dtype=torch.float64, requires_grad=True)
    wavelength = torch.tensor([450.0, 550.0, 650.0], dtype=torch.float64, requires_grad=True)

    def slopes(*inputs):
        rays = gauss.sample_rays(*inputs)
        return rays.origin, rays.slope

    # The axis itself is a corner of the aim, where the direction to it is undefined; it is only finite.
    off_axis = [values[[0, 2]].detach().requires_grad_() for values in (xy, uv, wavelength)]
    assert torch.autograd.gradcheck(slopes, off_axis)
    wide = dataclasses.replace(gauss, pupil_sampling="exit")
    rays = wide.sample_rays(xy * 30, uv)
    assert (rays.weight == 0).any()
    for gradient in torch.autograd.grad(rays.slope.sum() + rays.weight.sum(), (xy, uv)):
        assert gradient.isfinite().all()


def test_weights_without_vignetting_are_the_form_factor_of_the_exit_pupil():
    """Exact irradiance by Moon and Spencer; the singlet's stop alone clips."""
    lens = dataclasses.replace(load_lens("biconvex"), pupil_sampling="exit")
    radius, distance = lens.paraxial.exit.radius, lens.sensor_position - lens.paraxial.exit.position
    for field in (0.0, 10.0, 20.0):
        weight = lens.sample_rays(np.tile([0.0, field], (256, 1)), UV).weight
        expected = disc_form_factor(field, distance, radius) * (distance / radius) ** 2
        assert weight.mean() == pytest.approx(expected, rel=5e-4)


def test_the_middle_of_the_pupil_looks_from_the_origin():
    """z = 0 is the entrance pupil: chief rays of small fields cross it on the axis."""
    for name in ("retrofocus", "telephoto"):
        lens = load_lens(name, f_number=11.0)
        rays = lens.sample_rays(np.array([0.5, 0.0]), np.zeros(2))
        assert abs(rays.origin[0]) < 1e-3 * lens.thick.pupil_radius
        assert rays.slope[0] == pytest.approx(-0.5 / lens.sensor_distance, rel=1e-3)


@pytest.mark.parametrize("name", ["double_gauss", "retrofocus", "telephoto"])
def test_the_disc_is_the_entrance_pupil_upright(name):
    """At a small iris real glass sends the rays of the perfect lens, so aperture shapes keep their side."""
    lens = load_lens(name, f_number=16.0)
    real, perfect = (one.sample_rays(np.zeros((256, 2)), UV) for one in (lens, lens.thick))
    assert_allclose(real.origin, perfect.origin, atol=0.04 * lens.thick.pupil_radius)


def test_infinite_focus_sends_parallel_rays():
    lens = load_lens("petzval", f_number=16.0)
    assert math.isinf(lens.focus_distance)
    slope = lens.sample_rays(np.tile([1.0, 1.0], (256, 1)), UV).slope
    assert np.ptp(slope, axis=0).max() < 2e-5


def test_rays_may_carry_no_weight():
    assert Rays(origin=UV, slope=UV).weight is None
