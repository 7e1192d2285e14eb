import numpy as np
import pytest

from bokehnet.raytrace.surfaces.shapes import OPEN_SHAPES, SOLID_SHAPES, THIN_SHAPES, Canvas
from bokehnet.raytrace.surfaces.textures import TEXTURES, fractal_noise, light_points

SHAPES = SOLID_SHAPES | OPEN_SHAPES | THIN_SHAPES


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("size", [(3, 3), (8, 40), (96, 64)])
def test_shapes_fill_part_of_a_finite_mask(name, size):
    for seed in range(3):
        alpha = SHAPES[name](*size, np.random.default_rng(seed))
        assert alpha.shape == size
        assert alpha.dtype == np.float32
        assert alpha.min() >= 0
        assert alpha.max() <= 1
        assert np.array_equal(alpha, SHAPES[name](*size, np.random.default_rng(seed)))
    if size == (96, 64):
        assert 0.005 < alpha.mean() < 0.99


@pytest.mark.parametrize("name", TEXTURES)
@pytest.mark.parametrize("size", [(8, 8), (64, 96)])
def test_textures_are_finite_positive_and_varied(name, size):
    picture = TEXTURES[name](*size, np.random.default_rng(1))
    assert picture.shape == (*size, 3)
    assert picture.dtype == np.float32
    assert picture.min() >= 0
    assert picture.max() <= 1.0001
    if size == (64, 96):
        assert picture.std() > 0.01


def test_stroke_covers_the_area_of_a_capsule():
    """Authority: area of a rectangle and two half discs."""
    canvas = Canvas(40, 60)
    canvas.add_stroke(np.array([15.0, 20.0]), np.array([45.0, 20.0]), 6.0, 6.0)
    assert canvas.alpha.sum() == pytest.approx(30 * 12 + np.pi * 36, rel=0.005)


def test_leaf_covers_the_area_of_a_lens_of_two_arcs():
    """Authority: area of two circular segments."""
    canvas, length, breadth = Canvas(64, 64), 24.0, 8.0
    canvas.add_leaf(np.array([32.0, 32.0]), 0.7, length, breadth)
    radius = (length**2 + breadth**2) / (2 * breadth)
    half_angle = np.arcsin(length / radius)
    area = radius**2 * (2 * half_angle - np.sin(2 * half_angle))
    assert canvas.alpha.sum() == pytest.approx(area, rel=0.01)


def test_amplitude_of_fractal_noise_falls_with_the_power_of_the_frequency():
    """Authority: the definition, amplitude ~ frequency ** -power; clipped peaks bend it a little."""
    noise = np.mean(
        [np.abs(np.fft.fft2(fractal_noise(128, 128, np.random.default_rng(s), 1.2))) for s in range(8)], 0
    )
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(128), np.fft.fftfreq(128)))
    band = (frequency > 0.02) & (frequency < 0.2)
    slope = np.polyfit(np.log(frequency[band]), np.log(noise[band]), 1)[0]
    assert slope == pytest.approx(-1.2, abs=0.08)


def test_lamps_are_bright_small_and_transparent_between():
    colour, alpha = light_points(64, 64, np.random.default_rng(0), radius=(1.0, 2.0), peak=(20.0, 40.0))
    assert colour.max() > 15
    assert 0 < (alpha > 0).mean() < 0.5
    assert (colour[alpha == 0] == 0).all()
