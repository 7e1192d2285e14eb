import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.lenses import Rays, ThinLens
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    background_from,
    plane_texture,
    render_all_in_focus,
    render_bokeh,
)
from bokehnet.raytrace.geometry.intersect import centre_rays, look_up_background, prepare_plane


def camera(height=24, width=32, f_number=0.7, focus_distance=1500.0):
    lens = ThinLens(focal_length=50.0, f_number=f_number, focus_distance=focus_distance)
    return Camera(lens=lens, width=width, height=height, pixel_pitch=36 / width)


def random_scene(seed, count=6):
    """Small and large planes, many of which cross or overlap in depth."""
    rng = np.random.default_rng(seed)
    planes = []
    for _ in range(count):
        texture = plane_texture(rng.random((9, 7, 3), np.float32), rng.random((9, 7), np.float32))
        u, v = rng.uniform(50, 500) * rng.normal(size=3), rng.uniform(50, 500) * rng.normal(size=3)
        depth = 300 + abs(u[2]) + abs(v[2]) + rng.uniform(0, 800)
        centre = (*rng.uniform(-200, 200, 2), depth)
        planes.append(Plane(texture=texture, centre=centre, u_axis=tuple(u), v_axis=tuple(v)))
    return Scene(
        background=background_from(rng.random((8, 8, 3), np.float32), (0.4, 0.3)), planes=tuple(planes)
    )


class OneRayPerPixel:
    """A lens that gives the same prepared rays for any request, to compare single passes."""

    def __init__(self, lens, shape, seed):
        self.lens = lens
        generator = torch.Generator().manual_seed(seed)
        self.angle = 2 * torch.pi * torch.rand(*shape, 1, generator=generator)

    def coc_radius(self, disparity):
        return self.lens.coc_radius(disparity)

    def sample_rays(self, sensor_xy, pupil_uv):
        if sensor_xy.shape[:2] != self.angle.shape[:2] or not pupil_uv.any():
            return self.lens.sample_rays(sensor_xy, pupil_uv)
        return self.rays(torch.float32)

    def rays(self, dtype):
        view = camera(*self.angle.shape[:2])
        rim = torch.cat([self.angle.cos(), self.angle.sin()], -1).to(dtype)
        return self.lens.sample_rays(view.sensor_xy(rim.device, dtype), rim)


@pytest.mark.parametrize("seed", range(12))
def test_every_ray_meets_planes_in_the_order_of_their_depth(seed):
    """Oracle: all planes traced over the whole picture and sorted ray by ray."""
    scene, view = random_scene(seed), camera()
    lens = OneRayPerPixel(view.lens, (view.height, view.width), seed)
    view = Camera(lens=lens, width=view.width, height=view.height, pixel_pitch=view.pixel_pitch)
    rays = lens.rays(torch.float32)
    expected = look_up_background(scene.background, rays).numpy().copy()
    hits = []
    for plane in scene.planes:
        prepared = prepare_plane(plane, view, centre_rays(view, torch.device("cpu"), torch.float32))
        if prepared is not None:
            seen, depth = prepared.intersect(rays)
            hits.append((seen.numpy(), np.where(seen[3] > 0, depth, 0)))
    assert len(hits) > 2
    for row, column in np.ndindex(view.height, view.width):
        for seen, _ in sorted(hits, key=lambda hit: -hit[1][row, column]):
            pixel = seen[:, row, column]
            expected[:, row, column] = pixel[:3] + (1 - pixel[3]) * expected[:, row, column]
    picture = render_bokeh(scene, view, 1, seed=0)
    assert np.allclose(picture.permute(2, 0, 1), expected, atol=1e-5)


def test_float64_scene_gives_a_float64_picture_that_agrees_with_float32():
    scene = random_scene(3)
    doubled = Scene(
        background=Background(texture=scene.background.texture.double(), half_extent=(0.4, 0.3)),
        planes=tuple(
            Plane(texture=p.texture.double(), centre=p.centre, u_axis=p.u_axis, v_axis=p.v_axis)
            for p in scene.planes
        ),
    )
    view = camera(width=24, height=16)
    single, double = (render_all_in_focus(s, view, 256, seed=1) for s in (scene, doubled))
    assert double.dtype == torch.float64
    assert float((single - double).abs().mean()) < 5e-3


