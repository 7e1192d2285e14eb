"""Clusters of wavelengths that one ray carries, one wavelength from each stratum of the spectrum.

A ray that meets only surfaces without dispersion evaluates a whole cluster at the cost of one wavelength, and
its colour has hardly any noise. At a dispersive surface the cluster is reduced to one wavelength, which then
carries the light of all.

Source: Evans and McCool, "Stratified wavelength clusters for efficient spectral Monte Carlo rendering",
Graphics Interface 1999, after Marsicano, "Rendering real time depth of field effects", 2023, 3.3.
"""

import numpy as np

from bokehnet.checks import check_whole
from bokehnet.optics.spectral.spectrum import MAX_WAVELENGTH, MIN_WAVELENGTH, wavelength_color

__all__ = ["cluster_colors", "reduced_cluster", "stratified_clusters"]


def stratified_clusters(count: int, size: int, rng: np.random.Generator) -> np.ndarray:
    """Return ``count`` clusters of wavelengths, (count, size), nm, one in each of ``size`` equal strata.

    Within each stratum the wavelengths of all clusters are stratified, too, in an order of their own, so that
    the clusters together are evenly spread.

    Args:
        count: Number of clusters.
        size: Wavelengths of each cluster.
        rng: Generator of positions and orders.
    """
    check_whole("count", count, 1)
    check_whole("size", size, 1)
    cells = rng.permuted(np.broadcast_to(np.arange(count), (size, count)), axis=1).T
    position = (cells + rng.random((count, size))) / count
    return MIN_WAVELENGTH + (MAX_WAVELENGTH - MIN_WAVELENGTH) * (np.arange(size) + position) / size


def cluster_colors(wavelengths: np.ndarray, spectrum: np.ndarray) -> np.ndarray:
    """Return the colours of clusters, (count, 3), linear RGB.

    Args:
        wavelengths: Wavelengths, nm, (count, size).
        spectrum: Light of each wavelength, (count, size); 1 everywhere is white.
    """
    return np.asarray((wavelength_color(wavelengths) * spectrum[..., None]).mean(1))


def reduced_cluster(wavelengths: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return one wavelength of each cluster at random, (count,), nm, after a dispersive surface.

    Its light counts for the whole cluster: the mean over many clusters stays.
    """
    chosen = rng.integers(wavelengths.shape[1], size=len(wavelengths))
    return np.asarray(wavelengths[np.arange(len(wavelengths)), chosen])
