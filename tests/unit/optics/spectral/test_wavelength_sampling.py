"""Draws of light against exact integrals over the spectrum."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bokehnet.errors import ParameterError
from bokehnet.optics.sampling import disc_from_square, halton
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

# Midpoints of 1 / 10 nm: sums over them are the integrals that draws must meet.
FINE = MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(3000) + 0.5) / 3000
EQUALISERS = [(1.0,), (1, 0.2, 3, 1, 0.5), (5, 0, 1, 0, 0, 4, 0, 2), (0.1, 1, 4, 1, 0.1)]
COUNTS = [8, 13, 64, 72, 576, 1152]


def gain_at(gains, wavelength):
    """The equaliser by its words: straight lines between the middles of the bands, flat beyond them."""
    place = (wavelength - MIN_WAVELENGTH) / (MAX_WAVELENGTH - MIN_WAVELENGTH) * len(gains) - 0.5
    below = int(np.clip(np.floor(place), 0, max(len(gains) - 2, 0)))
    above = min(below + 1, len(gains) - 1)
    along = np.clip(place - below, 0, 1)
    return (1 - along) * gains[below] + along * gains[above]


def exact_means(gains, function):
    """Mean of a function over the light of each channel, by its definition."""
    light = np.maximum(wavelength_color(FINE), 0) * np.array([gain_at(gains, x) for x in FINE])[:, None]
    return (light * function(FINE)[:, None]).sum(0) / light.sum(0)


@pytest.mark.parametrize("gains", EQUALISERS)
@pytest.mark.parametrize("dispersion", ["continuous", "rgb"])
@pytest.mark.parametrize("count", COUNTS)
def test_white_stays_white(gains, dispersion, count):
    """Light without fringes keeps its colour with any equaliser."""
    wavelengths, weights = WavelengthSampling(dispersion=dispersion, equaliser=gains).sample(count)
    assert wavelengths.shape == (count,)
    assert weights.shape == (count, 3)
    assert_allclose(weights.mean(0), 1, rtol=1e-12)
    assert (weights >= 0).all()
    assert MIN_WAVELENGTH <= wavelengths.min() < wavelengths.max() <= MAX_WAVELENGTH


@pytest.mark.parametrize("gains", EQUALISERS)
@pytest.mark.parametrize("count", COUNTS)
def test_means_are_those_of_the_spectrum(gains, count):
    """Authority: the integral over the spectrum. Halton's sums err by about log(count) / count."""
    wavelengths, weights = WavelengthSampling(equaliser=gains).sample(count)
    for function, factor in (
        (lambda x: (x - MIN_WAVELENGTH) / (MAX_WAVELENGTH - MIN_WAVELENGTH), 0.25),
        (
            lambda x: np.cos((x - MIN_WAVELENGTH) / (MAX_WAVELENGTH - MIN_WAVELENGTH) * 2 * np.pi),
            1.3,
        ),
    ):
        result = (weights * function(wavelengths)[:, None]).mean(0)
        assert_allclose(result, exact_means(gains, function), atol=factor * np.log(count) / count)


@pytest.mark.parametrize("gains", EQUALISERS)
@pytest.mark.parametrize("count", COUNTS)
def test_each_channel_is_cumulated_as_in_the_spectrum(gains, count):
    """The star discrepancy of wavelengths in the light of each channel, against the exact distribution."""
    wavelengths, weights = WavelengthSampling(equaliser=gains).sample(count)
    order = np.argsort(wavelengths)
    for channel in range(3):
        result = np.cumsum(weights[order, channel]) / count
        light = np.maximum(wavelength_color(FINE)[:, channel], 0) * [gain_at(gains, x) for x in FINE]
        exact = np.interp(wavelengths[order], FINE + 0.05, np.cumsum(light) / light.sum())
        before = result - weights[order, channel] / count
        discrepancy = max(np.abs(result - exact).max(), np.abs(before - exact).max())
        assert discrepancy < 2 * np.log(count) / count


