import numpy as np
import pytest
import torch

from bokehnet.errors import ParameterError
from bokehnet.lenses import Rays, ThinLens
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color
from bokehnet.raytrace import (
    Background,
    Camera,
    Plane,
    Scene,
    background_from,
    plane_texture,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)
from bokehnet.raytrace.distribution import Distribution, halton_points
from bokehnet.raytrace.geometry.meshes import Mesh
from bokehnet.raytrace.geometry.quads import Quad
from bokehnet.raytrace.geometry.spheres import Sphere
from bokehnet.raytrace.surfaces.lights import Environment, PointLight
from bokehnet.raytrace.surfaces.materials import Material
from bokehnet.raytrace.tracer import Tracer
from bokehnet.raytrace.world import Body, World, world_from_scene

from .test_integrator import camera, random_scene


def flat(value):
    return Environment(texture=torch.full((3, 1, 1), float(value)))


@pytest.mark.parametrize("seed", range(3))
def test_planes_look_as_their_own_renderer_shows_them(seed):
    """Oracle: render_bokeh, which composites planes pair by pair, at many samples."""
    scene, view = random_scene(seed), camera()
    tracer = Tracer(world_from_scene(scene), view, bounces=0)
    film = tracer.render(256)
    pairs = (film.bokeh, render_bokeh), (film.all_in_focus, render_all_in_focus)
    for picture, render in pairs:
        difference = picture - render(scene, view, 256, 0)
        assert float(difference.square().mean().sqrt()) < 0.01
        assert float(difference.mean().abs()) < 5e-4
    assert torch.allclose(tracer.maps().disparity, render_disparity(scene, view), rtol=1e-4)


def test_planes_at_one_depth_are_composited_one_by_one():
    """Authority: Porter and Duff's "over", "Compositing digital images", 1984, in the order of the list."""
    half = np.full((8, 8), 0.5, np.float32)
    planes = tuple(
        Plane(
            texture=plane_texture(np.full((8, 8, 3), value, np.float32), half),
            centre=(0, 0, 1000.0),
            u_axis=(900.0, 0, 0),
            v_axis=(0, 900.0, 0),
        )
        for value in (2.0, 4.0, 8.0)
    )
    scene = Scene(background=background_from(np.full((4, 4, 3), 16, np.float32), (1, 1)), planes=planes)
    film = Tracer(world_from_scene(scene), camera(), bounces=0).render(4)
    assert torch.allclose(film.bokeh, torch.tensor(2 / 2 + 4 / 4 + 8 / 8 + 16 / 8), rtol=1e-4)
    assert torch.allclose(film.coverage, torch.tensor(7 / 8), rtol=1e-4)


def test_half_clear_matt_cards_pass_light_by_chance_in_the_right_share():
    """Authority: "over" with the radiance color * environment of a matt card in even light, one bounce."""
    texture = torch.full((4, 2, 2), 0.25)  # RGB times alpha
    cards = tuple(
        Body(
            shape=Quad(centre=(0, 0, depth), u_axis=(5000, 0, 0), v_axis=(0, 5000, 0)),
            material=Material(color=(0.8, 0.8, 0.8), texture=texture),
        )
        for depth in (1000.0, 1001.0)
    )
    film = Tracer(World(bodies=cards, environment=flat(2)), camera(), bounces=1).render(512)
    assert float(film.coverage.mean()) == pytest.approx(1 - 0.75**2, abs=2e-3)
    # Each card sends 0.8 * what comes from the camera's side; that of the second comes through the first.
    expected = 0.25 * 0.8 * 2 + 0.75 * 0.25 * 0.8 * (0.75 * 2) + 0.75**2 * 2
    assert torch.allclose(film.bokeh.mean(), torch.tensor(expected), rtol=2e-3)


