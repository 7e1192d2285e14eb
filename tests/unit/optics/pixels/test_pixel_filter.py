"""Authorities: the published formulas, integrated by quadrature; identities of filters."""

import math

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.optics.pixels.pixel_filter import DEFAULT_FILTER, PixelFilter, parse_pixel_filter


def published(name, width, x):
    """The filter as it is published, at distances ``x`` in pixels, not normalised."""
    x = np.abs(x)
    if name == "box":
        return (x <= width / 2).astype(float)
    if name == "gaussian":  # RiGaussianFilter
        return np.where(x <= width / 2, np.exp(-2 * (2 * x / width) ** 2), 0)
    if name == "blackman-harris":  # filter_func_blackman_harris, over 2 width as filter_table makes it
        v = 2 * np.pi * (x / (2 * width) + 0.5)
        window = 0.35875 - 0.48829 * np.cos(v) + 0.14128 * np.cos(2 * v) - 0.01168 * np.cos(3 * v)
        return np.where(x <= width, window, 0)
    b = c = 1 / 3  # Mitchell and Netravali, eq. 8
    t = x * 4 / width
    near = ((12 - 9 * b - 6 * c) * t**3 + (-18 + 12 * b + 6 * c) * t**2 + (6 - 2 * b)) / 6
    far = ((-b - 6 * c) * t**3 + (6 * b + 30 * c) * t**2 + (-12 * b - 48 * c) * t + (8 * b + 24 * c)) / 6
    return np.where(t < 1, near, np.where(t < 2, far, 0))


@pytest.mark.parametrize(
    ("name", "width"),
    [
        ("box", 1.0),
        ("box", 1.7),
        ("blackman-harris", 1.5),
        ("blackman-harris", 2.2),
        ("gaussian", 2.0),
        ("gaussian", 4.5),
        ("mitchell", 4.0),
        ("mitchell", 3.0),
    ],
)
def test_integrals_are_those_of_quadrature(name, width):
    """Midpoints of steps of 1/4000 pixel; an edge of the box may lie inside a step."""
    step = 1 / 4000
    x = np.arange(-2.5 + step / 2, 2.5, step)
    parts = published(name, width, x)
    running = np.cumsum(parts) / parts.sum()
    pixel_filter = PixelFilter(name, width)
    np.testing.assert_allclose(pixel_filter.cumulative(x + step / 2), running, atol=3e-4)
    expected = running.reshape(5, -1)[:, -1] - np.append(0, running.reshape(5, -1)[:-1, -1])
    weights = pixel_filter.weights()
    outer = (5 - len(weights)) // 2
    inside = expected[outer : 5 - outer]
    np.testing.assert_allclose(weights, inside / inside.sum(), atol=3e-4)
    assert abs(expected[:outer]).sum() < 0.02


@pytest.mark.parametrize("factor", [2, 3, 4])
@pytest.mark.parametrize(
    ("name", "width"), [("box", 1.0), ("blackman-harris", 1.5), ("gaussian", 2.4), ("mitchell", 4.0)]
)
def test_weights_of_finer_pixels_are_the_filter_at_their_middles(name, width, factor):
    weights = PixelFilter(name, width).fine_weights(factor)
    middles = (np.arange(len(weights)) - (len(weights) - 1) / 2) / factor
    expected = published(name, width, middles)
    np.testing.assert_allclose(weights, expected / expected.sum(), atol=1e-12)
    one_further = published(name, width, middles[-1] + 1 / factor)
    assert abs(one_further) < 1e-12


@pytest.mark.parametrize("name", ["box", "blackman-harris", "gaussian", "mitchell"])
@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_narrow_filters_weigh_finer_pixels_too(name, factor):
    weights = PixelFilter(name, 0.05).fine_weights(factor)
    assert len(weights) == factor
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_array_equal(weights, weights[::-1])


def test_the_filter_of_blender_over_its_pixels():
    """Authority: quadrature of the window over [-1.5, 1.5], to four digits."""
    np.testing.assert_allclose(parse_pixel_filter("blender").weights(), [0.1186, 0.7628, 0.1186], atol=5e-5)
    assert parse_pixel_filter("cycles") == DEFAULT_FILTER


def test_widths_of_renderers_are_those_of_their_manuals():
    assert parse_pixel_filter("arnold") == parse_pixel_filter("renderman") == PixelFilter("gaussian", 2)
    assert parse_pixel_filter("gaussian:1.25") == PixelFilter("gaussian", 1.25)
    assert parse_pixel_filter("arnold:3") == PixelFilter("gaussian", 3)


def test_moments_of_mitchell():
    """A cubic with the parameter B has the variance B / 3 in its own pixels."""
    x = np.linspace(-2, 2, 40001)
    parts = np.diff(PixelFilter("mitchell", 4).cumulative(x))
    middle = (x[1:] + x[:-1]) / 2
    assert math.isclose(float((parts * middle**2).sum()), 1 / 9, rel_tol=1e-4)


@pytest.mark.parametrize(
    "text", ["lanczos", "", "gaussian:", "gaussian:-1", "gaussian:0", "gaussian:6", "box 1"]
)
def test_other_texts_are_refused(text):
    with pytest.raises(ParameterError, match=r"pixel_filter: expected .* got"):
        parse_pixel_filter(text)


def test_another_name_is_refused():
    with pytest.raises(ParameterError, match="pixel_filter: expected one of box, "):
        PixelFilter("sinc", 2)
