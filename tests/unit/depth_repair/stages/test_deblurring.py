"""What blurred maps have lost. Authority: a map of known steps and wires, blurred by SciPy."""

import numpy as np
import pytest

from bokehnet.depth_repair.stages.deblurring import blur_map, estimate_blur, restore_blurred_detail

ndimage = pytest.importorskip("scipy.ndimage")
HEIGHT, WIDTH = 96, 128
WIRES = np.s_[:, 30:90:15]


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Picture, true disparity, and the same without its wires: what is left where a blur hid them."""
    rng = np.random.default_rng(2)
    image = 0.5 + 0.03 * rng.standard_normal((HEIGHT, WIDTH, 3))
    without = np.full((HEIGHT, WIDTH), 0.2)
    image[60:], without[60:] = (0.2, 0.3, 0.6), 0.5
    image[70:, 100:], without[70:, 100:] = (0.7, 0.2, 0.1), 0.9
    true = without.copy()
    for column in (0, 1):
        shifted = (WIRES[0], slice(WIRES[1].start + column, WIRES[1].stop, WIRES[1].step))
        image[shifted], true[shifted] = (0.05, 0.05, 0.08), 0.9
    return tuple(x.astype(np.float32) for x in (image, true, without))


@pytest.mark.parametrize("deviation", [0.8, 2.0, 4.3])
def test_maps_are_blurred_as_scipy_does(deviation):
    _, true, _ = scene()
    expected = ndimage.gaussian_filter(true, deviation, mode="nearest", truncate=4)
    np.testing.assert_allclose(blur_map(true, deviation), expected, atol=2e-3)
    assert blur_map(np.stack([true, true], -1), deviation).shape == (HEIGHT, WIDTH, 2)


@pytest.mark.parametrize("deviation", [2.0, 3.0, 4.5])
def test_the_blur_of_a_map_is_found(deviation):
    _, true, without = scene()
    given = ndimage.gaussian_filter(true, deviation)
    soft = np.abs(given - true) > 0.01
    assert abs(estimate_blur(given, true, soft).sigma / deviation - 1) < 0.07
    below = soft & (np.arange(WIDTH) < 20)  # where nothing is missing
    assert abs(estimate_blur(given, without, below).sigma / deviation - 1) < 0.07


def test_a_sharp_map_is_not_soft():
    _, true, _ = scene()
    assert estimate_blur(ndimage.gaussian_filter(true, 0.6), true, np.ones(true.shape, bool)).sigma == 0


def test_wires_that_the_blur_hid_are_found_again():
    image, true, without = scene()
    given = ndimage.gaussian_filter(true, 3.0)
    assert given[:, :90].max() < 0.7  # no pixel of the map holds a wire's depth
    found = restore_blurred_detail(image, given, without, 3.0)
    wires = true > without
    walls = ~ndimage.binary_dilation(wires, iterations=1)
    assert np.abs(without - true)[wires].mean() > 0.5
    assert np.abs(found - true)[wires].mean() < 0.25
    assert np.abs(found - true)[walls].mean() < 0.02
    assert found.max() <= without.max()
    assert found.min() >= without.min()
    assert np.abs(blur_map(found, 3.0) - given).mean() < 0.3 * np.abs(blur_map(without, 3.0) - given).mean()


def test_what_explains_the_given_map_stays():
    image, true, _ = scene()
    found = restore_blurred_detail(image, blur_map(true, 3.0), true, 3.0)
    np.testing.assert_array_equal(found, true)