def test_white_ball_in_even_light_cannot_be_seen():
    """Authority: the furnace test; a convex white body in radiance 1 sends radiance 1 back."""
    ball = Body(shape=Sphere(centre=(0, 0, 1000), radius=200), material=Material(color=(1.0, 1.0, 1.0)))
    film = Tracer(World(bodies=(ball,), environment=flat(1)), camera(), bounces=1).render(16)
    assert torch.allclose(film.bokeh, torch.tensor(1.0), atol=1e-5)
    assert 0.1 < float(film.coverage.mean()) < 0.9


@pytest.mark.parametrize("kind", ["point", "ball", "card"])
def test_light_on_a_floor_follows_the_formula_of_its_lamp(kind):
    """Authority: Lambert: radiance = color / pi * irradiance.

    Irradiance under a lamp at height h: I / h^2 of a point, pi * L * (r / h)^2 of a ball, the form factor of
    two parallel discs' limit, L * A / h^2, of a small card.
    """
    height, radiance = 400.0, 3.0
    lamps, bodies = (), []
    if kind == "point":
        lamps = (PointLight(position=(0, -height, 1000), intensity=(1e5,) * 3),)
        irradiance = 1e5 / height**2
    elif kind == "ball":
        shape = Sphere(centre=(0, -height, 1000), radius=100)
        bodies = [Body(shape=shape, material=Material(emission=(radiance,) * 3))]
        irradiance = np.pi * radiance * (100 / height) ** 2
    else:
        shape = Quad(centre=(0, -height, 1000), u_axis=(10, 0, 0), v_axis=(0, 0, 10))
        bodies = [Body(shape=shape, material=Material(emission=(radiance,) * 3))]
        irradiance = radiance * 400 / height**2
    floor = Quad(centre=(0, 0, 1000), u_axis=(3, 0, 0), v_axis=(0, -2e-3, 3))
    bodies.append(Body(shape=floor, material=Material(color=(0.5, 0.4, 0.3))))
    view = camera(height=400, width=1, f_number=50.0, focus_distance=1000.0)
    rows = Camera(lens=view.lens, width=1, height=3, pixel_pitch=1e-4)
    film = Tracer(World(bodies=tuple(bodies), lamps=lamps), rows, bounces=1).render(256)
    expected = torch.tensor([0.5, 0.4, 0.3]) / np.pi * irradiance
    assert torch.allclose(film.all_in_focus[1, 0], expected, rtol=0.02)


def test_a_glowing_mesh_lights_what_is_around_it_as_a_glowing_sphere_does():
    """Oracle: the sphere, whose light is gathered by shadow rays; that of the mesh is met by chance."""
    trimesh = pytest.importorskip("trimesh", reason="needs trimesh: pip install 'bokehnet[trace]'")
    pytest.importorskip("embreex", reason="needs embreex: pip install 'bokehnet[trace]'")
    ball = trimesh.creation.icosphere(subdivisions=3, radius=100)
    glow = Material(emission=(3.0, 3.0, 3.0))
    floor = Quad(centre=(0, 150, 1000), u_axis=(900, 0, 0), v_axis=(0, 0, 900))
    means = []
    for shape in (
        Sphere(centre=(0, 0, 1000), radius=100),
        Mesh(ball.vertices + np.array([0, 0, 1000]), ball.faces),
    ):
        bodies = Body(shape=floor, material=Material(color=(0.5, 0.5, 0.5))), Body(shape=shape, material=glow)
        means.append(Tracer(World(bodies=bodies), camera(), bounces=1).render(128).bokeh[-4:].mean())
    assert float(means[0]) > 0.05
    assert float(means[1]) == pytest.approx(float(means[0]), rel=0.15)


