"""Lommel's functions against the light that a discrete Fourier transform of the pupil gives."""

import math

import numpy as np
import pytest

from benchmarks.experiments.lenses.lommel import relative_error
from bokehnet.baselines import lommel
from bokehnet.baselines.spread.lommel_functions import bessel_orders, lommel_intensity
from bokehnet.baselines.spread.lommel_spots import lommel_table
from bokehnet.errors import ParameterError

scipy_special = pytest.importorskip("scipy.special")


@pytest.mark.parametrize("waves", [0, 0.25, 0.5, 1, 2, 3.3, 5, 8, 12, 16.5, 20])
def test_intensity_is_that_of_the_defocused_pupil(waves):
    """Authority: a discrete Fourier transform of the pupil; at most 1 % of the L2 norm over the plane."""
    assert relative_error(waves) <= 0.01


def test_both_forms_agree_at_the_edge_of_the_disc():
    for u in (3.0, 40.0, 200.0):
        inside, outside = lommel_intensity(u, np.array([u * (1 - 1e-9), u * (1 + 1e-9)]))
        assert inside == pytest.approx(outside, rel=1e-6)


def test_the_axis_has_its_closed_form():
    """Born and Wolf, 8.8, eq. 25: (sin(u / 4) / (u / 4))^2; with V for U, as printed, it would be 0."""
    for u in (1.0, 7.0, 60.0):
        assert lommel_intensity(u, np.array([0.0]))[0] == pytest.approx(
            (math.sin(u / 4) / (u / 4)) ** 2, abs=1e-9
        )


def test_bessel_functions_are_scipys():
    v = np.array([1e-6, 0.3, 2.0, 17.0, 250.0])
    result = bessel_orders(300, v)
    expected = scipy_special.jv(np.arange(301)[:, None], v[None, :])
    assert np.abs(result - expected).max() < 1e-10


def test_tables_hold_the_disc_and_tend_to_it_with_the_wavelength():
    coarse, fine = (lommel_table(6.0, unit) for unit in (0.5, 0.05))
    assert coarse.sum() == pytest.approx(1)
    y, x = np.mgrid[: len(fine), : len(fine)] - len(fine) // 2
    disc = (np.hypot(x, y) <= 6) / (36 * math.pi)
    inner = np.hypot(x, y) <= 5
    assert np.abs(fine[inner] * 36 * math.pi - 1).mean() < 0.12
    assert np.abs(fine - disc).sum() < 0.25


def test_each_channel_has_its_wavelength():
    image = np.zeros((31, 31, 3), np.float32)
    image[15, 15] = 1
    result = lommel(image, np.zeros((31, 31)), f_number=16, wavelengths=(0.65, 0.55, 0.45))
    spread = [(result[..., c] > 0.1 * result[..., c].max()).sum() for c in range(3)]
    assert spread[0] > spread[2]
    with pytest.raises(ParameterError, match="wavelengths"):
        lommel(image, np.zeros((31, 31)), wavelengths=(0.6, 0.5, -1))
