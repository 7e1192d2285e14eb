"""Truth: lamps before and behind an edge whose energy and depth are known by construction."""

import numpy as np
import pytest

from bokehnet.classical.layered.boundaries.light_carriers import split_lights
from bokehnet.classical.layered.depth_discontinuities import discontinuity_sides
from bokehnet.classical.layered.layers import split_layers
from bokehnet.classical.rays_renderer import rays

NEAR, FAR = 9.0, -9.0
LAMP = np.array([400.0, 300.0, 100.0], np.float32)


def night(lamp_is_near, coverage=0.3):
    """A dark edge at column 20; a lamp fills the last pixel of its side and ``coverage`` of the next one."""
    image = np.full((41, 41, 3), 0.02, np.float32)
    image[:, 20:] = 0.05
    defocus = np.where(np.arange(41) < 20, NEAR, FAR).astype(np.float32) * np.ones((41, 1), np.float32)
    own, other = (19, 20) if lamp_is_near else (20, 19)
    image[20, own] = LAMP
    image[20, other] += coverage * (LAMP - image[20, other])
    return image, defocus, other


@pytest.mark.parametrize("coverage", [0.3, 0.95])
@pytest.mark.parametrize("lamp_is_near", [True, False])
def test_light_of_a_lamp_beyond_its_edge_keeps_its_color_and_depth(lamp_is_near, coverage):
    image, defocus, column = night(lamp_is_near, coverage)
    lights = split_lights(image, defocus, discontinuity_sides(defocus), image[..., 0] > 1)
    assert list(zip(lights.rows, lights.columns, strict=True)) == [(20, column)]
    of_lamp = lights.coverage[0] if lamp_is_near else 1 - lights.coverage[0]
    assert of_lamp == pytest.approx(coverage, abs=1e-3)
    np.testing.assert_allclose((lights.front if lamp_is_near else lights.back)[0], LAMP, rtol=1e-3)
    assert (lights.near[0], lights.far[0], bool(lights.is_front[0])) == (NEAR, FAR, not lamp_is_near)


def test_both_surfaces_add_up_to_the_picture():
    rng = np.random.default_rng(0)
    image = rng.random((30, 40, 3), dtype=np.float32)
    image[rng.random((30, 40)) < 0.2] *= 100
    defocus = rng.choice([NEAR, 0.0, FAR], (30, 40)).astype(np.float32)
    lights = split_lights(image, defocus, discontinuity_sides(defocus), image.max(2) > 4)
    assert len(lights.rows) > 30
    share = lights.coverage[:, None]
    added = share * lights.front + (1 - share) * lights.back
    np.testing.assert_allclose(added, image[lights.rows, lights.columns], rtol=1e-5, atol=1e-5)
    assert min(lights.front.min(), lights.back.min()) >= -1e-6


def test_a_lamp_away_from_edges_stays_whole():
    image, defocus, _ = night(lamp_is_near=True)
    image[5, 5] = LAMP
    layers = split_layers(image, defocus)
    np.testing.assert_array_equal(layers.colors[5, 5, 0], LAMP)
    assert layers.coverage[5, 5, 0] == 1


@pytest.mark.parametrize("lamp_is_near", [True, False])
def test_a_lamp_at_an_edge_keeps_its_energy_and_one_disc(lamp_is_near):
    """The light of the lamp alone: what it adds to the render. In front, nothing hides any of it."""
    image, defocus, _ = night(lamp_is_near)
    dark = np.full_like(image, 0.02)
    dark[:, 20:] = 0.05
    added = rays(image, defocus) - rays(dark, defocus)
    energy = (image - dark).sum((0, 1), dtype=np.float64)
    result = added.sum((0, 1), dtype=np.float64) / energy
    if lamp_is_near:
        np.testing.assert_allclose(result, 1, atol=0.01)
    assert (result < 1.01).all()
    rows, columns = np.mgrid[:41, :41]
    beyond = np.hypot(rows - 20, columns - 19.5) > 9 + 2.5
    assert np.abs(added[beyond]).sum() < 1e-3 * np.abs(added).sum()


def test_a_hundred_thousand_lamps_are_finite_and_keep_their_light():
    """Lamps everywhere on one even surface, none leaves the frame: the sum of light stays."""
    rng = np.random.default_rng(1)
    height, width = 700, 900
    image = np.full((height, width, 3), 0.01, np.float32)
    inside = np.zeros((height, width), bool)
    inside[20:-20, 20:-20] = rng.random((height - 40, width - 40)) < 100_000 / ((height - 40) * (width - 40))
    image[inside] = rng.uniform(5, 500, (np.count_nonzero(inside), 3))
    defocus = np.where(np.arange(width) % 90 < 45, 6.0, 4.0).astype(np.float32) * np.ones(
        (height, 1), np.float32
    )
    rendered = rays(image, defocus)
    assert np.isfinite(rendered).all()
    assert abs(rendered.sum(dtype=np.float64) / image.sum(dtype=np.float64) - 1) < 0.02