def shadow_row(lamp_half, samples=256):
    """Light along a line on a wall 1000 mm away, half of it behind a screen 200 mm before the wall."""
    wall = Quad(centre=(0, 0, 1000), u_axis=(400, 0, 0), v_axis=(0, 400, 0))
    screen = Quad(centre=(250, 0, 800), u_axis=(250, 0, 0), v_axis=(0, 400, 0))
    matt = Material(color=(0.5, 0.5, 0.5))
    bodies, lamps = [Body(shape=wall, material=matt)], ()
    if lamp_half:
        lamp = Quad(centre=(100, -300, 200), u_axis=(lamp_half, 0, 0), v_axis=(0, 1, 0))
        bodies.append(Body(shape=lamp, material=Material(emission=(1e3, 1e3, 1e3))))
    else:
        lamps = (PointLight(position=(100, 0, 200), intensity=(1e5, 1e5, 1e5)),)
    lens = ThinLens(focal_length=50.0, f_number=50.0, focus_distance=1000.0)
    view = Camera(lens=lens, width=300, height=1, pixel_pitch=0.1)
    lit = Tracer(World(bodies=tuple(bodies), lamps=lamps), view, bounces=1).render(samples).all_in_focus
    bodies.append(Body(shape=screen, material=Material()))  # black
    film = Tracer(World(bodies=tuple(bodies), lamps=lamps), view, bounces=1).render(samples)
    x = (np.arange(300) - 149.5) * 0.1 / lens.sensor_distance * 1000
    return x, (film.all_in_focus / lit).numpy()[0, :, 1]


def test_shadow_of_a_point_is_hard_and_on_the_line_from_lamp_over_edge():
    """Authority: similar triangles, from (100, 200) over the screen's edge (0, 800)."""
    x, light = shadow_row(0)
    edge = 100 - 100 * 800 / 600  # where it meets the wall; the camera sees the wall where x < 0
    assert np.allclose(light[x < edge - 3], 1, atol=1e-5)
    assert np.allclose(light[(x > edge + 3) & (x < -3)], 0)


def test_penumbra_has_the_width_of_the_lamp_seen_over_the_edge():
    """Authority: similar triangles: a lamp 2w wide 600 mm before the edge blurs it over 2w * 200 / 600."""
    half = 300.0
    x, light = shadow_row(half, 512)
    # The lamp's points at u put the shadow's edge at u + (0 - u) * 800 / 600 = -u / 3.
    u = np.linspace(100 - half, 100 + half, 2001)
    distance2 = 800.0**2 + 300.0**2 + (u[None] - x[:, None]) ** 2
    power = distance2**-2.0  # both cosines are 800 / distance
    expected = (power * (x[:, None] < -u[None] / 3)).sum(1) / power.sum(1)
    visible = x < -3
    assert expected[visible].min() < 0.8
    assert np.abs(light - expected)[visible].max() < 0.03


def test_moving_card_is_smeared_over_its_way():
    """Authority: coverage of a bar of width w that moves by d is a trapezium of width w + d."""
    pitch_at_object = 1.0
    lens = ThinLens(focal_length=50.0, f_number=16.0, focus_distance=1000.0)
    view = Camera(lens=lens, width=64, height=2, pixel_pitch=pitch_at_object * lens.sensor_distance / 1000)
    card = Body(
        shape=Quad(centre=(3, 0, 1000), u_axis=(4, 0, 0), v_axis=(0, 50, 0)),
        material=Material(emission=(1.0, 1.0, 1.0)),
        velocity=(400.0, 0.0, 0.0),
    )
    film = Tracer(World(bodies=(card,)), view, bounces=0, shutter=0.05).render(512)
    x = np.arange(64) - 31.5 - 3
    expected = np.clip((14 - np.abs(x)) / 20, 0, 8 / 20)
    assert np.abs(film.bokeh[0, :, 0].numpy() - expected).max() < 0.02


class Dispersive:
    """A thin lens whose focal length grows with the wavelength, 2 % over the spectrum."""

    def __init__(self, lens):
        self.lens = lens

    def coc_radius(self, disparity):
        return self.lens.coc_radius(disparity)

    def sample_rays(self, sensor_xy, pupil_uv, wavelength=None):
        if wavelength is None:
            return self.lens.sample_rays(sensor_xy, pupil_uv)
        power = (1 - 0.02 * (wavelength[..., None] - 550) / 300) / self.lens.focal_length
        origin = pupil_uv * self.lens.pupil_radius
        slope = -sensor_xy / self.lens.sensor_distance - origin * (power - 1 / self.lens.sensor_distance)
        return Rays(origin=origin, slope=slope)


