"""The power law in ONNX Runtime. Authority: the curve of the package."""

import numpy as np
import pytest

pytest.importorskip("onnx", reason="needs onnx, of the extra train")

from bokehnet.onnx_file.tone import gamma_curve
from bokehnet.optics.tone import gamma_curve as package_curve
from tests.unit.onnx_file.running import compiled, picture


def there_and_back(g, image, gamma):
    curve = gamma_curve(g, image, gamma)
    encoded = curve.encode(image)
    return [encoded, curve.decode(encoded)]


@pytest.fixture(scope="module")
def call():
    return compiled(there_and_back, 3, 0)


@pytest.mark.parametrize("gamma", [0.2, 0.7, 1.5, 2.2, 5.0])
@pytest.mark.parametrize("brightest", [1.0, 1e3, 1e7])
def test_values_are_those_of_the_package(call, gamma, brightest):
    image = picture(40, 53) ** 3
    image[7, 9] = brightest
    curve = package_curve(image, gamma)
    encoded, decoded = call(image.transpose(2, 0, 1), gamma)
    expected = curve.encode(image).transpose(2, 0, 1)
    np.testing.assert_allclose(encoded, expected, rtol=1e-4, atol=1e-30)
    np.testing.assert_allclose(
        decoded, curve.decode(curve.encode(image)).transpose(2, 0, 1), rtol=1e-4, atol=1e-6
    )


def test_black_stays_black_and_one_pixel_is_enough(call):
    assert not np.any(call(np.zeros((3, 4, 5)), 2.2))
    encoded, decoded = call(np.full((3, 1, 1), 0.25), 2.2)
    np.testing.assert_allclose(encoded, 1, rtol=1e-6)
    np.testing.assert_allclose(decoded, 0.25, rtol=1e-6)


def test_a_gamma_out_of_range_is_brought_back_into_it(call):
    image = picture(9, 8).transpose(2, 0, 1)
    for wrong, right in ((0.01, 0.2), (9, 5)):
        np.testing.assert_array_equal(call(image, wrong)[0], call(image, right)[0])
