"""Array types of the public functions: floats of any precision; other types raise errors."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bokehnet
from bokehnet.errors import ParameterError
from bokehnet.io.color.srgb import srgb_to_linear

RNG = np.random.default_rng(3)
CODES = RNG.integers(0, 256, (24, 32, 3), dtype=np.uint8)
LIGHT = srgb_to_linear(CODES / np.float32(255))
DISPARITY = np.repeat(np.linspace(0, 1, 32, dtype=np.float32)[None], 24, 0)

REFUSED = ["uint8", "uint16", "int16", "int64", "bool", "complex64", "object"]


def render(image=LIGHT, disparity=DISPARITY):
    renderer = bokehnet.BokehRenderer("scatter")
    return renderer.render(image, disparity=disparity, blur=6, focus=0.5).bokeh


PICTURE_FUNCTIONS = {
    "renderer": render,
    "scene": lambda image: bokehnet.make_scene(image, bokehnet.ConstantDisparity(value=0.5)),
    "repair": lambda image: bokehnet.DisparityRepair()(image, DISPARITY),
    "scatter": lambda image: bokehnet.scatter(image, 6 * DISPARITY),
    "rays": lambda image: bokehnet.rays(image, 6 * DISPARITY),
    "file": lambda image: bokehnet.write_image("never.png", image),
}


@pytest.mark.parametrize("dtype", REFUSED)
@pytest.mark.parametrize("function", PICTURE_FUNCTIONS)
def test_pictures_of_other_types_raise_errors(function, dtype, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=rf"^image: expected .* numbers.*, got an array of .*{dtype}"):
        PICTURE_FUNCTIONS[function](CODES.astype(dtype))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535)])
def test_the_remedy_decodes_codes_like_the_file_reader(dtype, white, tmp_path):
    """Oracle: the file reader for the same codes; the test runs the expression in the message."""
    codes = (CODES.astype(np.uint32) * (white // 255)).astype(dtype)
    with pytest.raises(ParameterError) as caught:
        render(codes)
    expression = f"bokehnet.io.color.srgb.srgb_to_linear(image / {white})"
    assert expression in str(caught.value)
    bokehnet.write_image(tmp_path / "codes.png", LIGHT)
    decoded = eval(expression, {"bokehnet": bokehnet, "image": codes})
    assert_allclose(decoded, bokehnet.read_image(tmp_path / "codes.png"), atol=1e-6)


@pytest.mark.parametrize("dtype", REFUSED)
def test_disparity_defocus_and_coverage_of_other_types_raise_errors(dtype):
    codes = CODES[..., 0].astype(dtype)
    result = rf"expected .*numbers.*, got an array of (.*{dtype}|shape)"
    with pytest.raises(ParameterError, match=f"^disparity: {result}"):
        render(disparity=codes)
    with pytest.raises(ParameterError, match=f"^defocus: {result}"):
        bokehnet.BokehRenderer("scatter").render(LIGHT, codes)
    with pytest.raises(ParameterError, match=f"^alpha: {result}"):
        bokehnet.make_scene(LIGHT, bokehnet.ConstantDisparity(value=0.5), alpha=codes)


def test_a_depth_source_normalises_integers():
    """Relative disparity has no unit: minimum and maximum are 0 and 1 in any type."""
    codes = np.repeat(np.arange(32, dtype=np.uint16)[None], 24, 0)
    expected = bokehnet.make_scene(LIGHT, bokehnet.RelativeDisparity(map=DISPARITY)).depth.values
    result = bokehnet.make_scene(LIGHT, bokehnet.RelativeDisparity(map=codes)).depth.values
    assert_allclose(result, expected, atol=1e-6)


def test_float16_renders_like_float32():
    expected = render(
        LIGHT.astype(np.float16).astype(np.float32), DISPARITY.astype(np.float16).astype(np.float32)
    )
    result = render(LIGHT.astype(np.float16), DISPARITY.astype(np.float16).astype(np.float32))
    assert result.dtype == np.float32
    assert_array_equal(result, expected)


def test_float64_is_rounded_to_float32():
    result = render(LIGHT.astype(np.float64), DISPARITY.astype(np.float64))
    assert result.dtype == np.float32
    assert_allclose(result, render(), atol=2e-6)


def test_the_input_does_not_change():
    image, disparity = LIGHT.astype(np.float64), DISPARITY.copy()
    original = image.copy(), disparity.copy()
    render(image, disparity)
    assert_array_equal(image, original[0])
    assert_array_equal(disparity, original[1])