def white_spot(lens):
    view = Camera(lens=lens, width=41, height=41, pixel_pitch=0.05)
    card = Quad(centre=(0, 0, 1e6), u_axis=(2000, 0, 0), v_axis=(0, 2000, 0))
    world = World(bodies=(Body(shape=card, material=Material(emission=(50.0, 50.0, 50.0))),))
    return Tracer(world, view, bounces=0, dispersion=True).render(1024).bokeh


def test_a_lens_without_dispersion_shows_no_colour():
    spot = white_spot(ThinLens(focal_length=50.0, f_number=2.0, focus_distance=5e4))
    mean = spot.sum((0, 1))
    assert torch.allclose(mean / mean.mean(), torch.ones(3), atol=0.01)
    lit = spot[..., 1] > 0.5 * spot[..., 1].max()
    assert float((spot[lit] / spot[lit].mean(-1, keepdim=True) - 1).abs().max()) < 0.15


def test_each_colour_has_the_blur_of_its_wavelengths():
    """Authority: blur radius = pupil radius * sensor distance * |1/f - 1/s - 1/z|; <l^2> = r^2 / 2."""
    lens = ThinLens(focal_length=50.0, f_number=2.0, focus_distance=2.5e3)
    spot = white_spot(Dispersive(lens)).double()
    wavelength = torch.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 1001, dtype=torch.float64)
    vergence = (1 - 0.02 * (wavelength - 550) / 300) / 50 - 1 / lens.sensor_distance - 1e-6
    radius = lens.pupil_radius * lens.sensor_distance * vergence / 0.05
    card = 2000 * lens.sensor_distance / 1e6 / 0.05  # half of its side, pixels
    color = wavelength_color(wavelength)
    offset = torch.arange(41.0) - 20
    square = offset[:, None] ** 2 + offset[None] ** 2
    for channel in range(3):
        spread = (spot[..., channel] * square).sum() / spot[..., channel].sum()
        disc = (color[:, channel] * radius**2 / 2).mean()
        assert float(spread) == pytest.approx(float(disc) + 2 * card**2 / 3 + 1 / 6, rel=0.02)


def test_broken_off_and_carried_on_gives_the_same_picture():
    ball = Body(shape=Sphere(centre=(0, 0, 1000), radius=200), material=Material(color=(0.5, 0.6, 0.7)))
    world = World(
        bodies=(ball,), environment=flat(1), lamps=(PointLight(position=(500, 0, 0), intensity=(1e5,) * 3),)
    )
    tracer = Tracer(world, camera(), seed=3)
    whole = tracer.render(100)
    part = tracer.render(41)
    while part.samples < 100:
        part = tracer.advance(part, 100)
    assert part.samples == 100
    for name in ("bokeh", "all_in_focus", "coverage"):
        assert torch.equal(getattr(part, name), getattr(whole, name))
    assert not torch.equal(whole.bokeh, Tracer(world, camera(), seed=4).render(100).bokeh)


def test_large_pictures_are_traced_in_pieces_of_the_same_numbers(monkeypatch):
    ball = Body(shape=Sphere(centre=(0, 0, 1000), radius=200), material=Material(color=(0.5, 0.6, 0.7)))
    world = World(bodies=(ball,), environment=flat(1))
    whole = Tracer(world, camera()).render(3)
    monkeypatch.setattr("bokehnet.raytrace.tracer._MAX_RAYS_CPU", 100)
    pieces = Tracer(world, camera()).render(3)
    assert torch.allclose(pieces.bokeh, whole.bokeh, atol=1e-6)
    assert torch.equal(pieces.coverage, whole.coverage)


