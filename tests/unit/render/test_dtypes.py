"""Array types of the public API: floats of any length; nothing else is rendered silently."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import bokehnet
from bokehnet.errors import ParameterError, ShapeError
from bokehnet.io.color.srgb import srgb_to_linear

RNG = np.random.default_rng(3)
CODES = RNG.integers(0, 256, (24, 32, 3), dtype=np.uint8)
LIGHT = srgb_to_linear(CODES / np.float32(255))
DISPARITY = np.repeat(np.linspace(0, 1, 32, dtype=np.float32)[None], 24, 0)

REFUSED = ["uint8", "uint16", "int16", "int64", "bool", "complex64", "object"]


def render(image=LIGHT, disparity=DISPARITY):
    renderer = bokehnet.BokehRenderer("scatter")
    return renderer.render_arrays(image, disparity=disparity, blur=6, focus=0.5).bokeh


PICTURE_TAKERS = {
    "renderer": render,
    "scene": lambda image: bokehnet.make_scene(image, bokehnet.ConstantDisparity(value=0.5)),
    "repair": lambda image: bokehnet.DisparityRepair()(image, DISPARITY),
    "scatter": lambda image: bokehnet.scatter(image, 6 * DISPARITY),
    "rays": lambda image: bokehnet.rays(image, 6 * DISPARITY),
    "file": lambda image: bokehnet.write_image("never.png", image),
}


@pytest.mark.parametrize("dtype", REFUSED)
@pytest.mark.parametrize("taker", PICTURE_TAKERS)
def test_pictures_of_anything_but_floats_are_refused(taker, dtype, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=rf"^image: expected .* numbers.*, got an array of .*{dtype}"):
        PICTURE_TAKERS[taker](CODES.astype(dtype))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 65535)])
def test_the_way_out_of_a_refused_picture_is_the_decoding_of_its_file(dtype, white, tmp_path):
    """Oracle: the reader of files, for the same codes; what the message says is run as it stands."""
    codes = (CODES.astype(np.uint32) * (white // 255)).astype(dtype)
    with pytest.raises(ParameterError) as caught:
        render(codes)
    message = "bokehnet.as_image(image)"
    assert message in str(caught.value)
    bokehnet.write_image(tmp_path / "codes.png", LIGHT)
    decoded = eval(message, {"bokehnet": bokehnet, "image": codes})
    assert_allclose(decoded, bokehnet.read_image(tmp_path / "codes.png"), atol=1e-6)


@pytest.mark.parametrize("dtype", REFUSED)
def test_disparity_defocus_and_coverage_of_anything_but_floats_are_refused(dtype):
    codes = CODES[..., 0].astype(dtype)
    result = rf"expected .*numbers.*, got an array of (.*{dtype}|shape)"
    with pytest.raises(ParameterError, match=f"^disparity: {result}"):
        render(disparity=codes)
    with pytest.raises(ParameterError, match=f"^defocus: {result}"):
        bokehnet.BokehRenderer("scatter").render_arrays(LIGHT, codes)
    with pytest.raises(ParameterError, match=f"^alpha: {result}"):
        bokehnet.make_scene(LIGHT, bokehnet.ConstantDisparity(value=0.5), alpha=codes)


def test_a_source_takes_integers_over_their_own_range():
    """Relative disparity has no unit: the lowest and the highest value are 0 and 1 in any type."""
    codes = np.repeat(np.arange(32, dtype=np.uint16)[None], 24, 0)
    expected = bokehnet.make_scene(LIGHT, bokehnet.RelativeDisparity(map=DISPARITY)).depth.values
    result = bokehnet.make_scene(LIGHT, bokehnet.RelativeDisparity(map=codes)).depth.values
    assert_allclose(result, expected, atol=1e-6)


def test_floats_of_16_bits_are_rendered_as_the_float32_that_they_are():
    expected = render(
        LIGHT.astype(np.float16).astype(np.float32), DISPARITY.astype(np.float16).astype(np.float32)
    )
    picture = render(LIGHT.astype(np.float16), DISPARITY.astype(np.float16).astype(np.float32))
    assert picture.dtype == np.float32
    assert_array_equal(picture, expected)


def test_floats_of_64_bits_are_rounded_to_float32():
    picture = render(LIGHT.astype(np.float64), DISPARITY.astype(np.float64))
    assert picture.dtype == np.float32
    assert_allclose(picture, render(), atol=2e-6)


def test_the_input_is_not_changed():
    image, disparity = LIGHT.astype(np.float64), DISPARITY.copy()
    before = image.copy(), disparity.copy()
    render(image, disparity)
    assert_array_equal(image, before[0])
    assert_array_equal(disparity, before[1])


def test_a_map_of_64_bits_gives_the_picture_of_its_32_bits():
    assert_array_equal(render(disparity=DISPARITY.astype(np.float64)), render())


def test_masked_values_are_refused_as_arrays_and_missing_as_maps():
    masked = np.ma.array(DISPARITY, mask=DISPARITY > 0.5)
    with pytest.raises(ParameterError, match=r"^disparity: expected values everywhere, got \d+ masked"):
        render(disparity=masked)
    filled = bokehnet.make_scene(LIGHT, bokehnet.RelativeDisparity(map=masked, holes="fill"))
    assert np.isfinite(filled.depth.values).all()
    assert filled.depth.values.max() == pytest.approx(1)


def test_errors_name_the_map_that_was_given():
    with pytest.raises(ShapeError, match="disparity"):
        render(disparity=DISPARITY[:10])
    with pytest.raises(ParameterError, match=r"^source: expected a depth source, such as"):
        bokehnet.make_scene(LIGHT, "disparity.png")
