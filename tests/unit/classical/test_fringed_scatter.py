"""Colours separated by the scatter. Authority: the spectrum itself, and rays sent one by one."""

import math

import numpy as np
import pytest

from bokehnet.classical import rays_renderer
from bokehnet.classical.base import Strip
from bokehnet.classical.fringed_scatter import chromatic_fringes
from bokehnet.classical.rays_renderer import rays, render_rays
from bokehnet.optics.aberrations.aberration_map import AberrationMap, term
from bokehnet.optics.aberrations.chromatic_aberration import ChromaticAberration, achromat_curve
from bokehnet.optics.aberrations.lens_response import LensResponse
from bokehnet.optics.spectral.wavelength_sampling import WavelengthSampling
from tests.unit.classical.test_lens_response_rays import HEIGHT, WIDTH, decibels, picture, seen

HALF = 0.5 * math.hypot(WIDTH, HEIGHT)


def fringes(**options) -> LensResponse:
    sampling = WavelengthSampling(dispersion=options.pop("dispersion", "continuous"))
    return LensResponse(chromatic_aberration=ChromaticAberration(**options), wavelength_sampling=sampling)


@pytest.mark.parametrize("dispersion", ["continuous", "rgb"])
@pytest.mark.parametrize("curve", [None, achromat_curve()])
def test_each_colour_keeps_its_light_and_its_mean_strength(dispersion, curve):
    lens = fringes(axial=2.0, lateral=-1.0, dispersion=dispersion, **({"curve": curve} if curve else {}))
    result = chromatic_fringes(lens, 400.0)
    assert result is not None
    np.testing.assert_allclose(result.colors.sum(0), 1, atol=1e-6)
    wavelengths, weights = lens.wavelengths_at((np.arange(100_000) + 0.5) / 100_000)
    strengths = 400 * lens.chromatic_aberration.strengths(wavelengths)
    expected = strengths.T @ weights / len(weights)
    np.testing.assert_allclose(
        np.stack([result.axial, result.lateral]) @ result.colors, expected, atol=2e-3 * np.ptp(strengths)
    )


def test_a_lens_that_does_more_is_left_to_the_rays():
    bent = np.zeros((3, 2, 20))
    bent[:, 0, term(1, 0, 0)] = 0.01
    aberrated = AberrationMap(
        wavelengths=[400.0, 587.56, 700.0], transverse_aberration=bent, pupil_aberration=0 * bent
    )
    both = ChromaticAberration(axial=1.0)
    assert chromatic_fringes(LensResponse(aberration_map=aberrated, chromatic_aberration=both), 100) is None
    assert chromatic_fringes(LensResponse(), 100) is None
    assert chromatic_fringes(fringes(axial=90.0), 1000) is None


@pytest.mark.slow
@pytest.mark.parametrize("strengths", [(3.0, 3.0), (6.0, 0.0), (0.0, 6.0)])
@pytest.mark.parametrize("defocus", [-6.0, 0.0, 4.0])
def test_a_plane_is_nearer_to_its_rays_than_as_many_as_are_sent(strengths, defocus, monkeypatch):
    """Away from the border, to 3000 rays a pixel: the error of what the renderer's own 128 give is larger."""
    image, lens = picture(), fringes(axial=strengths[0], lateral=strengths[1])
    plane = np.full((HEIGHT, WIDTH), defocus, np.float32)
    inner = slice(16, -16, 4)
    truth = seen(image, defocus, lens, 3000, step=4)[4:-4, 4:-4]
    result = decibels(rays(image, plane, lens_response=lens)[inner, inner], truth)
    monkeypatch.setattr(rays_renderer, "chromatic_fringes", lambda *_: None)
    by_rays = decibels(rays(image, plane, lens_response=lens)[inner, inner], truth)
    assert result > 46
    assert result > by_rays


def test_white_stays_white_and_rows_by_themselves_are_those_of_the_whole():
    lens = fringes(axial=3.0, lateral=3.0)
    white, ramp = (
        np.full((HEIGHT, WIDTH, 3), 0.5, np.float32),
        np.linspace(-6, 6, HEIGHT * WIDTH, dtype=np.float32).reshape(HEIGHT, WIDTH),
    )
    np.testing.assert_allclose(rays(white, ramp, lens_response=lens), 0.5, atol=1e-5)
    tall = np.tile(picture(), (4, 1, 1))
    defocus = np.repeat(np.linspace(-6, 6, len(tall), dtype=np.float32)[:, None], WIDTH, 1)
    whole = render_rays(tall, defocus, lens_response=lens).bokeh
    strip = Strip(
        first=64,
        last=320,
        left=0,
        right=WIDTH,
        height=len(tall),
        width=WIDTH,
        max_coc_radius=6,
        max_ray_reach=12,
        output_rows=slice(96, 160),
        output_columns=slice(0, WIDTH),
    )
    part = render_rays(tall[64:320], defocus[64:320], lens_response=lens, strip=strip).bokeh
    np.testing.assert_allclose(part, whole[160:224], atol=2e-6)
