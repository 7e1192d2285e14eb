"""Deblurring of soft maps. Authority: a map of known edges and wires, blurred by SciPy."""

import numpy as np
import pytest

from bokehnet.depth_repair.stages.deblur import (
    blur_map,
    estimate_blur,
    restore_blurred_detail,
)

ndimage = pytest.importorskip("scipy.ndimage")
HEIGHT, WIDTH = 96, 128
WIRES = np.s_[:, 30:90:15]


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the picture, the true disparity, and the disparity without wires that blur would remove."""
    rng = np.random.default_rng(2)
    image = 0.5 + 0.03 * rng.standard_normal((HEIGHT, WIDTH, 3))
    without_wires = np.full((HEIGHT, WIDTH), 0.2)
    image[60:], without_wires[60:] = (0.2, 0.3, 0.6), 0.5
    image[70:, 100:], without_wires[70:, 100:] = (0.7, 0.2, 0.1), 0.9
    truth = without_wires.copy()
    for column in (0, 1):
        shifted = (WIRES[0], slice(WIRES[1].start + column, WIRES[1].stop, WIRES[1].step))
        image[shifted], truth[shifted] = (0.05, 0.05, 0.08), 0.9
    return tuple(x.astype(np.float32) for x in (image, truth, without_wires))


@pytest.mark.parametrize("deviation", [0.8, 2.0, 4.3])
def test_the_blur_equals_that_of_scipy(deviation):
    _, truth, _ = scene()
    expected = ndimage.gaussian_filter(truth, deviation, mode="nearest", truncate=4)
    np.testing.assert_allclose(blur_map(truth, deviation), expected, atol=2e-3)
    assert blur_map(np.stack([truth, truth], -1), deviation).shape == (HEIGHT, WIDTH, 2)


@pytest.mark.parametrize("deviation", [2.0, 3.0, 4.5])
def test_the_blur_of_a_map_is_estimated(deviation):
    _, truth, without_wires = scene()
    blurred = ndimage.gaussian_filter(truth, deviation)
    soft = np.abs(blurred - truth) > 0.01
    assert abs(estimate_blur(blurred, truth, soft).sigma / deviation - 1) < 0.07
    soft_without_wires = soft & (np.arange(WIDTH) < 20)  # no wires here
    assert abs(estimate_blur(blurred, without_wires, soft_without_wires).sigma / deviation - 1) < 0.07


def test_a_sharp_map_is_not_soft():
    _, truth, _ = scene()
    assert estimate_blur(ndimage.gaussian_filter(truth, 0.6), truth, np.ones(truth.shape, bool)).sigma == 0


def test_wires_removed_by_blur_are_restored():
    image, truth, without_wires = scene()
    blurred = ndimage.gaussian_filter(truth, 3.0)
    assert blurred[:, :90].max() < 0.7  # no pixel of the map has the depth of a wire
    restored = restore_blurred_detail(image, blurred, without_wires, 3.0)
    wires = truth > without_wires
    walls = ~ndimage.binary_dilation(wires, iterations=1)
    assert np.abs(without_wires - truth)[wires].mean() > 0.5
    assert np.abs(restored - truth)[wires].mean() < 0.25
    assert np.abs(restored - truth)[walls].mean() < 0.02
    assert restored.max() <= without_wires.max()
    assert restored.min() >= without_wires.min()
    assert (
        np.abs(blur_map(restored, 3.0) - blurred).mean()
        < 0.3 * np.abs(blur_map(without_wires, 3.0) - blurred).mean()
    )


def test_a_map_that_reproduces_the_input_does_not_change():
    image, truth, _ = scene()
    restored = restore_blurred_detail(image, blur_map(truth, 3.0), truth, 3.0)
    np.testing.assert_array_equal(restored, truth)
