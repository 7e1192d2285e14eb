import numpy as np
import pytest

from bokehnet.lenses import Rays, ThinLens
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    plane_texture,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)
from bokehnet.synth.clutter.baked_scene import BakedScene, View, make_soup, pack
from bokehnet.synth.clutter.grid_mesh import GridMesh

pytest.importorskip("embreex", reason="Embree is not installed: pip install 'bokehnet[trace]'")

PITCH = 36 / 48
PINHOLE = ThinLens(focal_length=50.0, f_number=1.0)
LENS = ThinLens(focal_length=50.0, f_number=0.4, focus_distance=1600.0)


def view(samples, seed=0):
    return View(width=48, height=48, pixel_pitch=PITCH, samples=samples, seed=seed)


def picture_of(rng, rows, columns):
    """Blocks with a margin of nothing new, so that the borders of textures do not matter."""
    return np.kron(rng.random((rows // 4, columns // 4, 3)), np.ones((4, 4, 1))).astype(np.float32)


@pytest.fixture(scope="module")
def scenes():
    """A tilted card before an endless wall at infinity, for both renderers; light is 0.5 everywhere."""
    rng = np.random.default_rng(0)
    card, sky = picture_of(rng, 24, 32), picture_of(rng, 40, 40)
    centre, u, v = (np.array(axis, float) for axis in ((60, -20, 1200), (180, 30, 150), (-20, 160, 60)))
    plane = Plane(texture=plane_texture(0.5 * card), centre=tuple(centre), u_axis=tuple(u), v_axis=tuple(v))
    background = Background(texture=plane_texture(sky)[:3], half_extent=(0.3, 0.3))
    b, a = np.meshgrid(np.linspace(-1, 1, 4), np.linspace(-1, 1, 3), indexing="ij")
    points = centre + a[..., None] * u + b[..., None] * v
    mesh = GridMesh(points=points, uv=np.stack([b + 1, a + 1], -1) / 2, texture=0, open=True)
    baked = BakedScene(
        soup=make_soup([mesh], 1.0),
        albedo=pack([card]),
        light=pack([np.full((2, 3, 3), 0.5)]),
        texture=np.zeros(1, np.int64),
        sky=sky,
        sky_half=(0.3, 0.3),
    )
    return baked, Scene(background=background, planes=(plane,))


def psnr(first, second, part):
    return -10 * np.log10(np.mean((first - second)[part] ** 2))


def test_pictures_are_those_of_the_plane_renderer(scenes):
    """Authority: the torch renderer of planes, whose cards fade over their outermost texel."""
    baked, planes = scenes
    camera = Camera(lens=LENS, width=48, height=48, pixel_pitch=PITCH)
    reference = render_bokeh(planes, camera, 1024, 1).numpy()
    result = baked.render(LENS, view(1024))
    assert psnr(result, reference, np.s_[:]) > 36
    inside = np.abs(result - reference).max(-1) < 0.2  # only the card's rim may differ
    assert inside.mean() > 0.97
    sharp = render_all_in_focus(planes, camera, 256, 2).numpy()
    assert np.median(np.abs(baked.render(LENS, view(256), pupil=False) - sharp)) < 0.01
    disparity, true = baked.disparity(LENS, view(1)), render_disparity(planes, camera).numpy()
    assert ((disparity > 0) == (true > 0)).mean() > 0.97
    both = (disparity > 0) & (true > 0)
    assert disparity[both] == pytest.approx(true[both], rel=1e-4)


def test_same_seed_same_picture_and_error_falls_with_samples(scenes):
    baked, _ = scenes
    first, again, other = (baked.render(LENS, view(16, seed)) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    truth = baked.render(LENS, view(2048))
    errors = [np.std(baked.render(LENS, view(count)) - truth) for count in (16, 256)]
    assert errors[1] < errors[0] / 4


def test_weights_of_the_lens_do_not_darken_but_blocked_rays_count_for_nothing(scenes):
    """Authority: the pinhole's picture, which is what is left when all other rays are blocked."""
    baked, _ = scenes

    class Mostly:
        def coc_radius(self, disparity):
            return 0 * disparity

        def sample_rays(self, sensor_xy, pupil_uv, wavelength=None, sensor_offset=None):
            weight = 0.1 * (np.arange(pupil_uv.shape[1]) % 2 == 0) * np.ones(pupil_uv.shape[:2])
            rays = PINHOLE.sample_rays(sensor_xy, 0 * pupil_uv)
            slope = np.where(weight[..., None] > 0, rays.slope, 9.0)
            return Rays(origin=rays.origin, slope=slope, weight=weight)

    sharp = baked.render(PINHOLE, view(512), pupil=False)
    assert np.abs(baked.render(Mostly(), view(512)) - sharp).mean() < 0.01


def test_triangles_that_reach_too_near_are_left_out():
    points = np.array(
        [[[0, 0, 50], [1, 0, 50]], [[0, 1, 200], [1, 1, 200]], [[0, 2, 300], [1, 2, 300]]], float
    )
    mesh = GridMesh(points=points, uv=np.zeros((3, 2, 2)), texture=0)
    assert len(make_soup([mesh], 100.0).mesh) == 2
    assert len(make_soup([mesh], 10.0).mesh) == 4
