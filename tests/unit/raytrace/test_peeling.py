import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError
from bokehnet.lenses import ThinLens
from bokehnet.raytrace import Background, Camera
from bokehnet.raytrace.geometry.meshes import Mesh
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.peeling import peel
from bokehnet.raytrace.surfaces.lights import Environment
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import Tracer
from bokehnet.raytrace.views import accumulate_views
from bokehnet.raytrace.world import Body, World, world_from_scene

from .test_integrator import camera, random_scene


def card(depth, value, alpha=1.0, half=3000.0):
    texture = torch.tensor([alpha, alpha, alpha, alpha]).reshape(4, 1, 1)
    return Body(
        shape=Quad(centre=(0, 0, depth), u_axis=(half, 0, 0), v_axis=(0, half, 0)),
        material=Material(emission=(value, value, value), texture=texture),
    )


def test_layers_are_the_cards_from_front_to_back():
    world = World(
        bodies=(card(3000, 8.0), card(1000, 2.0, 0.5), card(2000, 4.0, 0.25)),
        environment=Environment(texture=torch.full((3, 1, 1), 16.0)),
    )
    peeled = peel(world, camera(), 5)
    assert peeled.depth[3, 4].tolist() == pytest.approx([1000, 2000, 3000, np.inf, np.inf])
    assert peeled.coverage[3, 4].tolist() == pytest.approx([0.5, 0.25, 1, 1, 0])
    assert peeled.colors[3, 4, :, 1].tolist() == pytest.approx([2, 4, 8, 16, 0])


def test_an_outline_has_the_coverage_of_its_exact_area():
    """Authority: rays through the centres of pixels of a sixteenth of the size, counted."""
    card = Quad(centre=(-300.0, 0, 1000), u_axis=(330.0, 40.0, 0), v_axis=(0, 3000.0, 0))
    world = World(bodies=(Body(shape=card, material=Material(emission=(2.0, 2.0, 2.0))),))
    view, parts = camera(9, 12), 16
    width, height, pitch = parts * view.width, parts * view.height, view.pixel_pitch / parts
    fine = Camera(lens=view.lens, width=width, height=height, pixel_pitch=pitch)
    counted = peel(world, fine, 1, samples=1).depth[..., 0].isfinite().float()
    exact = counted.reshape(view.height, parts, view.width, parts).mean((1, 3))
    worst = []
    for samples in (1, 64):
        peeled = peel(world, view, 2, samples=samples)
        covered = torch.where(peeled.depth[..., 0].isfinite(), peeled.coverage[..., 0], 0)
        worst.append(float((covered - exact).abs().max()))
    assert worst[1] < 0.08 < 0.3 < worst[0]


@pytest.mark.parametrize("seed", range(3))
def test_layers_over_one_another_are_the_picture(seed):
    """Authority: Porter and Duff's "over", 1984, against paths through the same pixel centres."""
    world, view = world_from_scene(random_scene(seed)), camera()
    peeled = peel(world, view, 8, samples=1, bounces=0)
    clear = torch.cumprod(1 - peeled.coverage, -1)
    share = torch.cat([torch.ones_like(clear[..., :1]), clear[..., :-1]], -1) * peeled.coverage
    picture = (share[..., None] * peeled.colors).sum(2)
    pinhole = ThinLens(focal_length=50.0, f_number=1e6, focus_distance=view.lens.focus_distance)
    centred = Camera(lens=pinhole, width=view.width, height=view.height, pixel_pitch=view.pixel_pitch)
    expected = next(accumulate_views(world, centred, 1, bounces=0))
    differs = (picture - expected).abs().amax(-1) > 1e-3
    assert differs.float().mean() < 0.01  # centres on an outline fall to either side by rounding


def test_closed_bodies_count_once_and_light_reaches_what_they_hide():
    """A ball hides a wall; both are lit by the sky: the hidden wall has its own light, not the ball's."""
    bodies = (
        Body(shape=Sphere(centre=(0, 0, 1000), radius=100), material=Material(color=(0.5, 0.5, 0.5))),
        Body(
            shape=Quad(centre=(0, 0, 30000), u_axis=(20000, 0, 0), v_axis=(0, 20000, 0)),
            material=Material(color=(0.2, 0.2, 0.2)),
        ),
    )
    world = World(bodies=bodies, environment=Environment(texture=torch.ones(3, 1, 1)))
    centre, peeled = (peel(world, camera(25, 33), 3, bounces=1, samples=samples) for samples in (1, 16))
    assert centre.depth[12, 16].tolist() == pytest.approx([900, 30000, np.inf], rel=1e-4)
    assert peeled.colors[12, 16, :, 0].tolist() == pytest.approx([0.5, 0.2, 1], rel=0.02)


def test_a_watertight_mesh_counts_once_and_an_open_one_twice():
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    box = trimesh.creation.box((200, 200, 200))
    for closed, depths in ((True, [900, np.inf]), (False, [900, 1100])):
        mesh = Mesh(box.vertices + np.array([0, 0, 1000]), box.faces, closed=closed)
        world = World(bodies=(Body(shape=mesh, material=Material(color=(0.5, 0.5, 0.5))),))
        assert peel(world, camera(25, 33), 2, samples=1).depth[12, 15].tolist() == pytest.approx(
            depths, rel=1e-4
        )


def test_bodies_behind_a_near_backdrop_stay_in_order():
    backdrop = Background(texture=torch.ones(3, 1, 1), half_extent=(1, 1), disparity=1 / 500)
    peeled = peel(World(bodies=(card(1000, 2.0),), backdrop=backdrop), camera(), 2)
    assert peeled.depth[0, 0].tolist() == pytest.approx([1000, 1000])
    with pytest.raises(ParameterError, match="layers"):
        peel(World(), camera(), 0)


def test_views_add_up_to_the_traced_picture():
    """Authority: both are means over the pupil; ghosts fade as the views grow in number."""
    texture = torch.from_numpy(np.random.default_rng(0).random((4, 6, 8), np.float32))
    texture[3] = 1
    smooth = torch.nn.functional.interpolate(texture[None], (48, 64), mode="bilinear")[0]
    wall = Body(
        shape=Quad(centre=(0, 0, 2000), u_axis=(900, 0, 0), v_axis=(0, 700, 0)),
        material=Material(emission=(1.0, 1.0, 1.0), texture=smooth),
    )
    world, view = World(bodies=(wall, card(1000, 0.5, 1.0, 50.0))), camera(f_number=2.0)
    means = list(accumulate_views(world, view, 128, bounces=0))
    truth = Tracer(world, view, bounces=0).render(256).bokeh
    inner = slice(2, -2), slice(2, -2)
    errors = [float((means[count - 1] - truth)[inner].square().mean().sqrt()) for count in (4, 32, 128)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.02
    assert torch.allclose(means[127], means[126] + (means[127] - means[126]))


def test_each_view_is_a_pinhole_picture_that_meets_the_others_in_the_focal_plane():
    """Authority: rays of a thin lens meet in the focal plane, so a card there stays in place."""
    texture = torch.from_numpy(np.random.default_rng(0).random((4, 16, 16), np.float32))
    texture[3] = 1
    wall = Body(
        shape=Quad(centre=(0, 0, 1500), u_axis=(900, 0, 0), v_axis=(0, 700, 0)),
        material=Material(emission=(1.0, 1.0, 1.0), texture=texture),
    )
    means = list(accumulate_views(World(bodies=(wall,)), camera(), 6, bounces=0))
    for mean in means[1:]:
        assert torch.allclose(mean, means[0], atol=1e-4)
