"""Clusters of wavelengths: strata, expectation and noise."""

import numpy as np
import pytest

from bokehnet.optics.spectral.absorption import internal_transmittance
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color
from bokehnet.optics.spectral.wavelength_clusters import cluster_colors, reduced_cluster, stratified_clusters


def test_each_cluster_has_one_wavelength_in_each_stratum():
    result = stratified_clusters(64, 8, np.random.default_rng(0))
    stratum = (result - MIN_WAVELENGTH) / (MAX_WAVELENGTH - MIN_WAVELENGTH) * 8
    assert (stratum.astype(int) == np.arange(8)).all()
    # All clusters together are stratified in each stratum, too.
    assert (np.sort((stratum % 1 * 64).astype(int), 0) == np.arange(64)[:, None]).all()


def test_clusters_have_the_colour_of_a_spectrum_and_less_noise():
    """Authority: the integral over the spectrum."""
    fine = np.linspace(MIN_WAVELENGTH, MAX_WAVELENGTH, 4001)

    def light(wavelength):
        return 1 + 0.5 * np.sin(wavelength / 40)

    expected = (wavelength_color(fine) * light(fine)[:, None]).mean(0)
    rng = np.random.default_rng(1)
    clusters = stratified_clusters(4096, 8, rng)
    colors = cluster_colors(clusters, light(clusters))
    assert colors.mean(0) == pytest.approx(expected, abs=0.01)
    single = reduced_cluster(clusters, rng)
    reduced = wavelength_color(single) * light(single)[:, None]
    assert reduced.mean(0) == pytest.approx(expected, abs=0.08)
    assert (colors.std(0) < 0.25 * reduced.std(0)).all()


def test_absorption_multiplies_along_the_path():
    """Authority: Lambert and Beer."""
    assert internal_transmittance(0.98, 10.0) == pytest.approx(0.98)
    assert internal_transmittance(0.98, 25.0) == pytest.approx(
        internal_transmittance(0.98, 10.0) * internal_transmittance(0.98, 15.0)
    )
    assert internal_transmittance(0.5, 0.0) == 1