@pytest.mark.parametrize("gains", EQUALISERS)
def test_every_run_of_a_long_draw_is_well_spread(gains):
    """Each pixel takes a run of 64 of the long draw of all patterns; authority as above."""
    wavelengths, weights = WavelengthSampling(equaliser=gains).sample(9216)
    runs = weights.reshape(144, 64, 3)
    tilt = (wavelengths.reshape(144, 64, 1) - MIN_WAVELENGTH) / (MAX_WAVELENGTH - MIN_WAVELENGTH)
    result = (runs * tilt).sum(1) / runs.sum(1)
    exact = exact_means(gains, lambda x: (x - MIN_WAVELENGTH) / (MAX_WAVELENGTH - MIN_WAVELENGTH))
    assert np.abs(result - exact).max() < 0.03
    assert_allclose(runs.mean(1), 1, atol=0.12)


def test_the_wavelengths_of_rgb_are_the_means_of_the_channels():
    """Authority: the integral; so each channel is shifted by as much as in the mean of the spectrum."""
    for gains in EQUALISERS:
        wavelengths, weights = WavelengthSampling(dispersion="rgb", equaliser=gains).sample(64)
        assert len(np.unique(wavelengths)) == 3
        result = (weights * wavelengths[:, None]).mean(0)
        assert_allclose(result, exact_means(gains, lambda x: x), atol=0.05)
        assert ((weights > 0).sum(1) == 1).all()


def test_a_flat_equaliser_changes_nothing():
    wavelengths, weights = WavelengthSampling().sample(64)
    for gains in ((1.0,) * 7, (4.0,) * 2):
        flat_wavelengths, flat_weights = WavelengthSampling(equaliser=gains).sample(64)
        assert_array_equal(flat_wavelengths, wavelengths)
        assert_array_equal(flat_weights, weights)


def test_wavelengths_are_drawn_where_the_gain_is_high():
    """Authority: the cumulated importance, exactly: chances of the Halton points are its values."""
    gains = (1, 10, 1, 1, 10, 1, 1, 10, 1)
    draw = WavelengthSampling(equaliser=gains)
    wavelengths, weights = draw.sample(900)
    importance = draw.response(FINE).mean(-1)
    cumulated = np.interp(wavelengths, FINE + 0.05, np.cumsum(importance) / importance.sum())
    assert_allclose(cumulated, halton(900, 5) + 0.5 / 900, atol=2e-4)
    flat = WavelengthSampling().sample(900)[0]
    high = [np.mean([gain_at(gains, x) > 5 for x in drawn]) for drawn in (wavelengths, flat)]
    assert high[0] > 1.5 * high[1]
    assert weights.max() < 3.5


def test_importance_keeps_half_covered_discs_calmer_than_even_wavelengths():
    """Authority: the covered share of the disc, which all channels must show where nothing disperses."""
    points = disc_from_square(np.stack([halton(9216, 2), halton(9216, 3)], -1)).reshape(144, 64, 2)
    drawn = WavelengthSampling().sample(9216)[1].reshape(144, 64, 3)
    even = MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * halton(9216, 5)
    evenly = np.maximum(wavelength_color(even), 0).reshape(144, 64, 3)
    noise = []
    for weights in (drawn, evenly):
        errors = []
        for angle in np.arange(24) * np.pi / 12:
            covered = points @ [np.cos(angle), np.sin(angle)] < 0
            errors.append((weights * covered[..., None]).sum(1) / weights.sum(1) - 0.5)
        noise.append(np.sqrt(np.mean(np.square(errors))))
    assert noise[0] < 0.06
    assert noise[0] < 0.9 * noise[1]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"dispersion": "prism"}, "dispersion: expected one of continuous, rgb, got 'prism'"),
        ({"equaliser": ()}, "equaliser: expected 1 to 64 gains, got 0"),
        ({"equaliser": (1.0,) * 65}, "got 65"),
        ({"equaliser": (1, -0.1)}, "equaliser: expected at least 0, got -0.1"),
        ({"equaliser": (1, np.nan)}, "equaliser: expected a finite number"),
        ({"equaliser": (0, 0, 0)}, "got none for red"),
        ({"equaliser": (0, 0, 0, 0, 0, 0, 0, 0, 1)}, "got none for green"),
    ],
)
def test_mistakes_are_reported(arguments, words):
    with pytest.raises(ParameterError, match=words):
        WavelengthSampling(**arguments)


def test_too_few_wavelengths_are_refused():
    with pytest.raises(ParameterError, match="count: expected at least 8, got 7"):
        WavelengthSampling().sample(7)
