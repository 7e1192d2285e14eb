"""The ray tracer and the scatter render the same picture where the scatter is right."""

import math

import numpy as np
import pytest
from skimage.data import coffee

from bokehnet.classical.scatter_renderer import scatter
from bokehnet.io.color.srgb import linear_to_srgb, srgb_to_linear
from bokehnet.lenses import ThinLens, defocus_map
from bokehnet.raytrace import (
    Camera,
    Scene,
    background_from,
    render_all_in_focus,
    render_bokeh,
    render_disparity,
)

SIZE = 96
DEPTH = 2000.0


def camera(radius: float) -> Camera:
    """A camera whose blur at ``DEPTH`` is ``radius`` pixels; focus is nearer."""
    focus, focal_length, pitch = 1500.0, 50.0, 0.1
    distance = 1 / (1 / focal_length - 1 / focus)
    pupil = radius * pitch / (distance * abs(1 / DEPTH - 1 / focus))
    lens = ThinLens(focal_length=focal_length, f_number=focal_length / (2 * pupil), focus_distance=focus)
    return Camera(lens=lens, width=SIZE, height=SIZE, pixel_pitch=pitch)


def textured_wall(seen: Camera, texture: np.ndarray) -> Scene:
    """A wall that faces the lens, larger than the picture."""
    half = 1.5 * SIZE / 2 * seen.pixel_pitch / seen.lens.sensor_distance
    return Scene(background=background_from(texture, (half, half), 1 / DEPTH))


def inner(picture: np.ndarray, margin: int) -> np.ndarray:
    return picture[margin:-margin, margin:-margin]


@pytest.mark.parametrize("radius", [3.0, 9.5])
def test_a_facing_textured_plane_agrees_to_45_db(radius):
    """One depth, no edges: both give the disc convolution; borders, unseen by the scatter, are left out."""
    seen = camera(radius)
    scene = textured_wall(seen, srgb_to_linear(coffee()[60:348, 150:438].astype(np.float32) / 255))
    sharp = render_all_in_focus(scene, seen, 256, seed=0).numpy()
    defocus = defocus_map(render_disparity(scene, seen), seen.lens, seen.pixel_pitch).numpy()
    assert np.abs(defocus) == pytest.approx(radius, abs=1e-3)
    traced = render_bokeh(scene, seen, 1024, seed=1).numpy()
    margin = math.ceil(radius) + 2
    result, expected = (linear_to_srgb(inner(x, margin)) for x in (scatter(sharp, defocus), traced))
    assert -10 * np.log10(np.mean((result - expected) ** 2)) >= 45


@pytest.mark.parametrize("radius", [4.0, 12.3])
def test_a_point_becomes_the_disc_of_the_formula_in_both(radius):
    """Radius within 0.5 px of the lens formula and energy within 1e-3, in scatter and ray tracer alike."""
    seen = camera(radius)
    texture = np.zeros((144, 144, 3), np.float32)
    texture[69:75, 69:75] = 100.0
    scene = textured_wall(seen, texture)
    sharp = render_all_in_focus(scene, seen, 64, seed=0).numpy()
    defocus = defocus_map(render_disparity(scene, seen), seen.lens, seen.pixel_pitch).numpy()
    expected = abs(seen.lens.coc_radius(1 / DEPTH)) / seen.pixel_pitch
    y, x = np.mgrid[:SIZE, :SIZE] - (SIZE - 1) / 2

    def moment(picture: np.ndarray) -> float:
        return float((picture[..., 0] * (x**2 + y**2)).sum() / picture[..., 0].sum())

    for blurred in (scatter(sharp, defocus), render_bokeh(scene, seen, 4096, seed=1).numpy()):
        # Blurring adds the disc's second moment, r^2 / 2, to that of the sharp point.
        assert math.sqrt(2 * (moment(blurred) - moment(sharp))) == pytest.approx(expected, abs=0.5)
        assert blurred.sum() == pytest.approx(sharp.sum(), rel=1e-3)
