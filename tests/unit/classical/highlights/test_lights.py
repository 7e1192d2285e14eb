"""Authorities: conserved energy, and the area of a disc clipped by a straight edge."""

import numpy as np

from bokehnet.classical.highlights.lights import separate_lights
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.rays_renderer import rays
from tests.unit.classical.highlights.light_scenes import draw, point


def night(radius=-12.0, size=96):
    """A light of 500 before a dark plane at one depth; beyond column 40 a sharp foreground, as dark."""
    image = np.full((size, size, 3), 0.01, np.float32)
    defocus = np.full((size, size), radius, np.float32)
    defocus[:, 40:] = 0.0
    image[48, 36] = 500.0
    return image, defocus


def one_layer(image, defocus):
    return Layers(
        colors=image[:, :, None],
        defocus=defocus[:, :, None],
        coverage=np.ones((*defocus.shape, 1), np.float32),
    )


def test_lights_and_the_rest_add_up_to_the_picture():
    image, defocus = night()
    rest, lights = separate_lights(one_layer(image, defocus))
    assert lights.shape == (1, 8)
    np.testing.assert_allclose(lights[0, :3], (36, 48, -12))
    assert lights[0, 3] > 490
    np.testing.assert_allclose(rest.colors[48, 36, 0] + lights[0, 3:6], image[48, 36], rtol=1e-6)
    np.testing.assert_array_equal(np.delete(rest.colors[48, :, 0], 36, 0), np.delete(image[48], 36, 0))


def test_sharp_lights_and_even_pictures_stay_whole():
    image, defocus = night()
    for picture, radius in ((image, 0 * defocus), (np.full_like(image, 7.0), defocus), (0 * image, defocus)):
        rest, lights = separate_lights(one_layer(picture, radius))
        assert len(lights) == 0
        np.testing.assert_array_equal(rest.colors[:, :, 0], picture)


def test_a_light_gives_what_nearer_layers_leave_of_it():
    image, defocus = night()
    coverage = np.stack([0.25 + 0 * defocus, 1 + 0 * defocus], 2)
    layers = Layers(
        colors=np.stack([0.01 + 0 * image, image], 2),
        defocus=np.stack([0 * defocus, defocus], 2),
        coverage=coverage,
    )
    whole = separate_lights(one_layer(image, defocus))[1]
    np.testing.assert_allclose(separate_lights(layers)[1][:, 3:6], 0.75 * whole[:, 3:6], rtol=1e-4)


def test_a_light_is_an_even_disc_clipped_by_its_occluder():
    image, defocus = night()
    result = rays(image, defocus)[..., 0] - 0.01
    y, x = np.mgrid[:96, :96]
    distance = np.hypot(y - 48, x - 36)
    level = 500 / (np.pi * 12**2)
    inside = result[(distance < 11) & (x < 39)]
    assert abs(inside.mean() / level - 1) < 0.01
    assert inside.std() / level < 0.02
    assert abs(result[:, 42:]).max() < 1e-3 * level
    assert abs(result[distance > 13.5]).max() < 1e-3 * level


def test_neighbouring_lights_become_one_of_their_energy():
    """A lamp of 3x3 pixels in a disc of 40: its disc holds the energy of all nine."""
    image = np.full((160, 160, 3), 0.01, np.float32)
    defocus = np.full((160, 160), 40.0, np.float32)
    defocus[:, 130:] = 50.0
    image[79:82, 79:82] = 100.0
    result = rays(image, defocus)[..., 0] - 0.01
    y, x = np.mgrid[:160, :160]
    inside = result[(np.hypot(y - 80, x - 80) < 36) & (x > 85) & (x < 110)]
    level = 9 * 100 / (np.pi * 40**2)
    assert abs(inside.mean() / level - 1) < 0.02
    assert inside.std() / level < 0.05


def many_lights(seed=0):
    rng = np.random.default_rng(seed)
    image = np.full((80, 80, 3), 0.01, np.float32)
    bright = rng.random((80, 80)) < 0.1
    image[bright] = rng.uniform(20, 90, (bright.sum(), 1))
    return image, np.full((80, 80), 9.0, np.float32)


def test_of_too_many_lights_the_brightest_are_taken():
    image, defocus = many_lights()
    rest, lights = separate_lights(one_layer(image, defocus), 400)  # one window for all
    assert 0 < len(lights) <= 80 * 80 / 20 + 1
    selected = image[..., 0] - rest.colors[:, :, 0, 0]
    assert image[..., 0][selected > 0].min() >= image[..., 0][(selected == 0) & (image[..., 0] > 1)].max()


def test_an_additional_light_keeps_the_others():
    """The raised limit moves by the place between two lights, not by a light."""
    image, defocus = many_lights()
    more = image.copy()
    more[image[..., 0] < 1] = 0.0101
    y, x = np.argwhere(image[..., 0] < 1)[0]
    more[y, x] = 60
    before, after = (
        picture[..., 0] - separate_lights(one_layer(picture, defocus))[0].colors[:, :, 0, 0]
        for picture in (image, more)
    )
    change = np.delete((after - before).ravel(), y * 80 + x)
    assert abs(change).max() < 1.0


def test_lights_have_their_depth(monkeypatch):
    """Each disc of radius 6 to 8 covers more than 100 pixels, so that none shares a batch with another."""
    monkeypatch.setattr("bokehnet.classical.highlights.lights._FLOATS", 100)
    lights = np.concatenate([point(12, 30, 6.0), point(30, 30, 7.0), point(48, 30, 8.0)])
    reports: list[float] = []
    draw(lights, (60, 60), progress=reports.append)
    np.testing.assert_allclose(reports, [1 / 3, 2 / 3, 1])
