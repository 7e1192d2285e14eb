"""The error map in ONNX Runtime. Authority: the map of the package, to the last bit."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.classical.error_map import geometric_error_map as package_map
from bokehnet.onnx_file.error_map import geometric_error_map
from tests.unit.onnx_file.running import compiled, steps


@pytest.fixture(scope="module")
def call():
    return compiled(geometric_error_map, 2)


@pytest.mark.parametrize(
    ("height", "width", "radius"),
    [(1, 1, 3), (1, 60, 9), (60, 1, 9), (77, 131, 4), (77, 131, 40), (50, 60, 900)],
)
def test_discs_are_marked_around_the_same_boundaries(call, height, width, radius):
    defocus = steps(height, width, radius)
    np.testing.assert_array_equal(call(defocus), package_map(defocus))


def test_noise_is_all_boundary_and_a_plane_has_no_boundary(call):
    noise = np.random.default_rng(0).uniform(-9, 9, (60, 50)).astype(np.float32)
    np.testing.assert_array_equal(call(noise), package_map(noise))
    assert call(np.full((40, 30), 7)).max() == 0


def test_radii_that_are_whole_numbers_end_on_the_same_pixels(call):
    """The half width of a row is then often a whole number too, or just not."""
    for radius in (3.0, 8.0, 11.0, 23.0):
        defocus = np.zeros((61, 61), np.float32)
        defocus[30, 30] = radius
        np.testing.assert_array_equal(call(defocus), package_map(defocus))
