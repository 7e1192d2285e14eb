"""Spreading on layers, against double loops."""

import numpy as np
import pytest

from bokehnet.baselines.apertures import ladder_positions, psf_image, radius_ladder
from bokehnet.baselines.spread.layered_spreading import (
    composite_layers,
    interval_of,
    spread_intervals,
    spread_pixel_layers,
)
from bokehnet.baselines.spread.spreading import perimeter
from bokehnet.optics.aperture import Aperture
from tests.unit.baselines.spread.test_spreading import scene


def spread_to(image, defocus, layer_of):
    """Add every pixel's image of the aperture, pixel by pixel, to the layers that ``layer_of`` names."""
    height, width = defocus.shape
    layers = {}
    for y, x in np.ndindex(height, width):
        side = 1 if defocus[y, x] > 0 else -1
        radii = radius_ladder(max(0.0, float((side * defocus).max())))
        low, upper = ladder_positions(defocus[y : y + 1, x : x + 1], radii, side)
        for k, mix in ((low[0, 0], 1 - upper[0, 0]), (low[0, 0] + 1, upper[0, 0])):
            if mix <= 0:
                continue
            table = psf_image(Aperture(), float(radii[k]), side)
            half = len(table) // 2
            for v in range(max(0, y - half), min(height, y + half + 1)):
                for u in range(max(0, x - half), min(width, x + half + 1)):
                    weight = mix * table[v - y + half, u - x + half]
                    layer = layers.setdefault(layer_of(y, x, v, u), np.zeros((height, width, 4)))
                    layer[v, u] += weight * np.append(image[y, x], 1)
    return [layers[key] for key in sorted(layers)]


def over(layers):
    """Composite back to front, unlike the function."""
    result = np.zeros((*layers[0].shape[:2], 4))
    for layer in layers[::-1]:
        covering = layer / np.maximum(layer[..., 3:], 1)
        result = covering + (1 - covering[..., 3:]) * result
    return result[..., :3] / np.maximum(result[..., 3:], 1e-9)


def test_intervals_are_spread_and_composited():
    image, defocus = (part[:14, :16] for part in scene())
    defocus = np.ascontiguousarray(defocus)
    interval = interval_of(defocus, 3)
    expected = over(spread_to(image, defocus, lambda y, x, v, u: interval[y, x]))
    assert np.allclose(spread_intervals(image, defocus, layers=3), expected, atol=1e-5)


def test_pixel_layers_are_sorted_by_the_surface_of_the_pixel():
    image, defocus = (np.ascontiguousarray(part[:14, :16]) for part in scene())

    def layer_of(y, x, v, u):
        difference = defocus[y, x] - defocus[v, u]
        return 0 if difference > 1 else 2 if difference < -1 else 1

    expected = over(spread_to(image, defocus, layer_of))
    assert np.allclose(spread_pixel_layers(image, defocus), expected, atol=1e-5)


def test_one_interval_is_perimeter_spreading():
    image, defocus = scene()
    assert np.allclose(spread_intervals(image, defocus, layers=1), perimeter(image, defocus), atol=1e-5)


@pytest.mark.parametrize("method", [spread_intervals, spread_pixel_layers])
def test_blurred_light_from_behind_stays_behind_a_sharp_card(method):
    """Authority: geometry; without order, perimeter spreading leaks."""
    image = np.zeros((40, 60, 3), np.float32)
    image[:, 30:] = 1
    defocus = np.where(np.arange(60) < 30, 0.0, -8.0) * np.ones((40, 1))
    card = np.s_[10:30, 20:28]
    assert perimeter(image, defocus.astype(np.float32))[card].max() > 0.2
    assert method(image, defocus.astype(np.float32))[card].max() < 1e-6


def test_composite_is_over():
    red, green = np.zeros((1, 1, 4)), np.zeros((1, 1, 4))
    red[..., [0, 3]], green[..., [1, 3]] = 0.25, 2.0
    assert composite_layers([red, green], np.zeros((1, 1, 3)))[0, 0] == pytest.approx([0.25, 0.75, 0])
