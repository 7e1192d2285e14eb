"""Traces of polishing and absorption in glass."""

import numpy as np
import pytest

from bokehnet.errors import ParameterError
from bokehnet.lenses import Rays, load_lens
from bokehnet.lenses.aberrations.glass_absorption import absorbed_rays, glass_paths
from bokehnet.lenses.aberrations.polishing import PolishedSurface, polished_psf


def rings(psf):
    """Mean light per pixel at each whole distance from the middle."""
    half = len(psf) // 2
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    distance = np.rint(np.hypot(x, y)).astype(int)
    return np.bincount(distance.ravel(), psf.ravel()) / np.bincount(distance.ravel())


def test_a_perfect_surface_draws_the_disc():
    psf = polished_psf(PolishedSurface(ring_height=0, noise_height=0), 20.0, 0.01, 50.0)
    assert psf.sum() == pytest.approx(1)
    assert rings(psf)[:18] == pytest.approx(1 / (np.pi * 400), rel=0.03)


def test_rings_have_the_density_of_their_mapping():
    """Authority: light of the zone r to r + dr goes to R(r) = b r + s h'(r): density r dr / (R dR)."""
    surface = PolishedSurface(rings=5, ring_height=25, wander=0, noise_height=0)
    blur, pitch, distance = 40.0, 0.01, 50.0
    result = rings(polished_psf(surface, blur, pitch, distance))
    r = (np.arange(400000) + 0.5) / 400000
    slope = -surface.ring_height * 1e-6 * 2 * np.pi * surface.rings * np.sin(2 * np.pi * surface.rings * r)
    at = np.abs(blur * r + 0.5 * distance / pitch * slope / surface.radius)
    light = np.histogram(at, np.arange(44) - 0.5, weights=2 * r / len(r))[0]
    k = np.arange(1, 38)
    expected = light[1:38] / (np.pi * ((k + 0.5) ** 2 - (k - 0.5) ** 2))
    assert np.abs(result[1:38] - expected).mean() < 0.05 * expected.mean()
    assert result[5:36].std() > 0.05 * result[5:36].mean()  # rings are there


def test_rings_fade_with_their_height_and_repeat_with_their_seed():
    def contrast(height):
        result = rings(polished_psf(PolishedSurface(ring_height=height, noise_height=0), 30.0, 0.01, 50.0))
        return result[3:27].std() / result[3:27].mean()

    assert contrast(40) > 2 * contrast(10) > 0
    one, same, other = (PolishedSurface(seed=seed).heights() for seed in (1, 1, 2))
    assert (one == same).all()
    assert (one != other).any()
    with pytest.raises(ParameterError, match="rings"):
        PolishedSurface(rings=0)


def test_paths_on_the_axis_are_the_thicknesses_of_the_glass():
    """Authority: the distances between the vertices of glass surfaces."""
    lens = load_lens("double_gauss")
    thickness, inside, last = 0.0, False, 0.0
    for surface in lens.surfaces:
        if inside:
            thickness += float(surface.vertex) - last
        last = float(surface.vertex)
        if not surface.stop:
            inside = float(np.max(surface.behind)) > 1.2
    path, passes = glass_paths(lens, Rays(origin=np.zeros((1, 2)), slope=np.zeros((1, 2))))
    assert passes.all()
    assert path[0] == pytest.approx(thickness, rel=1e-9)


def test_absorbed_rays_lose_the_light_of_their_path():
    lens = load_lens("double_gauss")
    uv = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, -0.6]])
    rays = lens.sample_rays(np.tile([5.0, 0.0], (3, 1)), uv)
    path, passes = glass_paths(lens, rays)
    assert passes.all()
    result = absorbed_rays(lens, rays, 0.9)
    assert result.weight / rays.weight == pytest.approx(0.9 ** (path / 10))
