"""Rays of three channels by one march. Oracle: each channel marched for itself."""

import math

import numpy as np

from bokehnet.classical.layered.layers import Layers
from bokehnet.classical.layered.march import channel_rays, ray_marching
from bokehnet.classical.layered.march.channel_rays import MAX_OUTLINE_REACH_PX, outlines_of
from bokehnet.classical.layered.march.intersection import layer_cells
from bokehnet.classical.rays_renderer import rays
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling

HEIGHT, WIDTH = 64, 96


def cells_of(defocus: np.ndarray) -> np.ndarray:
    return layer_cells(
        Layers(
            colors=np.zeros((*defocus.shape, 1, 3), np.float32),
            defocus=defocus[..., None],
            coverage=np.ones((*defocus.shape, 1), np.float32),
        )
    )


def test_outlines_cover_both_sides_of_a_step_and_widen_by_a_pixel_each():
    defocus = np.full((HEIGHT, WIDTH), -4.0, np.float32)
    defocus[:, 40:] = 6.0
    outlines = outlines_of(cells_of(defocus))
    for reach in range(MAX_OUTLINE_REACH_PX + 1):
        low, high = outlines[reach, 20].T
        columns = np.flatnonzero(low <= high)
        np.testing.assert_array_equal(columns, np.arange(39 - reach, 41 + reach))
    assert tuple(outlines[0, 20, 39]) == (-4.0, -4.0)
    assert tuple(outlines[0, 20, 40]) == (6.0, 6.0)
    assert tuple(outlines[1, 20, 40]) == (-4.0, 6.0)


def test_a_slope_has_no_outline():
    defocus = np.broadcast_to(0.9 * np.arange(WIDTH, dtype=np.float32), (HEIGHT, WIDTH)).copy()
    outlines = outlines_of(cells_of(defocus))
    assert (outlines[..., 0] > outlines[..., 1]).all()


def test_one_march_shows_what_three_show(monkeypatch):
    """A post before a ground; with outlines everywhere the channels are marched apart."""
    rng = np.random.default_rng(2)
    image = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    for _ in range(2):
        image = (image + np.roll(image, 1, 0) + np.roll(image, 1, 1)) / 3
    defocus = np.full((HEIGHT, WIDTH), -6.0, np.float32)
    defocus[10:, 40:56] = 0.0
    lens_response = LensResponse(chromatic_aberration=ChromaticAberration(axial=1.5, lateral=1.5))

    def mean() -> np.ndarray:
        return np.mean([rays(image, defocus, lens_response=lens_response, seed=s) for s in range(12)], axis=0)

    together = mean()
    whole = channel_rays.outlines_of

    def everywhere(cells: np.ndarray) -> np.ndarray:
        outlines = whole(cells)
        outlines[..., 0], outlines[..., 1] = -1e30, 1e30
        return outlines

    monkeypatch.setattr(ray_marching, "outlines_of", everywhere)
    monkeypatch.setattr(ray_marching, "dilate_bins", lambda bins: bins)
    apart = mean()
    for channel in range(3):
        assert -10 * math.log10(np.mean((together - apart)[..., channel] ** 2)) > 41


def test_wavelengths_of_a_channel_weigh_as_its_light_does():
    for dispersion in ("continuous", "rgb"):
        sampling = WavelengthSampling(dispersion=dispersion)
        chances = (np.arange(4000) + 0.5) / 4000
        wavelengths = sampling.by_channel(chances)
        drawn, weights = sampling.at(chances)
        expected = (weights * drawn[:, None]).mean(0)
        np.testing.assert_allclose(wavelengths.mean(0), expected, rtol=2e-4)
        assert wavelengths[:, 0].min() > wavelengths[:, 2].min()
