"""The curves that weigh light before blurring: inverses, continuity, and the precision that is promised."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.classical.scatter_renderer import scatter
from bokehnet.errors import ParameterError
from bokehnet.optics.tone import Highlights, gamma_curve

GAMMAS = [0.2, 0.45, 1.001, 1.8, 2.2, 3.0, 5.0]
WIDE = np.geomspace(1e-6, 1e4, 600)

# Half a step of 8-bit sRGB at black, IEC 61966-2-1.
INVISIBLE_ERROR = 0.5 / 255 / 12.92


def grey(values):
    return np.repeat(np.asarray(values, np.float32).reshape(1, -1, 1), 3, axis=2)


def picture_of(values, white=1.0):
    """A row of ``values`` behind so many white pixels that these are the 99th percentile."""
    return grey(np.concatenate([np.full(100 * len(values), white), values]))


@pytest.mark.parametrize("gamma", GAMMAS)
@pytest.mark.parametrize("white", [1e-6, 0.3, 1.0, 1e4])
def test_gamma_is_undone_from_1e_6_to_1e4_whatever_white_is(gamma, white):
    """Monotone and invertible to a few roundings of float32; gamma 0.2 undoes by a fifth power."""
    image = picture_of(WIDE, white)
    curve = gamma_curve(image, gamma)
    encoded = curve.encode(image)
    assert encoded.dtype == np.float32
    assert (encoded > np.finfo(np.float32).tiny).all()
    assert encoded.max() < 1e20  # far from overflow, also of sums over a picture
    assert (np.diff(encoded[0, -len(WIDE) :, 0]) > 0).all()
    assert_allclose(curve.decode(encoded), image, rtol=3e-6)


@pytest.mark.parametrize(
    ("gamma", "brightest"), [(0.45, 1e4), (1.8, 1e4), (2.2, 1e4), (3.0, 400), (5.0, 5.8)]
)
def test_a_picture_within_the_documented_range_gets_the_pure_power(gamma, brightest):
    """Oracle: u ** gamma in double precision, above the toe."""
    values = np.geomspace(0.01, brightest, 200)
    curve = gamma_curve(picture_of(values), gamma)
    assert curve.white == 1
    assert curve.toe <= 0.01
    assert_allclose(curve.encode(values), values**gamma, rtol=1e-12)


def test_toe_without_lights_has_its_documented_position():
    assert gamma_curve(grey([1.0, 1.0]), 2.2).toe == pytest.approx(1e-10, rel=0.5)
    assert gamma_curve(grey([1.0, 1.0]), 5.0).toe == pytest.approx(1e-3, rel=0.2)


BEYOND = [(2.5, 1e4), (2.5, 1e9), (4.0, 1e3), (4.0, 1e9), (5.0, 30.0), (5.0, 1e4)]


@pytest.mark.parametrize(("gamma", "brightest"), BEYOND)
def test_beyond_the_range_a_line_goes_on_with_the_slope_at_the_shoulder(gamma, brightest):
    """Authority: the definition; slope by difference quotients in double precision."""
    curve = gamma_curve(picture_of([brightest]), gamma)
    k = curve.shoulder
    assert 0.1 < k < brightest / curve.white
    u = np.array([k * (1 - 1e-6), k, k * (1 + 1e-6), 2 * k, 3 * k])
    y = curve.encode(curve.white * u)
    expected = gamma * k ** (gamma - 1)
    assert_allclose([(y[1] - y[0]) / (u[1] - u[0]), (y[2] - y[1]) / (u[2] - u[1])], expected, rtol=1e-5)
    assert_allclose((y[4] - y[3]) / k, expected, rtol=1e-9)


@pytest.mark.parametrize("gamma", [2.2, 3.0, 5.0])
@pytest.mark.parametrize("light", [1.0, 1e3, 1e4])
@pytest.mark.parametrize("radius", [2.2, 9.3])
def test_black_and_dark_pixels_next_to_a_light_stay(gamma, light, radius):
    """Authority: exact arithmetic, in which no light reaches pixels beyond the disc.

    The rows with the light are black on one side and dark on the other; what is added may not be seen.
    """
    dark = 1e-3
    image = np.full((40, 160, 3), 0.5, np.float32)
    image[:20, :80], image[:20, 80:] = dark, 0.0
    image[8:11, 60:63] = light
    curve = gamma_curve(image, gamma)
    assert curve.white == 0.5
    blurred = curve.decode(scatter(curve.encode(image), np.full((40, 160), radius, np.float32)))
    assert blurred[:10, 92:].max() <= INVISIBLE_ERROR * curve.white
    away = blurred[:10, :45]
    assert_allclose(away, dark, atol=INVISIBLE_ERROR * curve.white)
    assert blurred[8:11, 60:63].min() > 1.5 * dark


@pytest.mark.parametrize("gamma", GAMMAS)
def test_a_change_of_exposure_passes_through(gamma):
    """Rendering s * image gives s times the rendering: nothing in the curve is tied to a unit of light."""
    rng = np.random.default_rng(0)
    image = (10 ** rng.uniform(-4, 3, (30, 40, 3))).astype(np.float32)
    defocus = np.full((30, 40), 5.5, np.float32)

    def render(light):
        curve = gamma_curve(light, gamma)
        return curve.decode(scatter(curve.encode(light), defocus))

    assert_allclose(render(image * np.float32(1e-3)), 1e-3 * render(image), rtol=2e-5)


def test_gamma_weighs_bright_pixels_by_the_power_mean():
    """Oracle: the power mean ((a^g + b^g) / 2)^(1/g) of a fine checkerboard, far from the border."""
    y, x = np.mgrid[:60, :60]
    image = np.where((y + x) % 2, 0.8, 0.2).astype(np.float32)[..., None].repeat(3, -1)
    for gamma in (0.5, 2.0, 4.0):
        curve = gamma_curve(image, gamma)
        blurred = curve.decode(scatter(curve.encode(image), np.full((60, 60), 11.0, np.float32)))
        expected = ((0.8**gamma + 0.2**gamma) / 2) ** (1 / gamma)
        assert blurred[20:40, 20:40] == pytest.approx(expected, rel=1e-2)


def test_a_black_picture_and_a_lonely_light_have_a_curve():
    black = np.zeros((4, 5, 3), np.float32)
    curve = gamma_curve(black, 3.0)
    assert_array_equal(curve.decode(curve.encode(black)), black)
    night = np.zeros((40, 50, 3), np.float32)
    night[7, 9] = 1e4
    curve = gamma_curve(night, 3.0)
    assert_allclose(curve.decode(curve.encode(night)), night, rtol=1e-6)


@pytest.mark.parametrize("gamma", [0.0, -1.0, 0.19, 5.1, np.nan, np.inf])
def test_gamma_out_of_range_is_reported(gamma):
    with pytest.raises(ParameterError, match=r"^gamma: expected"):
        gamma_curve(grey([1.0]), gamma)


CURVES = st.builds(Highlights, threshold=st.floats(0, 0.99), gain=st.floats(1, 1000))


@given(CURVES)
def test_highlights_grow_monotonically_and_white_becomes_the_gain(curve):
    values = np.linspace(0, 3, 301)
    expanded = curve.expand(grey(values).astype(np.float64))[0, :, 0]
    assert (np.diff(expanded) > 0).all()
    assert curve.expand(np.ones((1, 3)))[0, 0] == pytest.approx(curve.gain)


@given(CURVES)
def test_light_up_to_the_threshold_keeps_every_bit(curve):
    rng = np.random.default_rng(0)
    image = (rng.random((5, 6, 3)) * curve.threshold).astype(np.float32)
    image = np.minimum(image, np.float32(curve.threshold))
    below = image.max(-1) <= curve.threshold
    assert_array_equal(curve.expand(image)[below], image[below])
    assert_array_equal(curve.compress(image)[below], image[below])


@given(st.builds(Highlights, threshold=st.floats(0, 0.9), gain=st.floats(1, 100)))
def test_the_slope_is_continuous(curve):
    """Authority: the definition of C1, by difference quotients on both sides of each of the two joints."""
    for joint, slope in ((curve.threshold, 1.0), (1.0, 1 + 2 * (curve.gain - 1) / (1 - curve.threshold))):
        step = 1e-7 * (1 - curve.threshold)
        near = joint + step * np.array([-1.0, 0.0, 1.0])
        if near[0] <= 0:
            continue
        y = curve.expand(np.repeat(near[:, None], 3, 1))[:, 0]
        assert np.diff(y) / np.diff(near) == pytest.approx(slope, rel=1e-3)


@pytest.mark.parametrize(("dtype", "rtol"), [(np.float32, 1e-5), (np.float64, 1e-9)])
@pytest.mark.parametrize("curve", [Highlights(), Highlights(threshold=0, gain=50), Highlights(threshold=0.5)])
def test_highlights_round_trip(curve, dtype, rtol):
    image = (10 ** np.random.default_rng(0).uniform(-6, 4, (40, 50, 3))).astype(dtype)
    back = curve.compress(curve.expand(image))
    assert back.dtype == dtype
    assert_allclose(back, image, rtol=rtol)


def test_colours_keep_their_hue():
    """Authority: the definition; the channels keep their ratios, and the brightest follows the curve."""
    colour = np.array([[1.0, 0.5, 0.25]])
    assert_allclose(Highlights(threshold=0.8, gain=6).expand(colour), 6 * colour)


def test_a_gain_of_one_changes_nothing():
    image = np.random.default_rng(0).random((9, 9, 3), dtype=np.float32) * 2
    assert_allclose(Highlights(threshold=0.3, gain=1).expand(image), image, rtol=1e-6)


def test_highlights_of_tensors_are_those_of_arrays_with_right_gradients():
    """Oracle for the gradient: finite differences in double precision."""
    torch = pytest.importorskip("torch")
    curve = Highlights(threshold=0.6, gain=4)
    colours = torch.tensor([[0.1, 0.2, 0.3], [0.7, 0.2, 0.1], [1.5, 1.2, 0.3]], dtype=torch.float64)
    colours.requires_grad_()
    assert_allclose(curve.expand(colours).detach(), curve.expand(colours.detach().numpy()), rtol=1e-12)
    assert torch.autograd.gradcheck(curve.expand, colours)
    assert torch.autograd.gradcheck(curve.compress, colours)


@pytest.mark.parametrize("numbers", [{"threshold": 1.0}, {"threshold": -0.1}, {"threshold": np.nan}])
def test_a_threshold_out_of_range_is_reported(numbers):
    with pytest.raises(ParameterError, match=r"^threshold: expected at least 0 and below 1"):
        Highlights(**numbers)


@pytest.mark.parametrize("gain", [0.5, -1.0, np.nan, np.inf])
def test_a_gain_out_of_range_is_reported(gain):
    with pytest.raises(ParameterError, match=r"^gain: expected"):
        Highlights(gain=gain)
