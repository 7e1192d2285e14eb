"""The ray tracer against formulas: circle of confusion, conservation of light, geometry of planes."""

import math

import numpy as np
import pytest
import torch

from bokehnet.lenses import ThinLens
from bokehnet.raytrace import (
    Camera,
    Plane,
    Scene,
    background_from,
    plane_texture,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)

PITCH = 0.1


def constant(value, size=8):
    return np.full((size, size, 3), value, np.float32)


def facing_plane(texture, depth, half, centre=(0.0, 0.0)):
    return Plane(texture=texture, centre=(*centre, depth), u_axis=(half, 0.0, 0.0), v_axis=(0.0, half, 0.0))


def camera(size, focus_distance, f_number=2.0):
    lens = ThinLens(focal_length=50.0, f_number=f_number, focus_distance=focus_distance)
    return Camera(lens=lens, width=size, height=size, pixel_pitch=PITCH)


def black(disparity=0.0):
    return background_from(constant(0.0), (1.0, 1.0), disparity)


@pytest.mark.parametrize(
    ("depth", "focus_distance"), [(800.0, 1200.0), (3000.0, 1200.0), (900.0, math.inf), (5000.0, 900.0)]
)
def test_small_emitter_gives_a_disc_with_the_radius_and_energy_of_the_formula(depth, focus_distance):
    """Authority: coc_radius; uniform discs have <l**2> = r**2 / 2; a thin lens loses no light."""
    view = camera(64, focus_distance, f_number=1.4)
    side = 5.0  # pixels
    half = side / 2 * PITCH * depth / view.lens.sensor_distance
    scene = Scene(
        background=black(),
        planes=(facing_plane(plane_texture(constant(50.0, 64)), depth, half, (half, half / 2)),),
    )
    bokeh = render_bokeh(scene, view, 4096, seed=1)[..., 0].double()
    sharp = render_all_in_focus(scene, view, 1024, seed=2)[..., 0].double()
    y, x = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    centre_x, centre_y = ((bokeh * axis).sum() / bokeh.sum() for axis in (x, y))
    spread = (bokeh * ((x - centre_x) ** 2 + (y - centre_y) ** 2)).sum() / bokeh.sum()
    square = side**2 / 6 + 1 / 6  # second moments of the emitter and of the pixel
    radius = math.sqrt(2 * float(spread - square))
    assert radius == pytest.approx(abs(view.lens.coc_radius(1 / depth)) / PITCH, abs=0.1)
    assert float(bokeh.sum() / sharp.sum()) == pytest.approx(1, abs=1e-3)
    # Upright picture: the emitter is right of and below the axis.
    assert float(centre_x) == pytest.approx(31.5 + side / 2, abs=0.02)
    assert float(centre_y) == pytest.approx(31.5 + side / 4, abs=0.02)


def test_plane_in_focus_is_as_sharp_as_the_all_in_focus_picture():
    """Authority: all rays of a sensor point meet in the focal plane."""
    picture = np.random.default_rng(3).random((48, 48, 3), np.float32)
    scene = Scene(background=black(), planes=(facing_plane(plane_texture(picture), 1000.0, 200.0),))
    view = camera(32, 1000.0, f_number=1.0)
    bokeh, sharp = render_bokeh(scene, view, 256, seed=0), render_all_in_focus(scene, view, 256, seed=1)
    assert float((bokeh - sharp).abs().max()) < 0.01


def test_background_at_infinity_is_sharp_when_focused_there_and_blurs_by_the_formula():
    """Authority: coc_radius at disparity 0; a step edge seen through a disc rises over two radii."""
    step = np.zeros((256, 256, 3), np.float32)
    step[:, 128:] = 1
    scene = Scene(background=background_from(step, (0.2, 0.2), 0.0))
    sharp = render_bokeh(scene, camera(64, math.inf), 64, seed=0)[32, :, 0]
    assert float(sharp[30]) < 1e-6
    assert float(sharp[33]) > 1 - 1e-6
    view = camera(64, 1500.0)
    radius = abs(view.lens.coc_radius(0.0)) / PITCH
    row = render_bokeh(scene, view, 256, seed=0)[..., 0].mean(0).double()
    offset = (torch.arange(64, dtype=torch.float64) - 31.5).clamp(-radius, radius) / radius
    edge = 0.5 + (offset * (1 - offset**2).sqrt() + offset.asin()) / math.pi
    assert float((row - edge).abs().max()) < 0.01
    assert float(render_disparity(scene, view).abs().max()) == 0