def test_maps_hold_depth_normal_and_body_of_the_first_solid_surface():
    glass = torch.tensor([0.1, 0.1, 0.1, 0.3]).reshape(4, 1, 1)
    bodies = (
        Body(
            shape=Quad(centre=(0, 0, 500), u_axis=(900, 0, 0), v_axis=(0, 900, 0)),
            material=Material(emission=(1.0, 1.0, 1.0), texture=glass),
        ),
        Body(shape=Sphere(centre=(0, 0, 1000), radius=100), material=Material(color=(0.5, 0.5, 0.5))),
    )
    view = camera(25, 33)
    maps = Tracer(World(bodies=bodies), view).maps()
    assert float(maps.depth[12, 16]) == pytest.approx(900, rel=1e-5)
    assert maps.normal[12, 16].tolist() == pytest.approx([0, 0, -1], abs=1e-3)
    assert maps.normal[12, 18, 0] > 0.1
    assert set(maps.body.unique().tolist()) == {-1, 1}
    assert float(maps.depth[0, 0]) == float("inf")
    assert float(maps.disparity[0, 0]) == 0


def test_light_that_the_lens_keeps_back_is_missing():
    class Half:
        """A lens that passes a quarter of the light of half of its pupil."""

        def sample_rays(self, sensor_xy, pupil_uv, wavelength=None):
            rays = ThinLens(focal_length=50.0, f_number=2.0).sample_rays(sensor_xy, pupil_uv)
            return Rays(origin=rays.origin, slope=rays.slope, weight=0.25 * (pupil_uv[..., 0] >= 0).float())

    view = Camera(lens=Half(), width=8, height=8, pixel_pitch=1.0)
    film = Tracer(World(environment=flat(8)), view).render(256)
    assert torch.allclose(film.bokeh, torch.tensor(1.0), rtol=0.02)
    assert torch.allclose(film.all_in_focus, torch.tensor(2.0))


def test_numbers_fill_every_interval_of_their_base_once():
    """Authority: the defining property of radical inverses, kept by any order of the digits."""
    for base in (2, 7, 31):
        points = halton_points(base**2, base, start=base**2 - 1)
        assert np.array_equal(np.sort(np.floor(points * base**2)), np.arange(base**2))
    assert np.array_equal(halton_points(5, 3, start=7), halton_points(12, 3)[7:])


def test_large_bases_do_not_run_in_parallel():
    """Plain radical inverses of 31 and 37 are all but equal for their first 30 points."""
    first, second = halton_points(30, 31), halton_points(30, 37)
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.5


def test_pupil_and_wavelength_fill_their_cylinder():
    """Authority: area share of each part; 8 pixels share no numbers."""
    distribution = Distribution(8, 1, 0, torch.device("cpu"))
    samples = distribution.lens_samples(distribution.points(0, 512), slice(0, 8))
    radius = samples.pupil_uv.norm(dim=-1).reshape(512, 8)
    red = samples.wavelength.reshape(512, 8) > 0.75
    assert float(radius.max()) <= 1
    shares = ((radius < 0.5) & red).float().mean(0)
    assert torch.allclose(shares, torch.tensor(1 / 16), atol=0.012)
    assert len(samples.wavelength[:8].unique()) == 8


def test_bad_numbers_are_refused():
    world = World(environment=flat(1))
    with pytest.raises(ParameterError, match="bounces"):
        Tracer(world, camera(), bounces=-1)
    with pytest.raises(ParameterError, match="shutter"):
        Tracer(world, camera(), shutter=-0.1)
    with pytest.raises(ParameterError, match="samples"):
        Tracer(world, camera()).render(0)


def test_backdrop_is_seen_but_lights_nothing():
    ball = Body(shape=Sphere(centre=(0, 0, 1000), radius=100), material=Material(color=(0.5, 0.5, 0.5)))
    backdrop = Background(texture=torch.full((3, 1, 1), 4.0), half_extent=(1, 1))
    film = Tracer(
        World(bodies=(ball,), environment=flat(1), backdrop=backdrop), camera(25, 33), bounces=1
    ).render(8)
    assert torch.allclose(film.all_in_focus[0, 0], torch.tensor(4.0))
    assert torch.allclose(film.all_in_focus[12, 16], torch.tensor(0.5), atol=1e-5)
