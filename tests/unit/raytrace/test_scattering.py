"""Directions and reflectances of surfaces."""

import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError, ShapeError
from bokehnet.lenses import ThinLens
from bokehnet.raytrace.camera import Camera
from bokehnet.raytrace.geometry.frames import cosine_directions, from_frame, to_frame
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.space import dot, unit
from bokehnet.raytrace.surfaces.ggx import ggx_reflectance, sample_ggx
from bokehnet.raytrace.surfaces.lights import Environment, PointLight
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import Tracer
from bokehnet.raytrace.world import Body, World

COUNT = 200000


def squares(count=COUNT, seed=0):
    return torch.rand(count, 2, generator=torch.Generator().manual_seed(seed))


def directions(count, seed=0):
    return unit(torch.randn(count, 3, generator=torch.Generator().manual_seed(seed)))


def test_frames_keep_lengths_and_turn_back():
    axis, vectors = directions(100), directions(100, 1)
    axis[0], axis[1] = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([0.0, 0.0, -1.0])
    turned = from_frame(axis, vectors)
    assert torch.allclose(turned.norm(dim=-1), torch.ones(100), atol=1e-5)
    assert torch.allclose(dot(turned, axis), vectors[:, 2], atol=1e-5)
    assert torch.allclose(to_frame(axis, turned), vectors, atol=1e-5)


def test_cosine_directions_have_the_moments_of_a_cosine():
    """Authority: with density cos / pi, E[cos] = 2/3, E[cos^2] = 1/2, and sideways nothing."""
    normal = directions(1).expand(COUNT, 3)
    drawn = cosine_directions(normal, squares())
    cosine = dot(drawn, normal)
    assert float(cosine.min()) >= -1e-6
    assert float(cosine.mean()) == pytest.approx(2 / 3, abs=3e-3)
    assert float((cosine**2).mean()) == pytest.approx(1 / 2, abs=3e-3)
    assert float((drawn.mean(0) - normal[0] * 2 / 3).norm()) < 5e-3


@pytest.mark.parametrize("tilt", [0.0, 0.9, 1.4])
@pytest.mark.parametrize("roughness", [0.15, 0.5, 1.0])
def test_drawn_gloss_has_the_integral_and_the_mean_direction_of_its_reflectance(tilt, roughness):
    """Oracle: reflectance * cosine over the half sphere by even directions."""
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(COUNT, 3)
    view = torch.tensor([[np.sin(tilt), 0, np.cos(tilt)]], dtype=torch.float32).expand(COUNT, 3)
    rough = torch.full((COUNT,), roughness)
    drawn, factor = sample_ggx(view, normal, rough, squares())
    even = directions(COUNT, 5)
    even[:, 2] = even[:, 2].abs()
    weight = 2 * np.pi * ggx_reflectance(view, even, normal, rough) * even[:, 2]
    assert float(factor.mean()) == pytest.approx(float(weight.mean()), rel=0.04)
    assert float(factor.max()) <= 1
    for axis in (0, 2):
        first, second = (float((w * d[:, axis]).mean()) for w, d in ((factor, drawn), (weight, even)))
        assert first == pytest.approx(second, abs=0.03)


def test_a_smooth_surface_reflects_like_a_mirror():
    view = unit(torch.tensor([[0.3, -0.2, 0.9]])).expand(1000, 3)
    normal = torch.tensor([[0.0, 0.0, 1.0]]).expand(1000, 3)
    drawn, factor = sample_ggx(view, normal, torch.full((1000,), 0.001), squares(1000))
    error = (drawn - view * torch.tensor([-1.0, -1.0, 1.0])).norm(dim=-1)
    assert float(error.quantile(0.95)) < 0.02
    assert float(factor.min()) > 0.999


def test_environment_maps_the_middle_ahead_and_the_first_row_up():
    """Authority: longitude and latitude as documented; the seam behind the camera is continuous."""
    texture = torch.zeros(3, 5, 8)
    texture[0] = torch.arange(8.0)
    texture[1] = torch.arange(5.0)[:, None]
    sky = Environment(texture=texture)
    seen = sky.texture_lookup(
        torch.tensor([[0.0, 0.0, 3.0], [2.0, 0, 0], [-1.0, 0, 0], [0, -1.0, 0], [0, 5.0, 0]])
    )
    assert seen[:3, 0].tolist() == pytest.approx([3.5, 5.5, 1.5])
    assert seen[:, 1].tolist() == pytest.approx([2, 2, 2, 0, 4], abs=1e-4)
    left, right = sky.texture_lookup(torch.tensor([[-1e-4, 0.0, -1.0], [1e-4, 0.0, -1.0]]))[:, 0].tolist()
    assert left == pytest.approx(right, abs=1e-2)


