import numpy as np
import pytest

from bokehnet.synth.clutter.baked_lighting import KeyLight, Lighting, bake, lighting_grid
from bokehnet.synth.clutter.baked_scene import make_soup
from bokehnet.synth.clutter.grid_mesh import GridMesh, plate

pytest.importorskip("embreex", reason="Embree is not installed: pip install 'bokehnet[trace]'")

UP = np.array([0.0, -1.0, 0.0])
GREY = np.array([1.0, 0.5, 0.25])


def light_on_floor(others, lighting):
    """Light on a floor of 2 m around (0, 1 m, 5 m), mm, (h, w, 3), and the places."""
    floor = plate((-1000, 1000, 4000), (2000, 0, 0), (0, 0, 2000), 0)
    grid = lighting_grid(floor, 0.02, 40)
    tree = make_soup([floor, *others], 1.0).tree
    return bake([grid], lighting, tree, np.random.default_rng(0))[0], grid[0]


def test_open_floor_gets_all_the_light_from_above():
    lighting = Lighting(keys=(), above=GREY, bounced=np.ones(3), up=UP)
    light, places = light_on_floor([], lighting)
    assert light.shape == places.shape
    assert light == pytest.approx(np.broadcast_to(GREY, light.shape), rel=0.05)  # dimmer near the horizon


def test_endless_wall_hides_half_of_the_sky():
    """Authority: the form factor of a quarter of the sphere to a floor at the wall's foot is one half."""
    wall = plate((-1e6, -1e6, 4999), (2e6, 0, 0), (0, 1e6 + 1000, 0), 0)
    lighting = Lighting(keys=(), above=np.ones(3), bounced=np.zeros(3), up=UP)
    light, places = light_on_floor([wall], lighting)
    foot = np.abs(places[..., 2] - 4999) < 60
    assert light[foot].mean() == pytest.approx(0.5, abs=0.05)


def test_key_light_follows_cosine_and_distance_and_casts_a_shadow():
    """Authority: irradiance is the cosine over the squared distance."""
    position = np.array([0.0, -2000.0, 5000.0])
    key = KeyLight(position=position, radius=1.0, light=GREY, distance=3000.0)
    lighting = Lighting(keys=(key,), above=np.zeros(3), bounced=np.zeros(3), up=UP)
    light, places = light_on_floor([], lighting)
    way = position - places
    distance = np.linalg.norm(way, axis=-1, keepdims=True)
    assert light == pytest.approx(GREY * -way[..., 1:2] / distance * (3000 / distance) ** 2, rel=0.01)
    card = plate((-300, -500, 4700), (600, 0, 0), (0, 0, 600), 0)
    shaded = light_on_floor([card], lighting)[0]
    hidden = (np.abs(places[..., :1]) < 550) & (np.abs(places[..., 2:] - 5000) < 550)
    assert not shaded[hidden[..., 0]].any()
    free = (np.abs(places[..., :1]) > 650) | (np.abs(places[..., 2:] - 5000) > 650)
    assert np.array_equal(shaded[free[..., 0]], light[free[..., 0]])


def test_places_are_as_dense_as_requested_and_open_sheets_are_lit_on_the_side_that_is_seen():
    sheet = plate((-500, -500, 2000), (1000, 0, 0), (0, 1000, 0), 0)
    places, normals = lighting_grid(sheet, 0.01, 1000)
    steps = np.linalg.norm(np.diff(places, axis=1), axis=-1) / np.linalg.norm(places[:, 1:], axis=-1)
    assert steps.max() == pytest.approx(0.01, rel=0.05)
    assert (normals[..., 2] < -0.999).all()
    assert lighting_grid(sheet, 0.001, 30)[0].shape == (30, 30, 3)
    turned = GridMesh(points=sheet.points[::-1], uv=sheet.uv, texture=0, open=False)
    assert (lighting_grid(turned, 0.01, 10)[1][..., 2] > 0).any() != (normals[..., 2] > 0).any()
