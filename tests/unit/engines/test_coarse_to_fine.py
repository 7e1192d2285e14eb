"""Correction at one coarse size: equal to the cascade of training without an IUNet."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.base import ClassicalResult
from bokehnet.classical.rays_renderer import render_rays
from bokehnet.engines.coarse_to_fine import CoarseInput
from bokehnet.engines.engine import Engine
from bokehnet.inference.coarse_to_fine import apply_change, render_neural, suppress_foreground_outlines
from bokehnet.inference.session import Networks
from bokehnet.optics.encoding import encode


def picture(height: int, width: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:height, :width]
    inside = np.hypot(y - height / 2, x - width / 3) < height / 4
    return rng.random((height, width, 3), dtype=np.float32), np.where(inside, radius, -0.3 * radius).astype(
        np.float32
    )


def networks(arnet, max_valid_radius: float = math.inf) -> Networks:
    return Networks(
        arnet=arnet,
        iunet=None,
        network_max_radius=10.0,
        classical="rays",
        max_valid_radius=max_valid_radius,
    )


@pytest.mark.parametrize(("height", "width", "radius"), [(40, 56, 6), (61, 83, 17), (130, 97, 33)])
def test_the_correction_equals_that_of_training_without_an_iunet(height, width, radius):
    """Oracle: the function that training uses, at 0, 1 and 2 halvings and odd sizes."""
    image, defocus = picture(height, width, radius)
    renderer = Engine("hybrid")
    renderer._networks = replace(renderer._networks, max_valid_radius=math.inf)
    result = renderer.render(image, defocus)
    classical = render_rays(image, defocus)
    batches = [
        x.transpose(2, 0, 1)[None]
        for x in (image, defocus[..., None], classical.bokeh, classical.error_map[..., None])
    ]
    networks_in_use = renderer._networks
    expected = render_neural(
        *batches,
        features=classical.features.transpose(2, 0, 1)[None],
        arnet=networks_in_use.arnet,
        network_max_radius=networks_in_use.network_max_radius,
    )
    in_reach = classical.error_map > 0
    assert in_reach.mean() > 0.1
    assert_allclose(result.error_map, expected.error_map[0, 0], atol=2e-5)
    neural = expected.picture[0].transpose(1, 2, 0)
    assert_allclose(result.neural[in_reach], neural[in_reach], atol=2e-4)
    assert_array_equal(result.bokeh[~in_reach], classical.bokeh[~in_reach])


def test_the_error_map_is_zero_beyond_the_valid_radius():
    """The error map is 1 up to half the valid radius and then decreases to 0."""
    radius = np.tile(np.linspace(0, 60, 64, dtype=np.float32), (64, 1))
    picture = np.ones((64, 64, 3), np.float32)
    small = CoarseInput(64, 64, 10.0, 10.0)  # no halving, so that pixels keep their values
    small.add(0, picture, radius, ClassicalResult(bokeh=picture, error_map=np.ones_like(radius)))
    correction = small.correct(networks(lambda image, *_: (image, np.ones_like(image[:, :1])), 40.0))
    error_map = correction.apply(picture, np.ones_like(radius), radius).error_map
    assert_allclose(error_map[radius <= 20], 1)
    assert_allclose(error_map[radius >= 40], 0)
    assert_allclose(
        error_map[(radius > 20) & (radius < 40)], (2 - radius / 20)[(radius > 20) & (radius < 40)], rtol=1e-5
    )


@pytest.mark.parametrize(
    ("radius", "coarse_radius", "error", "coarse_weight", "suppressed"),
    [
        (3, 3, 0.5, 1, 0.5),
        (0, 3, 0.5, 1, 0.5),
        (1.5, 0, 0.25, 0.25, 0.25),
        (9, 0, 0.25, 0.5, 0.5),
        (0, 20, 0.25, 0.5, 0.5),
        (6, 6, 0.25, 0.5, 0.375),
        (-9, -9, 1, 0, 1),
        (9, 9, 0, 0, 0),
    ],
)
def test_uncertain_scatter_in_front_of_focus_is_replaced(
    radius, coarse_radius, error, coarse_weight, suppressed
):
    """Authority: by hand; three coarse pixels of blur remove the detail, nine take the square root."""
    fine, coarse = np.full((1, 1, 4, 4), 0.9, np.float32), np.full((1, 1, 4, 4), 0.3, np.float32)
    maps = [np.full_like(fine, x) for x in (radius, coarse_radius, error)]
    light, error_map = suppress_foreground_outlines(fine, maps[0], coarse, maps[1], maps[2])
    assert_allclose(light, coarse_weight * coarse + (1 - coarse_weight) * fine, rtol=1e-6)
    assert_allclose(error_map, np.full_like(fine, suppressed), rtol=1e-6)
    if coarse_weight == 0:
        assert_array_equal(light, fine)


def test_a_leaf_far_in_front_of_focus_has_no_outline_in_the_engine_fast():
    """Authority: rays. The criterion is the largest difference of adjacent pixels at the outline."""
    y, x = np.mgrid[:160, :160].astype(np.float32)
    leaf = np.hypot(y - 80, (x - 80) / 2) < 22
    image = np.where(leaf[..., None], [0.1, 0.5, 0.05], [0.9, 0.8, 0.7]).astype(np.float32)
    defocus = np.where(leaf, 24, 0).astype(np.float32)
    inside = np.abs(np.hypot(y - 80, (x - 80) / 2) - 22) < 3

    def sharpness(engine: str) -> float:
        bokeh = encode(Engine(engine).render(image, defocus).bokeh)
        return float(np.abs(np.diff(bokeh, axis=0))[:, :-1][inside[:-1, :-1]].max())

    assert sharpness("fast") < 0.06 < 0.5 < sharpness("scatter")
    assert sharpness("rays") < 0.06


def test_a_change_of_zero_returns_the_classical_render():
    classical = np.random.default_rng(1).random((1, 3, 12, 16), dtype=np.float32)
    assert_allclose(apply_change(classical, np.zeros_like(classical)), classical, atol=1e-6)


def test_rows_in_parts_give_the_same_coarse_input():
    """The input of ARNet does not depend on the cuts of the rows."""
    image, defocus = picture(300, 70, 25)
    classical = render_rays(image, defocus)
    inputs = []

    def arnet(*arrays):
        inputs.append(arrays)
        return arrays[2], np.zeros_like(arrays[1])

    for cuts in ([0, 300], [0, 128, 256, 300]):
        small = CoarseInput(300, 70, 25.0, 10.0)
        for first, last in pairwise(cuts):
            rows = slice(first, last)
            small.add(first, image[rows], defocus[rows], classical.part(rows, slice(0, image.shape[1])))
        small.correct(networks(arnet))
    for whole, parts in zip(*inputs, strict=True):
        assert_array_equal(whole, parts)