def test_materials_that_make_light_are_refused():
    with pytest.raises(ParameterError, match=r"sum of at most 1, got 1\.1"):
        Material(color=(0.6, 0.6, 0.6), specular=(0.5, 0.4, 0.4))
    with pytest.raises(ParameterError, match="emission"):
        Material(emission=(-1.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"roughness: expected 0\.001 to 1, got 0"):
        Material(roughness=0.0)
    with pytest.raises(ShapeError, match=r"\(4, Ht, Wt\)"):
        Material(texture=torch.ones(3, 2, 2))
    with pytest.raises(ShapeError, match=r"\(3, Ht, Wt\)"):
        Environment(texture=torch.ones(4, 2, 2))


def frosted(roughness, light):
    """Radiance (3,) through a translucent sheet, seen along its normal, of what stands behind it."""
    sheet = Body(
        shape=Quad(centre=(0, 0, 1000), u_axis=(4e5, 0, 0), v_axis=(0, 4e5, 0)),
        material=Material(translucency=(0.8, 0.6, 0.4), roughness=roughness),
    )
    world = World(bodies=(sheet,), environment=Environment(texture=light))
    view = Camera(lens=ThinLens(focal_length=50.0, f_number=1e4), width=1, height=1, pixel_pitch=1e-3)
    return Tracer(world, view, bounces=1).render(16384).bokeh[0, 0]


@pytest.mark.parametrize("roughness", [0.1, 0.4])
def test_light_through_frosted_glass_spreads_by_the_formula(roughness):
    """Authority: along the normal the facets' angle a has ``tan^2 a / (r^2 + tan^2 a)`` as its distribution
    function (Walter et al., 2007, with G = 1 for the view), and light leaves at 2a, less what Smith's term
    takes; the sky is white within 30 degrees of the axis and black beyond.
    """
    light = torch.zeros(3, 180, 360)
    longitude, latitude = np.meshgrid(np.radians(np.arange(360) - 179.5), np.radians(np.arange(180) - 89.5))
    ahead = np.cos(latitude) * np.cos(longitude)
    light[:] = torch.from_numpy((ahead > np.cos(np.radians(30))).astype(np.float32))
    angle = np.radians((np.arange(20000) + 0.5) / 20000 * 45)
    share = np.tan(angle) ** 2 / (roughness**2 + np.tan(angle) ** 2)
    density = np.gradient(share, angle)
    unshadowed = 2 / (1 + np.sqrt(1 + roughness**2 * np.tan(2 * angle) ** 2))
    inside = angle < np.radians(15)
    expected = float((density * unshadowed * inside).sum() * (angle[1] - angle[0]))
    assert frosted(roughness, light).tolist() == pytest.approx(
        [0.8 * expected, 0.6 * expected, 0.4 * expected], rel=0.02
    )


def test_clear_glass_shows_its_background():
    bodies = (
        Body(
            shape=Quad(centre=(0, 0, 500), u_axis=(900, 0, 0), v_axis=(0, 900, 0)),
            material=Material(translucency=(0.5, 1.0, 0.25), roughness=0.001),
        ),
        Body(
            shape=Quad(centre=(30, 0, 1000), u_axis=(300, 0, 0), v_axis=(0, 200, 0)),
            material=Material(emission=(1.0, 2.0, 3.0)),
        ),
    )
    view = Camera(
        lens=ThinLens(focal_length=50.0, f_number=4.0, focus_distance=1000.0),
        width=24,
        height=16,
        pixel_pitch=2.0,
    )
    behind, bare = (
        Tracer(World(bodies=chosen), view, bounces=2).render(64).bokeh for chosen in (bodies, bodies[1:])
    )
    error = (behind - bare * torch.tensor([0.5, 1.0, 0.25])).abs()
    assert float(bare.max()) == pytest.approx(3)
    assert float(error.mean()) < 2e-3
    assert float(error.max()) < 0.15  # a few rays at the edge


def test_a_lamp_behind_frosted_glass_is_seen_as_one_before_a_rough_mirror():
    """Authority: the lobe through the sheet is the mirror's lobe, mirrored at the sheet."""
    seen = []
    for kind, depth in (("translucency", 1400.0), ("specular", 600.0)):
        sheet = Body(
            shape=Quad(centre=(0, 0, 1000), u_axis=(900, 0, 0), v_axis=(0, 900, 0)),
            material=Material(**{kind: (0.7, 0.7, 0.7)}, roughness=0.5),
        )
        lamp = PointLight(position=(200.0, 100.0, depth), intensity=(1e5, 2e5, 3e5))
        view = Camera(
            lens=ThinLens(focal_length=50.0, f_number=4.0, focus_distance=1000.0),
            width=12,
            height=8,
            pixel_pitch=3.0,
        )
        seen.append(Tracer(World(bodies=(sheet,), lamps=(lamp,)), view, bounces=1).render(8).bokeh)
    assert float(seen[0].mean()) > 0.01
    assert torch.allclose(seen[0], seen[1], rtol=1e-3)