def test_disparity_of_a_tilted_plane_is_linear_in_the_picture():
    """Authority: n . p = d and p = z * (slope, 1) give 1 / z = n . (slope, 1) / d."""
    tilt = math.radians(50)
    axis = (400 * math.cos(tilt), 0.0, 400 * math.sin(tilt))
    plane = Plane(texture=plane_texture(constant(0.5)), centre=(0, 0, 1000), u_axis=axis, v_axis=(0, 400, 0))
    view = camera(32, 1000.0)
    disparity = render_disparity(Scene(background=black(), planes=(plane,)), view).double()
    slope_x = (torch.arange(32, dtype=torch.float64) - 15.5) * PITCH / view.lens.sensor_distance
    expected = (math.cos(tilt) - math.sin(tilt) * slope_x) / (1000 * math.cos(tilt))
    assert torch.allclose(disparity, expected.expand(32, -1), rtol=1e-5, atol=0)


def test_crossing_planes_hide_each_other_on_both_sides_of_the_crossing():
    """Authority: of two planes that cross at x = 0 the nearer one is seen, on each side."""
    red, green = np.float32([1, 0, 0]), np.float32([0, 1, 0])
    planes = [
        Plane(
            texture=plane_texture(constant(1.0) * colour), centre=(0, 0, 1000), u_axis=u, v_axis=(0, 300, 0)
        )
        for colour, u in ((red, (300.0, 0.0, 250.0)), (green, (300.0, 0.0, -250.0)))
    ]
    for ordered in (planes, planes[::-1]):
        scene = Scene(background=black(), planes=tuple(ordered))
        for picture in (
            render_bokeh(scene, camera(32, 1000.0), 16, seed=0),
            render_all_in_focus(scene, camera(32, 1000.0), 16, seed=0),
        ):
            assert torch.allclose(picture[:, :14], torch.tensor(red).expand(32, 14, 3), atol=1e-5)
            assert torch.allclose(picture[:, 18:], torch.tensor(green).expand(32, 14, 3), atol=1e-5)


def test_half_transparent_planes_composite_front_to_back():
    """Authority: Porter and Duff's "over", "Compositing digital images", 1984."""
    half = np.full((8, 8), 0.5, np.float32)
    planes = tuple(
        facing_plane(plane_texture(constant(value), half), depth, 0.5 * depth)
        for value, depth in ((8.0, 3000.0), (2.0, 1000.0), (4.0, 2000.0))
    )
    scene = Scene(background=background_from(constant(16.0), (1, 1)), planes=planes)
    picture = render_bokeh(scene, camera(16, 1500.0), 4, seed=0)
    assert torch.allclose(picture, torch.full_like(picture, 2 / 2 + 4 / 4 + 8 / 8 + 16 / 8), rtol=1e-5)


def test_noise_falls_at_least_with_the_square_root_of_the_samples():
    """Authority: Monte Carlo error n**-0.5, which stratified points may only improve."""
    picture = np.random.default_rng(5).random((24, 24, 3), np.float32)
    near = facing_plane(plane_texture(picture[::-1].copy()), 800.0, 40.0, (20.0, 0.0))
    scene = Scene(background=background_from(picture, (0.04, 0.04)), planes=(near,))
    view = camera(24, 1500.0)
    truth = render_bokeh(scene, view, 4096, seed=9)
    errors = [
        float((render_bokeh(scene, view, samples, seed=samples) - truth).square().mean().sqrt())
        for samples in (16, 64)
    ]
    assert errors[0] > 1e-3
    assert errors[1] < 0.5 * errors[0]