def test_seed_decides_the_noise_and_progress_counts_the_passes():
    scene, view, calls = random_scene(1), camera(), []
    first = render_bokeh(scene, view, 3, seed=5, progress=lambda done, total: calls.append((done, total)))
    assert torch.equal(first, render_bokeh(scene, view, 3, seed=5))
    assert not torch.equal(first, render_bokeh(scene, view, 3, seed=6))
    assert calls == [(1, 3), (2, 3), (3, 3)]
    assert first.shape == (24, 32, 3)


def test_rays_parallel_to_a_plane_or_behind_it_do_not_hit_it():
    """Authority: a wall along the axis covers the slopes from x / farthest to x / nearest, no others."""
    texture = plane_texture(np.ones((64, 64, 3), np.float32))
    wall = Plane(texture=texture, centre=(200, 0, 2000), u_axis=(0, 0, 1000), v_axis=(0, 5000, 0))
    scene = Scene(background=background_from(np.zeros((4, 4, 3), np.float32), (1, 1)), planes=(wall,))
    view = camera(height=8, width=96)
    picture = render_all_in_focus(scene, view, 64, seed=0)
    step = view.pixel_pitch / view.lens.sensor_distance
    left, right = (200 / depth / step + 48 for depth in (3000, 1000))
    assert float(picture[:, : int(left) - 1].abs().max()) == 0
    assert float(picture[:, int(right) + 2 :].abs().max()) == 0
    assert float(picture[:, int(left) + 2 : int(right) - 1].min()) == pytest.approx(1)


def test_prepared_plane_follows_rays_of_any_origin():
    """Authority: centre + a * u + b * v solved for depth by numpy.linalg.solve."""
    rng = np.random.default_rng(0)
    ramp = np.zeros((64, 64, 3), np.float32)
    ramp[..., 0], ramp[..., 1] = np.linspace(0, 1, 64)[None], np.linspace(0, 1, 64)[:, None]
    plane = Plane(
        texture=plane_texture(ramp), centre=(30, 20, 900), u_axis=(300, 20, 150), v_axis=(-30, 250, 90)
    )
    view = camera()
    prepared = prepare_plane(plane, view, centre_rays(view, torch.device("cpu"), torch.float64))
    origin, slope = rng.uniform(-20, 20, 2), rng.uniform(-0.05, 0.05, 2)
    rays = Rays(origin=torch.tensor(origin).reshape(1, 1, 2), slope=torch.tensor(slope).reshape(1, 1, 2))
    object.__setattr__(prepared, "texture", prepared.texture.double())
    seen, depth = prepared.intersect(rays)
    matrix = np.stack([plane.u_axis, plane.v_axis, [-slope[0], -slope[1], -1]], 1).astype(float)
    a, b, z = np.linalg.solve(matrix, np.array([*origin, 0]) - plane.centre)
    assert float(depth) == pytest.approx(z)
    texel = (np.array([a, b]) * 32.5 + 31.5) / 63  # a linear ramp; half a texel of fading at each end
    assert seen[:2, 0, 0].tolist() == pytest.approx(texel.tolist(), abs=1e-6)


def test_bad_scenes_are_refused_with_what_was_expected():
    texture = plane_texture(np.ones((4, 4, 3), np.float32))
    with pytest.raises(ParameterError, match="all corners at z > 0, got the nearest at"):
        Plane(texture=texture, centre=(0, 0, 10), u_axis=(0, 0, 20), v_axis=(0, 1, 0))
    with pytest.raises(ParameterError, match="different axes"):
        Plane(texture=texture, centre=(0, 0, 10), u_axis=(1, 0, 0), v_axis=(2, 0, 0))
    with pytest.raises(ShapeError, match=r"\(4, Ht, Wt\)"):
        Plane(texture=texture[:3], centre=(0, 0, 10), u_axis=(1, 0, 0), v_axis=(0, 1, 0))
    with pytest.raises(ParameterError, match="disparity"):
        Background(texture=texture[:3], half_extent=(1, 1), disparity=-0.1)
    with pytest.raises(ShapeError, match="must agree"):
        plane_texture(np.ones((4, 4, 3), np.float32), np.ones((5, 4), np.float32))
    with pytest.raises(ParameterError, match="samples_per_pixel"):
        render_bokeh(random_scene(0), camera(), 0, seed=0)
