"""Authorities: the transmission added up at many places in each pixel, and sums of single lights."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.arrays.viewport import Viewport
from bokehnet.classical.highlights.lights import separate_lights
from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.rays_renderer import rays
from bokehnet.optics.aperture import Aperture, transmission
from tests.unit.classical.highlights.light_scenes import decibel, draw, point

SHAPES = {
    "disc": Aperture(),
    "blades": Aperture(blades=6, curvature=0.3, rotation=10, onion=0.5, grain=0.3),
    "oval ring": Aperture(squeeze=0.5, obstruction=0.4, spherical_profile=0.5),
    "letter": Aperture(picture=np.array([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0.5]])),
}


def supersampled(x, y, defocus, size, aperture, samples):
    """Share of the light on each pixel, from samples^2 places in it."""
    inside = (np.arange(samples) + 0.5) / samples - 0.5
    total = np.zeros(size)
    u = (np.add.outer(np.arange(size[1]), inside).ravel() - x) / defocus
    for row in range(size[0]):
        v = (row + inside - y) / defocus
        light = transmission(aperture, u[None, :], v[:, None], 1 if defocus > 0 else -1)
        total[row] = light.sum(0).reshape(size[1], samples).sum(1)
    return total / total.sum()


@pytest.mark.parametrize("defocus", [-3.0, 8.3, -31.0])
@pytest.mark.parametrize("name", SHAPES)
def test_psf_images_are_supersampled_discs(name, defocus):
    aperture, side = SHAPES[name], int(2 * abs(defocus)) + 7
    x, y = side / 2 + 0.3, side / 2 - 0.2
    picture = draw(point(x, y, defocus), (side, side), aperture)[..., 0]
    expected = supersampled(x, y, defocus, (side, side), aperture, 32)
    assert picture.sum() == pytest.approx(1, abs=1e-5)
    assert decibel(picture, expected, expected.max()) > 45
    assert abs(picture - expected).max() < 0.05 * expected.max()


def test_a_disc_of_300_pixels_has_smooth_edges():
    """A row holds the integral of sqrt(r^2 - y^2); along the rim all levels of grey are as frequent."""
    radius, side = 300.0, 640
    result = draw(point(319.5, 319.5, radius), (side, side))[..., 0] * math.pi * radius**2
    sums = result[:, 320:].sum(1)  # length of the disc's half in each row of pixels
    y = np.arange(side) - 319.5
    edges = np.clip(np.stack([y - 0.5, y + 0.5]), -radius, radius)
    area = (edges * np.sqrt(radius**2 - edges**2) + radius**2 * np.arcsin(edges / radius)) / 2
    assert_allclose(sums, area[1] - area[0], atol=0.15)
    levels = result[(result > 0.02) & (result < 0.98)]
    assert np.histogram(levels, 8, (0, 1))[0].min() > 0.5 * len(levels) / 8


@pytest.mark.parametrize(("width", "height"), [(7, 1), (1, 4), (5, 3)])
def test_an_even_rectangle_is_the_sum_of_its_pixels(width, height):
    single = [
        draw(point(60 + i, 60 + j, -40.0), (130, 130))
        for i in range(width)
        for j in range(height)
    ]  # fmt: skip
    middle = 60 + (width - 1) / 2, 60 + (height - 1) / 2
    whole = draw(point(*middle, -40.0, width, height), (130, 130))
    assert_allclose(whole, np.mean(single, axis=0), atol=1e-7 + 1e-6 * whole.max())


def lamps(kind, size=160):
    """Bright things on black before a disc of 60: a line that leans, a window, scattered sparks."""
    image = np.zeros((size, size, 3), np.float32)
    if kind == "line":
        for x in range(50, 110):
            image[40 + x // 2, x] = 80
    elif kind == "window":
        image[60:87, 61:98] = 50
        image[72, 61:98] = image[60:87, 80] = 0
    else:
        rng = np.random.default_rng(1)
        image[rng.integers(50, 110, 300), rng.integers(50, 110, 300)] = rng.uniform(10, 90, (300, 3))
    return image


@pytest.mark.parametrize("kind", ["line", "window", "sparks"])
@pytest.mark.parametrize(("radius", "slope"), [(-20.0, 0.0), (60.0, 0.0), (60.0, 0.1)])
def test_merged_lights_look_like_single_ones(kind, radius, slope):
    """Authority: all pixels drawn one by one. The steps of beads along rims would show in the differences."""
    image = lamps(kind)
    radii = np.tile(radius + slope * np.arange(-80, 80, dtype=np.float32), (160, 1))
    layers = Layers(
        colors=image[:, :, None],
        defocus=radii[:, :, None],
        coverage=np.ones((160, 160, 1), np.float32),
    )
    rest, lights = separate_lights(layers)
    y, x = np.nonzero(image.max(-1))
    selected = (image - rest.colors[:, :, 0])[y, x]
    ones = np.ones(len(x))
    single = np.column_stack([x, y, radii[y, x], selected, ones, ones])
    assert_allclose(lights[:, 3:6].sum(0), selected.sum(0), rtol=1e-5)
    if abs(radius) * 2 / 16 >= 4:
        assert len(lights) < len(single)
    actual, expected = (draw(result, (160, 160))[..., 0] for result in (lights, single))
    assert decibel(actual, expected, expected.max()) > 55
    steps = [np.abs(np.diff(picture, axis=1)).max() for picture in (actual, expected)]
    assert steps[0] < 1.1 * steps[1]


def test_merging_keeps_energy_centre_and_variance():
    """Moments of the pixels that a cell holds, the definition of the rectangle."""
    image = np.zeros((64, 64, 3), np.float32)
    rng = np.random.default_rng(0)
    image[32:36, 32:36] = rng.uniform(50, 90, (4, 4, 1))
    layers = Layers(
        colors=image[:, :, None],
        defocus=np.full((64, 64, 1), 64.0, np.float32),
        coverage=np.ones((64, 64, 1), np.float32),
    )
    rest, lights = separate_lights(layers)
    selected = (image - rest.colors[:, :, 0])[..., 0].astype(float)
    assert len(lights) == 1
    y, x = np.mgrid[:64, :64]
    assert_allclose(lights[0, 3], selected.sum(), rtol=1e-6)
    for place, centre, length in ((x, lights[0, 0], lights[0, 6]), (y, lights[0, 1], lights[0, 7])):
        mean = (selected * place).sum() / selected.sum()
        assert centre == pytest.approx(mean, abs=1e-6)
        variance = (selected * (place - mean) ** 2).sum() / selected.sum()
        assert (length**2 - 1) / 12 == pytest.approx(variance, rel=1e-5)


def test_a_cats_eye_leaves_lights_as_bright_as_the_rays_do():
    """Authority: the light of one pixel spread over a patch, gathered along rays."""
    aperture = Aperture(cats_eye=1.0)
    image = np.zeros((160, 160, 3), np.float32)
    defocus = np.full((160, 160), -14.0, np.float32)
    defocus[:, :70] = 0  # a depth discontinuity, so that rays are used nearby
    image[110:113, 110:113] = 0.5  # too little contrast, in a lit surrounding, to be a light
    image += 0.2
    gathered = rays(image, defocus, aperture=aperture)[..., 0] - 0.2
    lit = np.zeros((160, 160))
    for x in range(110, 113):
        for y in range(110, 113):
            lit += 0.5 * draw(point(x, y, -14.0), (160, 160), aperture)[..., 0]
    assert lit[100:122, 100:122].sum() == pytest.approx(gathered[100:122, 100:122].sum(), rel=0.03)
    assert np.corrcoef(lit[95:130, 95:130].ravel(), gathered[95:130, 95:130].ravel())[0, 1] > 0.97


def test_strips_of_a_picture_are_drawn_as_the_whole():
    aperture = Aperture(cats_eye=0.8)
    whole = draw(point(90.2, 70.4, -20.0), (100, 120), aperture)
    strip = draw(
        point(90.2, 30.4, -20.0),
        (60, 120),
        aperture,
        viewport=Viewport(left=0, top=40, width=120, height=100),
    )
    assert_allclose(strip, whole[40:], atol=1e-9)


def test_lights_grow_out_of_the_picture_without_a_step():
    """Energy of the light over its radius and over its brightness: no jump where it begins to be one."""

    def energy(radius, brightness):
        image = np.full((64, 64, 3), 0.1, np.float32)
        image[32, 32] = brightness
        layers = Layers(
            colors=image[:, :, None],
            defocus=np.full((64, 64, 1), radius, np.float32),
            coverage=np.ones((64, 64, 1), np.float32),
        )
        return separate_lights(layers, 20)[1][:, 3].sum()

    by_radius = [energy(radius, 50.0) for radius in np.linspace(2.9, 4.1, 49)]
    assert by_radius[0] == 0
    assert by_radius[-1] > 45
    assert np.diff(by_radius).max() < 0.05 * by_radius[-1]
    by_brightness = [energy(10.0, brightness) for brightness in np.linspace(0.1, 0.9, 81)]
    assert by_brightness[0] == 0
    assert np.diff(by_brightness).min() >= 0
    assert np.diff(by_brightness).max() < 0.0101


def test_a_plain_character_changes_no_bit():
    from bokehnet.optics.aberrations.lens_response import LensResponse

    plain, idle = (draw(point(30.2, 31.0, 20.0), (64, 64), lens_response=c) for c in (None, LensResponse()))
    assert_array_equal(plain, idle)
